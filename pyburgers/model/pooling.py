"""Joint fits: which parameters tests share, which scatter around a common centre, which are apart.

Names and defaults only; the densities are in `stan/charts/pooling.stan`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal, get_args

from pyburgers.common.errors import InputError, nearest
from pyburgers.model.parameters import CONDITIONS, CONSTANTS, PROGRAM_PARAMETERS

Sharing = Literal["shared", "partial", "separate"]

DEFAULT_SPREAD_SCALE = 0.5
"""Scale of the half-normal prior of a spread, on the real line behind a bounded parameter.

Half of a unit there is a factor of 1.6 in the odds of the parameter's place between its bounds, or
in its distance from a lower bound.
"""

ALL = "all"
"""Stands for every parameter in an option."""

STRENGTH = "peak_strength"
"""Strength over 1/E_M: tests that share it, but not E_M, would have different delayed strains."""

DEFAULT_KINDS: Mapping[str, Sharing] = {
    **{p.name: "shared" for p in PROGRAM_PARAMETERS if p.name not in CONSTANTS | CONDITIONS},
    "steady_state_grain_size": "partial",
    "steady_state_fabric_factor": "separate",
    "critical_strain_grain_size": "separate",
    "critical_strain_fabric": "separate",
    "stress_noise": "separate",
    "residual_correlation_strain": "separate",
    "residual_correlated_share": "separate",
    "discrepancy": "separate",
    "strain_noise": "separate",
    "residual_correlation_time": "separate",
    "strain_offset": "separate",
    "apparatus_compliance": "separate",
}
"""Flow law and moduli are the material's, microstructure the sample's, noise the test's.

Of the microstructure only the steady-state grain size is pooled: the others are solved from the
curve of their test, and their pooling would fold the posterior (docs/joint.md).
"""


@dataclass(frozen=True)
class Pooling:
    """How the tests of a joint fit hang together.

    `kinds`: by name, every parameter that can be inferred but for `CONDITIONS`, whose tests are
        said by what they were made with. "shared" is one value for all tests. "partial" is a value
        for each, normal around a common centre on the real line behind the parameter's bounds.
        "separate" values know nothing of each other.
    `spread_scales`: scale of the half-normal prior of the spread of each "partial" parameter.
    """

    kinds: Mapping[str, Sharing]
    spread_scales: Mapping[str, float]

    def of_kind(self, kind: Sharing, names: Sequence[str]) -> tuple[str, ...]:
        """Return those of some parameters that are pooled in a way, in their order."""
        return tuple(name for name in names if self.kinds.get(name) == kind)

    def record(self) -> dict[str, Any]:
        """Return what a manifest holds."""
        return {"kinds": dict(self.kinds), "spread_scales": dict(self.spread_scales)}


SEPARATE = Pooling(MappingProxyType(dict.fromkeys(DEFAULT_KINDS, "separate")), MappingProxyType({}))
"""Tests that know nothing of each other, or one by itself."""


def pooling_of(options: Mapping[str, str] | None = None) -> Pooling:
    """Return the defaults with some parameters pooled in another way.

    Options are by parameter, or by "all" for every one that is not named: "shared", "partial",
    "partial:SCALE" with the scale of the spread's prior, or "separate". Raise InputError if a
    parameter or a way is unknown, or a scale is not above 0 and at most 10.
    """
    options = options or {}
    for name in options:
        if name in CONSTANTS:
            raise InputError(f"--pool {name}: is a constant of the model, expected a parameter.")
        if name in CONDITIONS:
            raise InputError(
                f"--pool {name}: is shared by the tests that name the same furnace or load cell, "
                "expected the keys 'furnace' or 'load_cell' in their files instead."
            )
        if name not in (*DEFAULT_KINDS, ALL):
            raise InputError(
                f"--pool {name}: unknown parameter {name!r}, {nearest(name, [*DEFAULT_KINDS, ALL])}"
            )
    chosen = {name: _kind(name, text) for name, text in options.items()}
    kinds: dict[str, Sharing] = {}
    scales = {}
    for name, default in DEFAULT_KINDS.items():
        kind, scale = chosen.get(name) or chosen.get(ALL) or (default, DEFAULT_SPREAD_SCALE)
        kinds[name] = kind
        if kind == "partial":
            scales[name] = scale
    if kinds["maxwell_modulus"] != "shared" and not {STRENGTH, ALL} & chosen.keys():
        kinds[STRENGTH] = "separate"
    return Pooling(MappingProxyType(kinds), MappingProxyType(scales))


def pooling_from(record: Mapping[str, Any]) -> Pooling:
    """Return the pooling of a manifest, the inverse of `Pooling.record`."""
    return Pooling(MappingProxyType(record["kinds"]), MappingProxyType(record["spread_scales"]))


def parse_pooling(options: Sequence[str]) -> dict[str, str]:
    """Read options of the form NAME=KIND for `pooling_of`.

    Raise InputError if one has another form or a name stands twice.
    """
    found: dict[str, str] = {}
    for option in options:
        name, sign, kind = option.partition("=")
        if not (name and sign and kind):
            raise InputError(
                f"--pool {option}: expected NAME=shared, NAME=partial or NAME=separate."
            )
        if name in found:
            raise InputError(f"--pool {option}: {name} stands twice, expected it once.")
        found[name] = kind
    return found


def _kind(name: str, text: str) -> tuple[Sharing, float]:
    """Read a way of pooling, and the scale of the spread's prior."""
    kind, colon, number = text.partition(":")
    kinds = get_args(Sharing)
    if kind not in kinds or (colon and kind != "partial"):
        raise InputError(
            f"--pool {name}={text}: found {text!r}, expected shared, partial, partial:SCALE or "
            "separate."
        )
    way: Sharing = kinds[kinds.index(kind)]
    if not colon:
        return way, DEFAULT_SPREAD_SCALE
    try:
        scale = float(number)
    except ValueError:
        scale = -1.0
    if not 0 < scale <= 10:
        raise InputError(
            f"--pool {name}={text}: found the scale {number!r}, expected a number above 0 and at "
            "most 10."
        )
    return way, scale

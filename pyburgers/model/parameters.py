"""The parameters of the nonlinear Burgers model: names, symbols, units, order.

`parameters.csv` beside this module lists them. The order of `PROGRAM_PARAMETERS` is the order of
the parameter vector in the Stan programs (`stan/physics/parameters.stan`).
"""

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from pyburgers.common.units import UNITS
from pyburgers.model.laws import DASHPOT_STRESSES, HARDENING_SWITCH, NONLINEAR_KELVIN_PARAMETERS


@dataclass(frozen=True)
class Parameter:
    """One parameter of the model.

    `name`: name in files, draws and tables.
    `symbol`: the paper's symbol as matplotlib mathtext, without dollar signs.
    `label`: plain words for tables and axes.
    `quantity`: physical quantity, a key of `pyburgers.common.units.UNITS`.
    `display_unit`: unit of figures and tables.
    `standard`: SI value of a parameter of a variant where nothing is said about it: the value that
        leaves it without effect. None for parameters that always have to be given.
    """

    name: str
    symbol: str
    label: str
    quantity: str
    display_unit: str
    standard: float | None = None

    @property
    def si_unit(self) -> str:
        """Unit of stored values."""
        return next(unit for unit, factor in UNITS[self.quantity].items() if factor == 1.0)

    @property
    def display_factor(self) -> float:
        """Factor from SI to `display_unit`."""
        return 1.0 / UNITS[self.quantity][self.display_unit]


def _parameters(group: str) -> tuple[Parameter, ...]:
    """Return the parameters of a group of the table, in its order."""
    text = Path(__file__).with_name("parameters.csv").read_text(encoding="utf-8")
    rows = [
        (row.pop("group"), row.pop("standard"), row) for row in csv.DictReader(text.splitlines())
    ]
    return tuple(
        Parameter(**row, standard=float(standard) if standard else None)
        for its_group, standard, row in rows
        if its_group == group
    )


PARAMETERS = _parameters("material")
"""Every parameter that a prior file has to name, in the order of the Stan programs."""

VARIANT_PARAMETERS = _parameters("variant")
"""Parameters of variants (`docs/variants.md`), which a prior file may name."""

CONDITION_PARAMETERS = _parameters("condition")
"""Errors of the conditions of a test; their priors come from its file, not from the material's."""

ENVIRONMENT_PARAMETERS = _parameters("environment")
"""What surrounds or fills the sample of a test, which its file states."""

RATE_PARAMETERS = _parameters("rates")
"""What laws of tables of rates have beside the flow law's n, p and Q_M."""

ENVIRONMENT = tuple(p.name for p in ENVIRONMENT_PARAMETERS)
"""Its names, those of `pyburgers.kinds.experiment.Experiment.environment`."""

ENVIRONMENT_NUMBERS = ("activation_volume", "water_exponent", "melt_factor")
"""What a rate makes of each of `ENVIRONMENT`; below, all rates of the material."""
ALL_ENVIRONMENT_NUMBERS = tuple(
    f"{whose}{name}"
    for whose in ("", "second_", "third_", "kelvin_", "recovery_")
    for name in ENVIRONMENT_NUMBERS
)

RESIDUAL_CORRELATION = (
    "residual_correlation_strain",
    "residual_correlation_time",
    "residual_correlated_share",
    "discrepancy",
)
"""Parameters of how residuals hang together."""

STANDARD_VALUES: Mapping[str, float] = {
    p.name: p.standard
    for p in (*VARIANT_PARAMETERS, *CONDITION_PARAMETERS, *ENVIRONMENT_PARAMETERS)
    if p.standard is not None
}
"""SI values of the parameters of variants and conditions where nothing is said about them."""

MATERIAL_PARAMETERS: tuple[Parameter, ...] = (*PARAMETERS, *VARIANT_PARAMETERS)
"""What a prior file may name."""

PROGRAM_PARAMETERS: tuple[Parameter, ...] = (
    *MATERIAL_PARAMETERS,
    *CONDITION_PARAMETERS,
    *ENVIRONMENT_PARAMETERS,
)

PLACE: Mapping[str, int] = {p.name: k for k, p in enumerate(PROGRAM_PARAMETERS, start=1)}
"""Place of each parameter in the programs, as in `stan/physics/parameters.stan`."""

PIEZOMETER = (
    "piezometer_reference_grain_size",
    "piezometer_exponent",
    "piezometer_stress_floor",
)
"""What the piezometer of a material is given by; without a grain size it has none."""

CONDITIONS = frozenset(p.name for p in CONDITION_PARAMETERS)
"""Errors of the conditions of a test, by name."""

KELVIN_REFERENCES: Mapping[str, str] = {
    **dict.fromkeys(NONLINEAR_KELVIN_PARAMETERS, "kelvin_reference_stress"),
    "kelvin_activation_enthalpy": "kelvin_reference_temperature",
    "kelvin_grain_size_exponent": "kelvin_reference_grain_size",
}
"""Where the Kelvin viscosity varies by the first, the second says for what it is given."""

MECHANISM_REFERENCES = (
    "mechanism_reference_stress",
    "mechanism_reference_grain_size",
    "mechanism_reference_temperature",
)
"""Conditions for which the rates of further mechanisms are given."""

_OF_MECHANISM = (
    "rate",
    "stress_exponent",
    "grain_size_exponent",
    "activation_enthalpy",
    "in_series",
)

FURTHER_MECHANISMS: Mapping[str, tuple[str, ...]] = {
    which: tuple(f"{which}_{name}" for name in _OF_MECHANISM) for which in ("second", "third")
}
"""Parameters of each further mechanism of the dashpot; without the first there is none.

The last is 1 where the second is in series with the first, or the third with the second.
"""

STRESS_EXPONENTS = ("stress_exponent", *(own[1] for own in FURTHER_MECHANISMS.values()))
"""Of all mechanisms of the dashpot."""

FURTHER_PARAMETERS = (
    *(name for own in FURTHER_MECHANISMS.values() for name in own),
    *MECHANISM_REFERENCES,
)
"""All that further mechanisms of the dashpot are given by."""

CONSTANTS = frozenset(
    {
        *KELVIN_REFERENCES.values(),
        "modulus_reference_temperature",
        "reference_backstress",
        *PIEZOMETER,
        *MECHANISM_REFERENCES,
        *(own[-1] for own in FURTHER_MECHANISMS.values()),
        *ENVIRONMENT,
    }
)
"""Parameters that are never inferred."""

GIVEN_TOGETHER: Mapping[str, tuple[str, ...]] = {
    **{name: (reference,) for name, reference in KELVIN_REFERENCES.items()},
    PIEZOMETER[0]: PIEZOMETER[1:],
    "relaxation_time_decades": ("relaxation_exponent",),
    "peak_strength": ("peak_time_decades", "peak_width"),
    "hardening_modulus": ("backstress_limit",),
    "recovery_exponent": (),
    "reference_backstress": (
        "initial_backstress",
        "source_stress",
        "boundary_recovery",
        "kelvin_reference_grain_size",
    ),
    "recovery_activation_enthalpy": ("kelvin_reference_temperature",),
    **{own[0]: (*own[1:-1], *MECHANISM_REFERENCES) for own in FURTHER_MECHANISMS.values()},
    **dict.fromkeys(STRESS_EXPONENTS[1:], ()),
}
"""Where the first is not left without effect, the others have to be given too."""

BELOW_ONE = frozenset({"relaxation_exponent", "andrade_exponent"})
"""Exponents of relaxation and creep, which at 1 are a dashpot."""

PARAMETER_BY_NAME: Mapping[str, Parameter] = {p.name: p for p in PROGRAM_PARAMETERS}

MAY_BE_ZERO = frozenset(
    {"grain_size_exponent", *(name for name, value in STANDARD_VALUES.items() if value == 0.0)}
)
"""Parameters that may be fixed at zero."""

UNSIGNED = frozenset(
    {
        "beta",
        "activation_enthalpy",
        "modulus_temperature_coefficient",
        "strain_offset",
        *CONDITIONS,
        *ALL_ENVIRONMENT_NUMBERS,
    }
)
"""Parameters whose priors may reach below zero."""

BOUNDED_AWAY_FROM_ZERO = frozenset(
    {
        "steady_state_fabric_factor",
        "critical_strain_grain_size",
        "critical_strain_fabric",
        *DASHPOT_STRESSES,
        *NONLINEAR_KELVIN_PARAMETERS,
        HARDENING_SWITCH,
        "backstress_limit",
        "initial_backstress",
        *(own[0] for own in FURTHER_MECHANISMS.values()),
        "relaxation_exponent",
        "peak_width",
    }
)
"""Parameters that divide or make a law: at zero the model breaks down, or the law is another one,
so priors may not pile up there.

The lower bound of zero that the paper prints for the critical strain of olivine is one of these.
"""

LOWER_LIMITS: Mapping[str, tuple[float, str]] = {
    "kelvin_stress_exponent": (
        1.0,
        "at least 1, a linear dashpot, because below it creep starts infinitely fast",
    ),
    "recovery_exponent": (
        1.0,
        "at least 1, because below it a small backstress recovers infinitely fast",
    ),
    **dict.fromkeys(
        STRESS_EXPONENTS[1:],
        (1.0, "at least 1, because below it the rate rises infinitely fast from zero stress"),
    ),
}
"""Lower bounds of parameters that have one beside their sign, and why."""

ENDS_AT_ONE = BELOW_ONE | {"steady_state_fabric_factor", "residual_correlated_share"}
"""Parameters for which an upper bound of 1 is no choice: a dashpot, no softening, the whole."""

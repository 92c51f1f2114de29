"""Data made by one variant of the model are attributed to it, where experts would see it too.

What can be seen in a curve of 100 readings with noise of 1.2 % of its peak: a Kelvin dashpot with
n_K = 3 against a linear one, a linear Maxwell dashpot against n near 4, fabric that lowers strength
to a third against none, residuals that correlate over 2 % strain against independent ones. What
cannot: which of grain size and fabric softens the material a little (docs/coordinates.md), or a
simple law inside a richer one that contains it, which then predicts alike.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from conftest import ICE

from pyburgers.calibration import simulate_data
from pyburgers.comparison import compare, comparison_table, elpd_difference, sentences
from pyburgers.constant_rate import load_constant_rate
from pyburgers.fitting import fit
from pyburgers.priors import default_priors
from pyburgers.sampling import SamplerOptions
from pyburgers.variants import with_variant

SEEDS = range(1, 11)
OPTIONS = SamplerOptions(chains=2, warmup=300, draws=500)

TRUTH: Mapping[str, float] = MappingProxyType(
    dict(load_constant_rate(ICE / "PIL40.toml").true_parameters or {})
)


@dataclass(frozen=True)
class Contrast:
    """A law that made the data, and a rival.

    Attributes
    ----------
    made_by, rival
        Choices of variants.
    truth
        True parameters (SI) other than those of PIL40.
    """

    made_by: Mapping[str, str]
    rival: Mapping[str, str]
    truth: Mapping[str, float]


def linear_beta() -> float:
    """Beta of a linear dashpot that flows as fast at 7 MPa as that of PIL40 does."""
    moved = (TRUTH["stress_exponent"] - 1) * np.log(7e6) / TRUTH["activation_enthalpy"]
    return float(TRUTH["beta"] + moved)


STANDARD: Mapping[str, str] = MappingProxyType({})
NONLINEAR_KELVIN: Mapping[str, str] = MappingProxyType({"kelvin": "power_law"})
LINEAR_MAXWELL: Mapping[str, str] = MappingProxyType({"maxwell": "linear"})
NO_FABRIC: Mapping[str, str] = MappingProxyType({"fabric": "constant"})
CORRELATED: Mapping[str, str] = MappingProxyType({"residuals": "autocorrelated"})

CONTRASTS = {
    "Kelvin n = 3, not 1": Contrast(
        NONLINEAR_KELVIN,
        STANDARD,
        {"kelvin_stress_exponent": 3.0, "kelvin_reference_stress": 2e6},
    ),
    "Maxwell n = 1, not 4": Contrast(
        LINEAR_MAXWELL,
        STANDARD,
        {"stress_exponent": 1.0, "beta": linear_beta(), "grain_size_exponent": 0.3},
    ),
    "Maxwell n = 4, not 1": Contrast(STANDARD, LINEAR_MAXWELL, {}),
    "strong fabric, not none": Contrast(
        STANDARD, NO_FABRIC, {"steady_state_fabric_factor": 0.33, "critical_strain_fabric": 0.08}
    ),
    "residuals over 2 % strain, not independent": Contrast(
        CORRELATED, STANDARD, {"residual_correlation_strain": 0.02}
    ),
}


def lead(contrast: Contrast, seed: int, folder: Path) -> tuple[float, float]:
    """Elpd of the fit with the law behind the data less that of the rival, and its error."""
    truth = {**TRUTH, **contrast.truth}
    data, _ = simulate_data(
        load_constant_rate(ICE / "PIL40.toml"), truth, np.random.default_rng(seed), source="test"
    )
    fits = {
        name: fit(
            data,
            with_variant(default_priors("ice"), data, choices),
            out=folder / name,
            options=OPTIONS,
        )
        for name, choices in (("right", contrast.made_by), ("rival", contrast.rival))
    }
    comparison = compare(fits)
    print(comparison_table(comparison).round(1).to_string(), *sentences(comparison), sep="\n")
    return elpd_difference(comparison.results["right"], comparison.results["rival"])


@pytest.mark.slow
@pytest.mark.parametrize("name", CONTRASTS)
def test_data_are_attributed_to_the_variant_behind_them(
    programs: None, name: str, tmp_path: Path
) -> None:
    leads = [lead(CONTRASTS[name], seed, tmp_path / str(seed)) for seed in SEEDS]
    for seed, (difference, error) in zip(SEEDS, leads, strict=True):
        print(f"{name}, seed {seed}: {difference:.1f} +- {error:.1f}")
    assert sum(difference > 0 for difference, _ in leads) >= 9

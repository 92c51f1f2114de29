"""Tables of attenuation made by one law of the Kelvin part are attributed to it.

What can be seen in a table like that of olivine A1802, with scatters of 7 % of tan delta, 1.2 % of
the modulus: a band of relaxation times or Andrade creep against one relaxation time, one time
against a band, and a band whose ends the periods reach against Andrade creep. What cannot: Andrade
creep against a band, which is a power law too where it is wider than the periods.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ICE

from pyburgers.comparison.by_points import compare
from pyburgers.comparison.pairs import Pair, PairOutcome
from pyburgers.fitting.fit import fit
from pyburgers.kinds.attenuation.files import load_attenuation
from pyburgers.kinds.forward import simulate_data
from pyburgers.model.priors import default_priors
from pyburgers.model.variants import with_variant
from pyburgers.sampling.options import SamplerOptions

SEEDS = range(1, 11)
OPTIONS = SamplerOptions(chains=2, warmup=250, draws=250)

SCATTER = {"attenuation_scatter": 0.068, "modulus_scatter": 0.012}

TRUTHS: Mapping[str, Mapping[str, float]] = {
    "linear": {
        "maxwell_modulus": 213.3e9,
        "kelvin_modulus": 1.189e12,
        "kelvin_viscosity": 7.149e11,
        "activation_enthalpy": 416.4e3,
        "beta": -8.086e-5,
        "kelvin_activation_enthalpy": 367.0e3,
        "modulus_temperature_coefficient": -2.815e-4,
    },
    "extended": {
        "maxwell_modulus": 198.1e9,
        "kelvin_modulus": 157.2e9,
        "kelvin_viscosity": 1.174e16,
        "activation_enthalpy": 454.4e3,
        "beta": -7.122e-5,
        "kelvin_activation_enthalpy": 624.5e3,
        "modulus_temperature_coefficient": -2.088e-4,
        "relaxation_time_decades": 8.19,
        "relaxation_exponent": 0.2047,
    },
    "andrade": {
        "maxwell_modulus": 206.9e9,
        "kelvin_modulus": 300e9,
        "kelvin_viscosity": 3.718e13,
        "activation_enthalpy": 455.8e3,
        "beta": -8.006e-5,
        "kelvin_activation_enthalpy": 589.7e3,
        "modulus_temperature_coefficient": -2.4e-4,
        "andrade_exponent": 0.2631,
    },
}
"""What the law that made a twin finds in the measured table."""


def compared(law: str, rival: str, seed: int, folder: Path) -> Pair:
    """Fit a twin with the law behind it, "right", and with its rival, and compare."""
    table = load_attenuation(ICE.parent / "olivine" / "attenuation_A1802.toml")
    priors = default_priors(table.material, table.protocol)
    right = with_variant(priors, table, {"kelvin": law})
    fixed = {name: prior.location for name, prior in right.priors.items() if prior.is_fixed}
    truth = {**fixed, **TRUTHS[law], **SCATTER}
    twin = simulate_data(
        replace(table, id="twin"), truth, np.random.default_rng(seed), source="test"
    )
    fits = {
        name: fit(
            twin,
            with_variant(priors, twin, {"kelvin": own}),
            out=folder / name,
            options=OPTIONS,
        )
        for name, own in (("right", law), ("rival", rival))
    }
    (pair,) = compare(fits).pairs()
    # Chains as short as these fail checks of their draws; what their numbers say is asked here.
    return replace(pair, doubt="")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "rival"),
    [
        ("extended", "linear"),
        ("extended", "andrade"),
        ("andrade", "linear"),
        ("linear", "extended"),
    ],
)
def test_tables_are_attributed_to_the_law_behind_them(
    programs: None, law: str, rival: str, tmp_path: Path
) -> None:
    found = [compared(law, rival, seed, tmp_path / str(seed)) for seed in SEEDS]
    for seed, pair in zip(SEEDS, found, strict=True):
        print(f"{law}, not {rival}, seed {seed}: {pair.sentence()}")
    clear = [pair.better == "right" and pair.outcome is PairOutcome.BETTER for pair in found]
    assert sum(clear) >= 9


@pytest.mark.slow
def test_a_wide_band_is_as_good_as_andrade_creep(programs: None, tmp_path: Path) -> None:
    assert compared("andrade", "extended", 1, tmp_path).outcome is not PairOutcome.BETTER

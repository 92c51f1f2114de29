"""What a table of attenuation adds to a curve at constant rate of the same material, and back."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ICE

from pyburgers.common.draws import all_draws
from pyburgers.fitting.fit import Fit, fit
from pyburgers.kinds.kind import load_experiment
from pyburgers.kinds.together import default_priors_for
from pyburgers.sampling.options import SamplerOptions

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("programs")]

CURVE, TABLE = "curve_beside_attenuation_twin", "attenuation_twin"
SHARED = ("stress_exponent", "kelvin_modulus", "kelvin_viscosity")


@pytest.fixture(scope="module")
def fits(programs: None, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Fit]:
    """Fits of the curve, the table and both with one set of priors."""
    curve, table = (load_experiment(ICE / f"{name}.toml") for name in (CURVE, TABLE))
    priors = default_priors_for([curve, table])
    # The grain size exponent is slow: of both, 4000 draws of it are worth 500 to 1100. What each
    # says alone is compared by standard deviations.
    together = SamplerOptions(chains=4, draws=2000, seed=20261122)
    alone = replace(together, draws=500)
    folder: Path = tmp_path_factory.mktemp("fits")
    tests = {
        "curve": ([curve], alone),
        "table": ([table], alone),
        "both": ([curve, table], together),
    }
    return {
        name: fit(own, priors, out=folder / name, options=options)
        for name, (own, options) in tests.items()
    }


def draws_of(one: Fit, test: str, name: str) -> np.ndarray:
    return np.log(all_draws(one[test].posterior["posterior"].to_dataset()[name]))


def test_they_agree_with_the_truth_of_both(fits: dict[str, Fit]) -> None:
    assert [check.sentence for check in fits["both"].checks() if not check.passed] == []
    for name, part in fits["both"].tests().items():
        truth = part.experiment.true_parameters
        assert truth is not None
        free = [one for one in part.priors.free if truth[one] != 0]
        inside = []
        for parameter in free:
            draws = all_draws(part.posterior["posterior"].to_dataset()[parameter])
            low, high = np.quantile(draws, (0.025, 0.975))
            inside.append(low < truth[parameter] < high)
        assert sum(inside) >= len(inside) - 1, name


def test_together_they_say_more_than_each_alone(fits: dict[str, Fit]) -> None:
    for name in SHARED:
        together = draws_of(fits["both"], CURVE, name).std()
        np.testing.assert_array_equal(
            draws_of(fits["both"], CURVE, name), draws_of(fits["both"], TABLE, name)
        )
        for alone, test in (("curve", CURVE), ("table", TABLE)):
            assert together < 1.1 * draws_of(fits[alone], test, name).std(), (name, alone)
    # The curve alone says next to nothing of the Kelvin part.
    assert draws_of(fits["both"], CURVE, "kelvin_modulus").std() < 0.2 * (
        draws_of(fits["curve"], CURVE, "kelvin_modulus").std()
    )

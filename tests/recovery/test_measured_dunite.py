"""Full fits: measured tests are described."""

from pathlib import Path

import pytest
from conftest import DUNITE

from pyburgers.checks.fit_checks import coverage
from pyburgers.fitting.fit import Fit, fit
from pyburgers.model.priors import default_priors
from pyburgers.protocols.constant_rate.experiment import load_constant_rate
from pyburgers.sampling.options import SamplerOptions

pytestmark = pytest.mark.slow

OPTIONS = SamplerOptions(draws=2000, seed=20261120)


def failed(result: Fit) -> dict[str, str]:
    """Sentences of the checks that failed, by name."""
    return {check.name: check.sentence for check in result.checks() if not check.passed}


@pytest.mark.parametrize("name", ["dunite_4506", "dunite_4581"])
def test_a_measured_dunite_test_is_described(name: str, tmp_path: Path) -> None:
    experiment = load_constant_rate(DUNITE / f"{name}.toml")
    result = fit(experiment, default_priors("dunite"), out=tmp_path / "run", options=OPTIONS)
    table = result.summary()
    for parameter, factor in {"stress_exponent": 1.0, "stress_noise": 1e-6}.items():
        mean, sd = (table[column][parameter] * factor for column in ("mean", "sd"))
        print(f"{name}: {parameter} {mean:.3f} +- {sd:.3f}")
    print(f"{name}: {coverage(result.posterior):.1%} of the points inside the 90 % band")
    assert failed(result) == {}
    assert 2.0 < table["mean"]["stress_exponent"] < 6.0
    assert table["mean"]["stress_noise"] < 0.1 * abs(experiment.stress).max()

"""Joint fits find a common flow law again, and are fits of single tests where nothing is pooled."""

from collections.abc import Callable
from pathlib import Path

import arviz as az
import numpy as np
import pytest
import xarray as xr
from common_flow_law import COMMON, NAMES, with_common_flow_law
from conftest import DUNITE

from pyburgers.checks.discrepancies import LEVEL
from pyburgers.checks.fit_checks import CheckKind
from pyburgers.common.draws import all_draws
from pyburgers.fitting.fit import Fit, fit
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.model.priors import default_priors
from pyburgers.posterior.labelled_draws import free_parameters
from pyburgers.sampling.options import SamplerOptions

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("programs")]

OPTIONS = SamplerOptions(seed=20261120)
RecordProperty = Callable[[str, object], None]


@pytest.fixture(scope="module")
def experiments() -> list[ConstantRateExperiment]:
    return [with_common_flow_law(name) for name in NAMES]


@pytest.fixture(scope="module")
def single_fits(
    experiments: list[ConstantRateExperiment], tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Fit]:
    folder = tmp_path_factory.mktemp("single")
    return {
        experiment.id: fit(
            experiment, default_priors("ice"), out=folder / experiment.id, options=OPTIONS
        )
        for experiment in experiments
    }


def test_a_common_flow_law_is_recovered(
    experiments: list[ConstantRateExperiment],
    single_fits: dict[str, Fit],
    tmp_path: Path,
    record_property: RecordProperty,
) -> None:
    joint = fit(experiments, default_priors("ice"), out=tmp_path / "joint", options=OPTIONS)
    assert [check.sentence for check in joint.checks() if not check.passed] == []
    draws = joint.posterior["posterior"].to_dataset()
    assert set(joint.problem.shared) == set(COMMON)
    for name, truth in COMMON.items():
        below = float(np.mean(all_draws(draws[name]) < truth))
        print(f"{name}: {below:.3f} of the draws below the true value")
        assert 0.005 < below < 0.995, name
    alone = [float(f.posterior["posterior"]["stress_exponent"].std()) for f in single_fits.values()]
    ratio = float(draws["stress_exponent"].std()) / float(np.mean(alone))
    record_property("sd_ratio_of_stress_exponent", ratio)
    print(f"sd of n: joint over single {ratio:.3f}, single {alone}")
    assert ratio < 0.6


def test_measured_dunite_tests_have_a_common_flow_law(tmp_path: Path) -> None:
    """Three tests with two rate steps each; loading curves also hold the apparatus.

    What the model misses of each stays missed, and is told. Neighbouring residuals go together in
    all three (probabilities of 3e-5); straight lines through those behind a step are as steep in
    one of 500 to 600 replicates of two tests, which the check lets pass or not by the draws.
    """
    names = ("dunite_4580", "dunite_4469", "dunite_4581")
    joint = fit(
        [load_constant_rate(DUNITE / f"{name}.toml") for name in names],
        default_priors("dunite"),
        pool=dict.fromkeys(("maxwell_modulus", "kelvin_modulus", "kelvin_viscosity"), "separate"),
        out=tmp_path / "joint",
        options=SamplerOptions(chains=2, draws=1000, seed=5),
    )
    failed = {one.name: one for one in joint.checks() if not one.passed}
    assert {one.check.kind for one in failed.values()} == {CheckKind.DESCRIPTION}, failed
    trend = failed["residual trend"]
    assert set(trend.table["test"]) == set(names)
    assert trend.table["family_probability"].max() <= LEVEL
    table = joint.summary("SI")
    mean, sd = (float(table[column]["stress_exponent"]) for column in ("mean", "sd"))
    print(f"n {mean:.2f} +- {sd:.2f}")
    # The steps themselves: ln(ratio of rates)/ln(ratio of stresses) is 3.1 to 4.3.
    assert 3.1 < mean < 4.3


def moments(draws: xr.Dataset) -> dict[str, tuple[xr.Dataset, xr.Dataset]]:
    """Means and standard deviations, each with its Monte Carlo error."""
    over = ("chain", "draw")
    return {
        "mean": (draws.mean(over), az.mcse(draws, method="mean")),
        "sd": (draws.std(over), az.mcse(draws, method="sd")),
    }


def test_nothing_pooled_gives_the_single_fits(
    experiments: list[ConstantRateExperiment], single_fits: dict[str, Fit], tmp_path: Path
) -> None:
    joint = fit(
        [experiments[0], experiments[2]],
        default_priors("ice"),
        pool={"all": "separate"},
        out=tmp_path / "joint",
        options=OPTIONS,
    )
    assert [check.sentence for check in joint.checks() if not check.passed] == []
    largest = 0.0
    for name, apart in joint.tests().items():
        names = free_parameters(single_fits[name].posterior)
        ours, single = (
            moments(f.posterior["posterior"].to_dataset()[names])
            for f in (apart, single_fits[name])
        )
        for what, (value, error) in single.items():
            for quantity in names:
                difference = float(ours[what][0][quantity] - value[quantity])
                scale = float(np.hypot(ours[what][1][quantity], error[quantity]))
                largest = max(largest, abs(difference) / scale)
                # 52 comparisons: 4 errors are passed by chance once in 300 runs.
                assert abs(difference) < 4 * scale, (name, what, quantity, difference / scale)
    print(f"largest difference: {largest:.2f} Monte Carlo errors")

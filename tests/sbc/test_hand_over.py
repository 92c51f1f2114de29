"""Calibration of what a table of peak stresses hands on: its simulated tables, and its ranks."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import NoReturn

import numpy as np
import pytest
import simulated_tables
from conftest import ICE
from simulated_tables import rank_curve, rank_hand_over, simulate_table

from pyburgers.common.errors import SamplingError
from pyburgers.flow_law_tables import softening
from pyburgers.flow_law_tables.laws import SCATTER, RateLaw, rate_law
from pyburgers.flow_law_tables.softening import simulate_peaks, softening_prior
from pyburgers.flow_law_tables.table_files import load_rate_table
from pyburgers.flow_law_tables.tables import RateTable, without_test
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.problem import Problem
from pyburgers.model.flow_law_prior import PRIOR_QUANTITIES, Conditions, FlowLawPrior
from pyburgers.model.prior_families import Prior
from pyburgers.model.priors import default_priors
from pyburgers.sampling.options import SamplerOptions
from pyburgers.sampling.run_directory import RunDirectory
from pyburgers.sbc.data_sets import DataSetPlan, Simulated, calibration_priors
from pyburgers.sbc.rank_uniformity import judge_ranks, rank_bands
from pyburgers.sbc.replication import Replication

pytestmark = pytest.mark.usefixtures("programs")

N_RANKED = 99
PLAN = DataSetPlan(n_ranked=N_RANKED)


def template() -> RateTable:
    return load_rate_table(ICE / "rates" / "qi_goldsby_2021.toml")


def law_with_scatter(scale: float) -> RateLaw:
    prior = Prior.of_family(SCATTER, "half_normal", {"scale": scale}, unit="1", source="test")
    weak = rate_law("ice_flow_law")
    priors = MappingProxyType({**weak.priors.priors, SCATTER: prior})
    return replace(weak, priors=replace(weak.priors, priors=priors))


def test_a_simulated_table_has_the_peaks_of_its_material() -> None:
    table = simulate_table(template(), law_with_scatter(1e-6), default_priors("ice"), seed=4)
    data = table.data
    peaks = simulate_peaks(
        "ice",
        [table.values],
        strain_rate=data.strain_rate,
        grain_size=data.grain_size,
        temperature=data.temperature,
    )
    np.testing.assert_allclose(np.log(data.stress), peaks.log_stress[0], atol=1e-5)
    assert data.provenance.kind == "synthetic"
    stated = data.peak_strain
    assert stated is not None
    assert abs(np.log(stated.mean / np.exp(np.mean(np.log(peaks.strain))))) < 4 / 3
    law = FlowLawPrior(
        PRIOR_QUANTITIES, np.zeros(4), np.eye(4), Conditions(263.0, 7e6, 3e-4), "ice", "test"
    )
    truth = table.truth(law)
    assert truth[0] == table.values["stress_exponent"]
    assert truth[2] == pytest.approx(float(law.log_flow_rate(table.values)), abs=1e-4)
    again = simulate_table(template(), law_with_scatter(1e-6), default_priors("ice"), seed=4)
    np.testing.assert_array_equal(again.data.stress, data.stress)


def test_the_truth_is_none_of_the_materials_that_the_prior_is_simulated_with(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    curve = default_priors("ice")
    table = simulate_table(template(), law_with_scatter(0.4), curve, seed=4)
    simulated: list[Mapping[str, float]] = []

    def simulate_nothing(
        material: str, values: Sequence[Mapping[str, float]], **_: object
    ) -> NoReturn:
        simulated.extend(values)
        raise SamplingError("simulated")

    monkeypatch.setattr(softening, "simulate_peaks", simulate_nothing)
    with pytest.raises(SamplingError, match="simulated"):
        softening_prior(table.data, curve, seed=4)
    for name in curve.free:
        assert table.values[name] not in {one[name] for one in simulated}


def test_priors_that_never_look_like_the_table_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulated_tables, "PRIOR_ATTEMPTS", 3)
    far = replace(template(), stress=1e4 * template().stress)
    with pytest.raises(SamplingError, match="none of 3 draws from the priors has stresses like"):
        simulate_table(far, law_with_scatter(0.4), default_priors("ice"), seed=1)


def handed_on(data: RateTable) -> FlowLawPrior:
    mean = np.array([3.8, 0.5, -9.0, -7.29e-4])
    covariance = np.diag([0.2, 0.1, 0.3, 1e-6]) ** 2
    return FlowLawPrior(
        PRIOR_QUANTITIES, mean, covariance, data.mean_conditions, "ice", "test", data.tests
    )


def test_the_curve_is_of_the_material_of_its_table_but_for_the_scatter(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    curve = load_constant_rate(ICE / "PIL40.toml")
    data = without_test(template(), curve)
    table = simulate_table(data, law_with_scatter(0.4), default_priors("ice"), seed=4)
    law = handed_on(data)
    fitted: list[Simulated] = []

    def fit_and_rank(
        simulated: Simulated, template: Problem, out: Path, **_: object
    ) -> Replication:
        fitted.append(simulated)
        return Replication(seed=4, n_draws=N_RANKED, n_unsolvable=0)

    monkeypatch.setattr(simulated_tables, "fit_and_rank", fit_and_rank)
    for _ in range(2):
        rank_curve(
            table,
            law,
            curve,
            calibration_priors("ice"),
            tmp_path,
            seed=4,
            plan=PLAN,
        )
    (one,) = fitted[0].problem.experiments
    assert one.provenance.kind == "synthetic"
    assert fitted[0].problem.priors[0].flow_law == law
    values = one.true_parameters
    assert values is not None
    changed = {name for name in values if values[name] != table.values[name]}
    assert changed == {"activation_enthalpy", "stress_noise"}
    above = law.log_flow_rate(values) - law.log_flow_rate(table.values)
    assert above == pytest.approx(table.offset, abs=1e-9)
    np.testing.assert_array_equal(one.response, fitted[1].problem.experiments[0].response)


def test_a_table_that_was_not_sampled_well_is_fitted_longer_and_not_ranked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a softening from few materials, which hardly changes how tables sample."""
    few = {"N_MATERIALS": 30, "N_CANDIDATES": 200, "LEAST_MATERIALS": 5}
    for name, number in few.items():
        monkeypatch.setattr(softening, name, number)
    ranked = rank_hand_over(
        template(),
        law_with_scatter(0.4),
        default_priors("ice"),
        tmp_path,
        seed=1,
        plan=replace(PLAN, sampler=SamplerOptions(chains=1, warmup=100, draws=25, adapt_delta=0.9)),
    )
    assert ranked.n_refits == 1
    assert "effective sample size" in ranked.failed_checks
    assert ranked.ranks == {}
    manifests = [RunDirectory(tmp_path / f"table_{k}").read_manifest() for k in range(2)]
    assert [one["sampler"]["draws"] for one in manifests] == [25, 100]


@pytest.mark.slow
def test_the_law_of_one_more_test_ranks_uniformly(tmp_path: Path) -> None:
    options = SamplerOptions(chains=4, warmup=1000, draws=1000, adapt_delta=0.99)
    found = [
        rank_hand_over(
            template(),
            law_with_scatter(0.4),
            default_priors("ice"),
            tmp_path / str(seed),
            seed=seed,
            plan=replace(PLAN, sampler=options),
        )
        for seed in range(501, 529)
    ]
    ranked = [one.ranks for one in found if one.ranks]
    assert len(ranked) > 0.9 * len(found)
    ranks = {name: [one[name] for one in ranked] for name in PRIOR_QUANTITIES}
    verdicts = judge_ranks(ranks, rank_bands(len(ranked), N_RANKED, len(ranks)))
    assert {v.verdict for v in verdicts.values()} <= {"calibrated", "within chance"}

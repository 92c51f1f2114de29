"""Stretched coordinates of tables of attenuation: the same posterior, and as wide as they say."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from conftest import ICE, with_fixed
from log_density import program_with
from stan_data import one_test_data
from truth_as_mode import at_truth

from pyburgers.cmdstan.program import Density, load_program
from pyburgers.common.array_types import FloatArray
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.attenuation.files import load_attenuation
from pyburgers.kinds.attenuation.likelihood import WIDE, StretchedChart, StretchedReference
from pyburgers.kinds.likelihood import AtMode, ChartUnsuited, likelihoods
from pyburgers.kinds.problem import problem_of
from pyburgers.kinds.program_data import chart_block, program_data
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.pooling import pooling_of
from pyburgers.model.priors import PriorSet, default_priors
from pyburgers.model.variants import with_variant
from pyburgers.sbc.data_sets import simulate_from_prior

pytestmark = pytest.mark.usefixtures("programs")

TABLE = ICE.parent / "olivine" / "attenuation_A1802.toml"
PROGRAM = likelihoods()["attenuation"].program
LAWS = ("linear", "extended", "extended_peak", "andrade")


def priors_of(law: str) -> PriorSet:
    test = load_attenuation(TABLE)
    return with_variant(default_priors(test.material, test.protocol), test, {"kelvin": law})


def simulated(law: str, seed: int = 1, **fixed: float) -> AtMode[AttenuationExperiment]:
    """A table like the measured one at a draw of the prior, with that draw for its mode."""
    template = problem_of([load_attenuation(TABLE)], with_fixed(priors_of(law), fixed))
    problem = simulate_from_prior(template, seed=seed).problem
    (test,), (priors,) = problem.experiments, problem.priors
    assert isinstance(test, AttenuationExperiment)
    return at_truth(test, priors, SolverOptions())


@cache
def set_up(
    law: str, seed: int = 1
) -> tuple[AtMode[AttenuationExperiment], StretchedReference, FloatArray]:
    """A simulated table, its stretched coordinates, and those of its draw: seconds of work."""
    test = simulated(law, seed)
    return test, *StretchedChart().reference(test)


@pytest.mark.parametrize("law", LAWS)
def test_there_and_back(law: str, tmp_path: Path) -> None:
    """Far into the flow rates that nothing sees, and those that the dashpot alone would explain."""
    test, reference, centre = set_up(law)
    flow = test.coordinates.parameters.index(str(test.coordinates.replaced_parameter))
    data = one_test_data(test.experiment, test.priors, solver=SolverOptions(), reference=reference)
    program = program_with(PROGRAM, data, tmp_path)
    rng = np.random.default_rng(3)
    for place in (-6.0, -1.0, 0.3, 2.0, 40.0):
        point = centre + 0.3 * rng.standard_normal(centre.size)
        point[flow] = place
        columns = program.values_at(point)
        back = [columns[f"stretched_coordinate.{k + 1}"] for k in range(centre.size)]
        np.testing.assert_allclose(back, point, rtol=1e-8, atol=1e-8)
        log_rate = columns["log_reference.1"] - reference.log_seen_rate
        assert np.exp(log_rate) + log_rate / reference.log_width == pytest.approx(place, rel=1e-8)


@pytest.mark.parametrize("scatter", [0.01, 0.1])
def test_coordinates_are_as_wide_with_a_dashpot_as_without(scatter: float) -> None:
    """Precise tables fix some plain coordinates to a thousandth, and E_K gives for the dashpot."""
    test = simulated("linear", attenuation_scatter=scatter, modulus_scatter=0.1 * scatter)
    reference, centre = StretchedChart().reference(test)
    flow = test.coordinates.parameters.index(str(test.coordinates.replaced_parameter))
    data = one_test_data(test.experiment, test.priors, solver=SolverOptions(), reference=reference)
    for place in (-2.0, 0.0, 1.5):
        at = centre.copy()
        at[flow] = place
        widths = np.sqrt(np.diag(Density(load_program(PROGRAM), data).laplace(at)))
        others = np.delete(widths, flow)
        assert others.min() > 0.5
        assert others.max() < 2.0


def test_a_prior_without_curvature_leaves_the_flow_rate_a_wide_range() -> None:
    test, reference, centre = set_up("linear")
    upwards = -np.eye(centre.size)
    wide, _ = StretchedChart().reference(replace(test, curvature=lambda **_: upwards))
    assert reference.log_width != WIDE
    assert wide.log_width == WIDE


def test_the_density_of_two_tables_is_that_in_plain_coordinates(tmp_path: Path) -> None:
    """Less the logarithms of the Jacobians, at the same parameters."""
    tests, references, _ = zip(*(set_up("extended", seed) for seed in (1, 2)), strict=True)
    problem = problem_of(
        [test.experiment for test in tests],
        priors_of("extended"),
        pooling_of({"all": "shared", "kelvin_viscosity": "separate", "beta": "separate"}),
    )
    data = program_data(problem, solver=SolverOptions())
    stretched = program_with(
        PROGRAM, {**data, **chart_block(problem, references)}, tmp_path / "stretched"
    )
    plain = program_with(PROGRAM, data, tmp_path / "plain")
    layout = problem.layout
    point = 0.5 * np.random.default_rng(4).standard_normal(layout.size)
    there = stretched.columns_at({"coordinate": point.tolist()})
    own = np.concatenate([layout.position[e, own] for e, own in enumerate(layout.own)])
    same = np.empty(layout.size)
    same[own] = [there[f"plain_coordinate.{k + 1}"] for k in range(own.size)]
    here = plain.columns_at({"coordinate": same.tolist()})
    for name in (n for n in there if n.startswith(("parameter.", "log_lik."))):
        assert here[name] == pytest.approx(there[name], rel=1e-9, abs=1e-9)
    assert here["lp__"] - here["log_jacobian"] == pytest.approx(
        there["lp__"] - there["log_jacobian"], rel=1e-9
    )


def test_a_flow_rate_that_is_given_keeps_plain_coordinates() -> None:
    test = simulated("linear", activation_enthalpy=430e3, beta=-7.85e-5)
    with pytest.raises(ChartUnsuited, match="flow rate"):
        StretchedChart().reference(test)

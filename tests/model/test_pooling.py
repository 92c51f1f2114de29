"""How tests of a joint fit hang together: defaults, options, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import ICE, with_fixed

from pyburgers.common.errors import InputError
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.kind import load_experiment
from pyburgers.kinds.problem import Problem, problem_of
from pyburgers.model.parameters import CONSTANTS, MATERIAL_PARAMETERS
from pyburgers.model.pooling import (
    DEFAULT_KINDS,
    DEFAULT_SPREAD_SCALE,
    parse_pooling,
    pooling_from,
    pooling_of,
)
from pyburgers.model.priors import default_priors


def twins() -> list[Experiment]:
    return [load_constant_rate(ICE / f"{name}.toml") for name in ("PIL40", "PIL72", "PIL105")]


def problem(**pool: str) -> Problem:
    return problem_of(twins(), default_priors("ice"), pooling_of(pool))


def test_every_parameter_has_a_default() -> None:
    assert set(DEFAULT_KINDS) == {p.name for p in MATERIAL_PARAMETERS} - CONSTANTS


def test_options_change_what_they_name() -> None:
    pool = parse_pooling(["all=separate", "stress_exponent=shared", "beta=partial:0.2"])
    pooling = pooling_of(pool)
    assert pooling.kinds["stress_exponent"] == "shared"
    assert pooling.kinds["maxwell_modulus"] == "separate"
    assert pooling.spread_scales == {"beta": 0.2}
    assert pooling_of().spread_scales == {"steady_state_grain_size": DEFAULT_SPREAD_SCALE}
    assert pooling_from(pooling.record()) == pooling


@pytest.mark.parametrize("kind", ["separate", "partial"])
def test_tests_with_their_own_elastic_moduli_have_their_own_strength_over_them(kind: str) -> None:
    own = {"maxwell_modulus": kind}
    assert pooling_of().kinds["peak_strength"] == "shared"
    assert pooling_of(own).kinds["peak_strength"] == "separate"
    for said in ({"peak_strength": "shared"}, {"all": "shared"}):
        assert pooling_of(own | said).kinds["peak_strength"] == "shared"


def test_shared_coordinates_stand_once() -> None:
    joint = problem()
    layout = joint.layout
    # 7 shared, 5 of each test, a centre and a spread.
    assert layout.size == 7 + 3 * 5 + 2
    i = layout.names.index("stress_exponent")
    assert len(set(layout.position[:, i])) == 1
    own = layout.position[:, layout.names.index("stress_noise")]
    assert len(set(own)) == 3
    assert problem(all="separate").layout.size == 36


def test_noise_prior_is_that_of_the_test_unless_it_is_shared() -> None:
    largest = [experiment.largest_stress for experiment in twins()]
    scales = [priors["stress_noise"].scale for priors in problem().priors]
    assert scales == pytest.approx([0.05 * stress for stress in largest])
    shared = [priors["stress_noise"].scale for priors in problem(stress_noise="shared").priors]
    assert shared == pytest.approx([0.05 * max(largest)] * 3)


def test_unsuited_tests_are_refused() -> None:
    first, second, _ = twins()
    priors, pooling = default_priors("ice"), pooling_of()
    with pytest.raises(InputError, match="stands 2 times"):
        problem_of([first, first], priors, pooling)
    with pytest.raises(InputError, match="of one material"):
        problem_of([first, replace(second, material="olivine")], priors, pooling)
    empty = replace(load_constant_rate(ICE / "PIL72.toml"), strain=np.empty(0), stress=np.empty(0))
    with pytest.raises(InputError, match="has no data"):
        problem_of([first, empty], priors, pooling)
    oscillating = load_experiment(ICE.parent / "olivine" / "olivine_twin.toml")
    with pytest.raises(InputError, match="cannot be fitted together with tests of other protocols"):
        problem_of([first, oscillating], priors, pooling)


def test_what_the_reference_stress_replaces_cannot_be_partially_pooled() -> None:
    with pytest.raises(InputError, match="activation_enthalpy=partial"):
        problem(activation_enthalpy="partial")
    priors = with_fixed(default_priors("ice"), {"activation_enthalpy": 65e3, "beta": -7.29e-4})
    problem_of(twins(), priors, pooling_of({"activation_enthalpy": "partial"}))

"""Tables name the fixed parameters that a fit depends on, and no others."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from pyburgers.kinds.kind import load_experiment
from pyburgers.kinds.problem import problem_of
from pyburgers.kinds.program_data import fixed_in_effect
from pyburgers.kinds.together import default_priors_for
from pyburgers.model.parameters import PIEZOMETER
from pyburgers.model.variants import with_variant

DATA = Path(__file__).parents[2] / "data"


def _named(file: str, choices: dict[str, str]) -> set[str]:
    experiment = load_experiment(DATA / file)
    priors = with_variant(default_priors_for([experiment]), experiment, choices)
    (resolved,) = problem_of([experiment], priors).priors
    fit = SimpleNamespace(experiment=experiment, priors=resolved)
    return {prior.parameter for prior in fixed_in_effect(fit)}


@pytest.mark.parametrize(
    ("file", "choices", "expected"),
    [
        ("dunite/dunite_4506.toml", {}, set()),
        ("dunite/dunite_4506.toml", {"grain_size": "constant", "fabric": "constant"}, set()),
        ("dunite/dunite_4506.toml", {"grain_size": "piezometric"}, set(PIEZOMETER)),
        ("olivine/olivine_twin.toml", {}, set(PIEZOMETER)),
        ("halite/halite_z3.toml", {"residuals": "independent"}, set()),
    ],
)
def test_only_what_a_fit_depends_on_is_named(
    file: str, choices: dict[str, str], expected: set[str]
) -> None:
    assert _named(file, choices) == expected

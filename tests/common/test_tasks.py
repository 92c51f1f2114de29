"""Who does tasks: parts are all tasks once, and any executor does them."""

import pickle
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import MappingProxyType

import pytest
from conftest import ICE

from pyburgers.common.errors import InputError
from pyburgers.common.tasks import Workers
from pyburgers.model.priors import default_priors
from pyburgers.protocols.problem import problem_of
from pyburgers.protocols.program_data import program_data
from pyburgers.protocols.protocol import load_experiment


@pytest.mark.parametrize("number", [1, 2, 3, 7])
def test_parts_are_all_tasks_once_and_about_as_many_each(number: int) -> None:
    tasks = {name: name.upper() for name in "abcde"}
    parts = [Workers(part=(which, number)).mine(tasks) for which in range(1, number + 1)]
    assert sorted(key for part in parts for key in part) == sorted(tasks)
    assert {key: value for part in parts for key, value in part.items()} == tasks
    assert max(map(len, parts)) - min(map(len, parts)) <= 1
    assert Workers().mine(tasks) == tasks


@pytest.mark.parametrize("part", [(0, 2), (3, 2), (1, 0)])
def test_parts_that_there_are_not_are_refused(part: tuple[int, int]) -> None:
    with pytest.raises(InputError, match="part is"):
        Workers(part=part)


def test_an_executor_that_is_given_does_the_calls_and_stays_open() -> None:
    with ThreadPoolExecutor(2) as pool:
        workers = Workers(pool)
        for _ in range(2):
            done = workers.completed(pow, {n: (n, 2) for n in range(5)}, folder=Path("out"))
            assert dict(done) == {n: n * n for n in range(5)}


def test_a_call_that_raises_ends_those_that_wait() -> None:
    with ThreadPoolExecutor(1) as pool:
        calls = {0: ("x",), **{n: (n,) for n in range(1, 4)}}
        with pytest.raises(ValueError, match="invalid literal"):
            list(Workers(pool).completed(int, calls, folder=Path("out")))
        assert pool.submit(int, "7").result() == 7


def test_what_is_fitted_travels_between_processes() -> None:
    problem = problem_of([load_experiment(ICE / "PIL40.toml")], default_priors("ice"))
    again = pickle.loads(pickle.dumps(problem))
    assert again.given_priors == problem.given_priors
    assert isinstance(again.given_priors.priors, MappingProxyType)
    solver = problem.protocol.solver
    assert program_data(again, solver=solver) == program_data(problem, solver=solver)

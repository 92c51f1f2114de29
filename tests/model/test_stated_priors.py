"""Priors that are stated in Python are those of a prior file."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy import stats

import pyburgers
from pyburgers.common.errors import InputError
from pyburgers.model.prior_families import PriorTable
from pyburgers.model.priors import load_priors, save_priors

STATED: dict[str, tuple[PriorTable, Any]] = {
    "activation_enthalpy": (
        pyburgers.normal(60, 5, "kJ/mol"),
        stats.norm(60e3, 5e3),
    ),
    "kelvin_viscosity": (
        pyburgers.lognormal(50, 0.3, "GPa s", source="a guess"),
        stats.lognorm(0.3, scale=50e9),
    ),
    "maxwell_modulus": (pyburgers.uniform(1, 3, "GPa"), stats.uniform(1e9, 2e9)),
    "stress_noise": (pyburgers.half_normal(0.1, "MPa"), stats.halfnorm(0, 0.1e6)),
    "kelvin_modulus": (
        pyburgers.normal(4, 2, "GPa", lower=0),
        stats.truncnorm(-2, np.inf, 4e9, 2e9),
    ),
}


@pytest.mark.parametrize("name", STATED)
def test_a_stated_prior_takes_the_place_of_one(name: str) -> None:
    before = pyburgers.priors("ice")
    table, law = STATED[name]
    priors = before.with_(**{name: table})
    at = [0.1, 0.5, 0.9]
    np.testing.assert_allclose(priors[name].distribution().ppf(at), law.ppf(at), rtol=1e-12)
    assert {n: one for n, one in priors.priors.items() if n != name} == {
        n: one for n, one in before.priors.items() if n != name
    }


def test_stated_priors_are_those_that_a_file_keeps(tmp_path: Path) -> None:
    tables = {name: table for name, (table, _) in STATED.items()}
    priors = pyburgers.priors("ice").with_(**tables, beta=pyburgers.fixed(-7e-4, "mol/J"))
    save_priors(priors, tmp_path / "priors.toml")
    assert load_priors(tmp_path / "priors.toml") == priors
    assert "beta" not in priors.free
    assert priors["kelvin_viscosity"].source == "a guess"


@pytest.mark.parametrize(
    ("state", "words"),
    [
        (
            lambda: {"activation_enthalp": pyburgers.normal(1, 1, "1")},
            "did you mean 'activation_enthalpy'",
        ),
        (lambda: {"beta": pyburgers.normal(1, 1, "GPa")}, "unit 'GPa' is not a unit of inverse"),
        (lambda: {"beta": pyburgers.normal(1, -1, "mol/J")}, "normal: key 'scale': found -1"),
        (
            lambda: {"maxwell_modulus": pyburgers.normal(4, 0.05, "GPa", lower=6.5)},
            "hold 0 of the mass of a normal with mean 4e.09 and standard deviation 5e.07",
        ),
    ],
)
def test_a_prior_that_no_file_may_hold_is_refused(
    state: Callable[[], dict[str, PriorTable]], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        pyburgers.priors("ice").with_(**state())


def test_a_prior_in_memory_is_checked_as_one_of_a_file() -> None:
    ice = pyburgers.priors("ice")

    def prior(name: str, **numbers: float) -> pyburgers.Prior:
        return pyburgers.Prior.of_family(name, "normal", numbers, unit="1", source="mine")

    for name, location, scale, words in (
        ("stress_exponant", 3.0, 1.0, "did you mean 'stress_exponent'"),
        ("stress_exponent", 3.0, 1.0, "found no lower bound"),
        ("activation_enthalpy", 6e4, -1.0, "key 'scale': found -1"),
        ("beta", 7e-4, 1e-6, "expected a negative value"),
        ("kelvin_activation_enthalpy", 6e4, 1e3, "found no lower bound"),
    ):
        with pytest.raises(InputError, match=words):
            ice.exchanging(prior(name, location=location, scale=scale))
    with pytest.raises(InputError, match="key 'scale' is missing"):
        prior("beta", location=-7e-4)
    with pytest.raises(InputError, match="unknown family 'gamma'"):
        pyburgers.Prior.of_family("beta", "gamma", {}, unit="1", source="x")  # type: ignore[arg-type]


def test_a_title_says_which_priors_were_changed() -> None:
    ice = pyburgers.priors("ice")
    changed = ice.with_(stress_exponent=pyburgers.fixed(3, "1"))
    assert changed.title == f"{ice.title}; changed: stress_exponent"


def test_priors_are_drawn_and_shown_in_a_line() -> None:
    priors = pyburgers.priors("ice")
    figure = priors.plot()
    assert isinstance(figure, Figure)
    drawn = [axes for axes in figure.axes if axes.lines]
    assert len(drawn) == len([n for n in priors.free if not priors[n].relative_to_max_stress])
    assert repr(priors) == f"<priors of ice: {priors.title}, 12 of 12 parameters free>"

"""Fits under neighbouring laws: which, the commands that make them, how far parameters move."""

import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from conftest import ICE, with_fixed
from synthetic_fit import make_fit, with_problem

from pyburgers.checks.fit_checks import CheckKind, Outcome
from pyburgers.checks.verdicts import Verdict
from pyburgers.comparison.conclusions import (
    parameter_shifts,
    shift_sentences,
    what_a_yes_leaves_open,
)
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.attenuation.files import load_attenuation
from pyburgers.model.neighbouring_laws import neighbouring_laws, redefined
from pyburgers.model.variants import ModelVariant, with_variant

FLOW_LAW = {"reference_stress", "reference_flow_rate", "stress_exponent", "beta"}


def described(outcome: Outcome) -> dict[CheckKind, Verdict]:
    return {CheckKind.DESCRIPTION: Verdict(CheckKind.DESCRIPTION, outcome, "")}


def test_neighbours_are_laws_that_the_kind_of_test_can_have(small_fit: Fit) -> None:
    experiment = small_fit.experiment
    assert neighbouring_laws(ModelVariant(), experiment) == (
        "kelvin=power_law",
        "kelvin=andrade",
        "maxwell=hyperbolic_sine",
    )
    table = load_attenuation(ICE / "attenuation_twin.toml")
    assert neighbouring_laws(ModelVariant(), experiment, table) == (
        "kelvin=andrade",
        "kelvin=two_elements",
        "maxwell=hyperbolic_sine",
    )
    other = ModelVariant(kelvin="power_law", maxwell="hyperbolic_sine")
    assert neighbouring_laws(other, experiment) == ("kelvin=linear", "maxwell=power_law")


def test_a_yes_says_what_it_does_not_exclude_and_how_to_see(
    small_fit: Fit, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Fit, "verdicts", lambda _: described(Outcome.YES))
    sentence, make, compare = what_a_yes_leaves_open(small_fit)
    assert "does not exclude kelvin=power_law, kelvin=andrade, maxwell=hyperbolic_sine:" in sentence
    assert "outside of the intervals of this fit" in sentence
    words = shlex.split(make)
    assert words[:2] == ["pyburgers", "fit"]
    assert all(Path(words[k]).is_file() for k in (2, words.index("--priors") + 1))
    assert words[words.index("--variant") + 1] == "kelvin=power_law"
    run = str(small_fit.directory.path)
    assert shlex.split(compare)[2:] == [run, words[words.index("--out") + 1]]


@pytest.mark.parametrize("outcome", [Outcome.NO, Outcome.CANNOT_TELL])
def test_nothing_is_left_open_without_a_yes(
    outcome: Outcome, small_fit: Fit, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Fit, "verdicts", lambda _: described(outcome))
    assert what_a_yes_leaves_open(small_fit) == ()


@pytest.mark.parametrize(
    ("laws", "expected"),
    [
        ({"residuals": "autocorrelated", "fabric": "constant"}, set()),
        ({"residuals": "discrepancy"}, {"stress_noise", "strain_noise"}),
        ({"kelvin": "power_law"}, {"kelvin_viscosity"}),
        ({"kelvin": "andrade"}, {"kelvin_viscosity", "kelvin_modulus"}),
        ({"maxwell": "threshold_stress"}, FLOW_LAW),
        ({"maxwell": "hyperbolic_sine"}, FLOW_LAW),
        ({"hardening": "backstress"}, FLOW_LAW),
        ({"hardening": "dislocations"}, FLOW_LAW | {"recovery_rate"}),
    ],
)
def test_quantities_of_another_law_may_mean_something_else(
    laws: dict[str, Any], expected: set[str]
) -> None:
    other = replace(ModelVariant(), **laws)
    assert redefined(ModelVariant(), other) == redefined(other, ModelVariant()) == expected
    assert not redefined(other, replace(other, grain_size="constant"))


def test_only_what_means_the_same_moves(tmp_path: Path) -> None:
    one, like = (make_fit(tmp_path / name, chains=2, draws=100) for name in ("one", "other"))
    priors = with_variant(like.priors, like.experiment, {"maxwell": "threshold_stress"})
    other = with_problem(like, like.experiment, priors)
    assert "reference_stress" in parameter_shifts({"one": one, "like": like}).index
    moved = parameter_shifts({"one": one, "other": other}).index
    assert not FLOW_LAW & {*moved}
    assert "maxwell_modulus" in moved


def test_noises_beside_a_discrepancy_do_not_move(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A joint fit names the test of its noise."""
    one, like = (make_fit(tmp_path / name, chains=2, draws=100) for name in ("one", "other"))
    priors = with_variant(like.priors, like.experiment, {"residuals": "discrepancy"})
    other = with_problem(like, like.experiment, priors)
    assert "stress_noise" in parameter_shifts({"one": one, "like": like}).index
    moved = parameter_shifts({"one": one, "other": other})
    assert "maxwell_modulus" in moved.index
    assert "stress_noise" not in moved.index
    assert "stress residual" not in " ".join(shift_sentences({"one": one, "other": other}))
    by_test = one.si_summary().rename({"stress_noise": "stress_noise[A]"})
    monkeypatch.setattr(Fit, "si_summary", lambda _: by_test)
    assert "stress_noise[A]" in parameter_shifts({"one": one, "like": like}).index
    assert "stress_noise[A]" not in parameter_shifts({"one": one, "other": other}).index


@pytest.mark.parametrize(
    ("exponents", "moves"),
    [((None, None), True), ((4.0, 4.0), True), ((None, 1.0), False), ((3.0, 4.0), False)],
)
def test_beta_moves_between_laws_of_one_unit(
    exponents: tuple[float | None, float | None], moves: bool, tmp_path: Path
) -> None:
    fits = {}
    for name, exponent in zip(("one", "other"), exponents, strict=True):
        fixed = {} if exponent is None else {"stress_exponent": exponent}
        fit = make_fit(tmp_path / name, chains=2, draws=100, fixed=tuple(fixed))
        priors = with_fixed(fit.priors, fixed)
        fits[name] = with_problem(fit, fit.experiment, priors)
    assert ("beta" in parameter_shifts(fits).index) is moves


def test_parameters_move_by_their_own_sd(small_fit: Fit, long_fit: Fit) -> None:
    table = parameter_shifts({"one": small_fit, "other": long_fit})
    one, other = small_fit.summary("SI"), long_fit.summary("SI")
    expected = (other["mean"] - one["mean"]) / one["sd"]
    assert table["other moved"].to_dict() == pytest.approx(expected[table.index].to_dict())
    (sentence,) = shift_sentences({"one": small_fit, "other": long_fit})
    assert sentence.startswith("From one to other parameters move by, in their sd: ")
    farthest = table["other moved"].abs().max()
    assert f"{farthest:.1f}" in sentence.split(",")[1]

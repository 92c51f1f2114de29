"""The section of the page about predicted tests."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from conftest import TESTS, Problem
from dunite_predictions import PREDICTED, predictions_section

from pyburgers.fitting.fit import Fit
from pyburgers.kinds.constant_rate.experiment import RateSegment
from pyburgers.kinds.forward import simulate_data


@pytest.mark.usefixtures("sketched")
def test_tests_that_were_not_fitted_are_scored_and_drawn(
    joint: Fit, small_problem: Problem
) -> None:
    template = replace(small_problem.experiment, id="slower", segments=(RateSegment(0.0, 2e-5),))
    truth = {name: float(draws.mean()) for name, draws in _draws(joint).items()}
    slower = simulate_data(template, truth, np.random.default_rng(4), source="a test")
    off = replace(slower, id="stronger", stress=1.5 * slower.stress)
    section = predictions_section(joint, [slower, off])
    (table,) = section.tables
    saved = table.saved.set_index(["test", "score"])
    assert saved["found"]["slower"]["coverage of the 90 % band"] > 0.7
    assert saved["found"]["stronger"]["coverage of the 90 % band"] < 0.1
    assert saved["share_below"]["stronger"].iloc[-1] == 0.0
    assert table.shown["test"].tolist() == 3 * ["slower"] + 3 * ["stronger"]
    inside, outside = section.paragraphs
    assert inside.startswith("slower: all scores of its ")
    assert "coverage of the 90 % band, log predictive density" in outside
    text = " ".join((*section.paragraphs, *section.details))
    assert "predicts slower and stronger" in text
    assert text.count("Beyond what was fitted: strain rate 2e-05") == 1
    for figure in section.figures:
        assert figure.draw().axes


@pytest.mark.parametrize("test", PREDICTED)
def test_the_document_has_the_scores_of_the_committed_page(test: str) -> None:
    """It went on to say that all is within what the draws expect after the page said otherwise."""
    saved = pd.read_csv(TESTS.parent / "reports/study/tables/predicted_tests_scores.csv")
    half, most, density = saved[saved["test"] == test].to_dict("records")
    row = (
        f"{100 * half['found']:.0f} % | {100 * most['found']:.0f} % "
        f"({100 * most['expected_q5']:.0f} to {100 * most['expected_q95']:.0f} %) | "
        f"{density['found']:.1f} ({density['expected_q5']:.1f} to {density['expected_q95']:.1f}) |"
    )
    text = (TESTS.parent / "docs/predict.md").read_text(encoding="utf-8")
    (told,) = [line for line in text.splitlines() if line.startswith(f"| `{test}`")]
    assert told.endswith(row)


def _draws(joint: Fit) -> dict[str, np.ndarray]:
    group = joint["PIL40"].posterior["posterior"].to_dataset()
    return {
        str(name): values.to_numpy()
        for name, values in group.items()
        if name in joint.problem.priors[0].priors
    }

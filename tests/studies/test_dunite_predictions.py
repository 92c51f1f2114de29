"""The section of the page about predicted tests."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import Problem

from pyburgers.fitting.fit import Fit
from pyburgers.protocols.constant_rate.experiment import RateSegment
from pyburgers.protocols.forward import simulate_data
from pyburgers.studies.dunite_predictions import predictions_section


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
    assert text.count("strain rate 2e-05") == 1 or "Beyond what was fitted" in text
    for figure in section.figures:
        assert figure.draw().axes


def _draws(joint: Fit) -> dict[str, np.ndarray]:
    group = joint["PIL40"].posterior["posterior"].to_dataset()
    return {
        str(name): values.to_numpy()
        for name, values in group.items()
        if name in joint.problem.priors[0].priors
    }

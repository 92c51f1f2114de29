"""Measured dunite predicted: what a fit of two tests says of tests that it has not seen."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import pandas as pd
from common import DATA

import pyburgers
from pyburgers import Experiment, Fit, PageFigure, PageSection, PageTable, Prediction

PREDICTED = ("dunite_4581", "dunite_4506")
"""Tests of other samples, with grains nine times as large: one with the slower rates, one hotter
or colder than each that is fitted."""

DRAWS = 1000
"""Of the joint fit, solved for each."""

PREDICTION_CAPTION = (
    "The response of a test that took no part in the fit: predictive median (line), the areas that "
    "hold 50 % and 90 % of solutions for single draws (dark and light blue), and the band that "
    "should hold 90 % of new readings, noise of the fit included (orange). Circles, where there "
    "are some, are the readings of the test."
)


def predicted_tests() -> tuple[Experiment, ...]:
    """Return the tests that are predicted."""
    return tuple(pyburgers.load_experiment(DATA / "dunite" / f"{name}.toml") for name in PREDICTED)


def predictions_section(joint: Fit, experiments: Sequence[Experiment]) -> PageSection:
    """Say how well a joint fit predicts tests with data that it has not seen."""
    predictions = {one.id: joint.predict(one, draws=DRAWS) for one in experiments}
    first = next(iter(predictions.values()))
    common = [
        caution
        for caution in first.cautions
        if all(caution in one.cautions for one in predictions.values())
    ]
    # Why it is not a yes stands where the page tells of the joint fit.
    verdicts = {one.sentence: f"{one.answer}." for one in joint.verdicts().values()}
    scores = {name: pyburgers.score_table(one) for name, one in predictions.items()}
    said = {name: pyburgers.score_sentence(one, scores[name]) for name, one in predictions.items()}
    table = pd.concat(scores)
    table.index.names = ["test", "score"]
    return PageSection(
        key="predicted_tests",
        title=f"Predicted before it is seen: {experiments[0].material}",
        paragraphs=tuple(
            f"{name}: {pyburgers.surprise_sentence(one, scores[name])}"
            for name, one in predictions.items()
        ),
        details=(
            f"The fit of {' and '.join(joint.manifest['experiments'])} together predicts "
            f"{' and '.join(predictions)}, which took no part in it, from {DRAWS} draws at most. "
            f"{' '.join(first.notes[:-1])}",
            *(verdicts.get(caution, caution) for caution in common),
            *(_assumed(one, common) for one in predictions.values()),
            "Readings of a test hang together: one truth made them all. What is expected of a "
            "score comes from tests that the draws themselves would give, scored alike; a "
            "share below of 0.00 or 1.00 says that hardly one of them looks like the measured one.",
        ),
        tables=(
            PageTable(
                "scores",
                "Scores of the predictions",
                _shown(table),
                table.reset_index(),
                words=("test", "score", "in 90 % of such tests"),
                folded=True,
            ),
        ),
        figures=tuple(
            PageFigure(
                f"prediction_{name}",
                f"{name}, predicted",
                PREDICTION_CAPTION,
                # What speaks against it stands in the text above.
                partial(pyburgers.prediction_figure, replace(one, cautions=())),
                said[name],
            )
            for name, one in predictions.items()
        ),
    )


def _assumed(prediction: Prediction, common: Sequence[str]) -> str:
    own = [caution for caution in prediction.cautions if caution not in common]
    return " ".join((f"{prediction.experiment.id}:", *own, prediction.notes[-1]))


def _shown(table: pd.DataFrame) -> pd.DataFrame:
    """Return scores of several tests as text."""
    text = table.map("{:.2f}".format).reset_index()
    return pd.DataFrame(
        {
            "test": text["test"],
            "score": text["score"],
            "found": text["found"],
            "expected": text["expected"],
            "in 90 % of such tests": text["expected_q5"] + " to " + text["expected_q95"],
            "share below": text["share_below"],
        }
    )

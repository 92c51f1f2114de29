"""Measured dunite predicted: what a fit of two tests says of tests that it has not seen."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import pandas as pd

from pyburgers.checks.verdicts import ANSWERS
from pyburgers.drawing.page_parts import PageFigure, PageSection, PageTable
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.prediction import Prediction
from pyburgers.predictions.other_test_figures import PREDICTION_CAPTION, prediction_figure
from pyburgers.predictions.other_tests import (
    score_sentence,
    score_table,
    surprise_sentence,
)
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.protocol import load_experiment

PREDICTED = ("dunite_4581", "dunite_4506")
"""Tests of other samples, with grains nine times as large: one with the slower rates, one hotter
or colder than each that is fitted."""

DRAWS = 1000
"""Of the joint fit, solved for each."""

KEY = "predicted_tests"


def predicted_tests(folder: Path) -> tuple[Experiment, ...]:
    """Return the tests that are predicted; `folder` is that of the shipped experiments."""
    return tuple(load_experiment(folder / f"{name}.toml") for name in PREDICTED)


def predictions_section(joint: Fit, experiments: Sequence[Experiment]) -> PageSection:
    """Say how well a joint fit predicts tests that it has not seen.

    Parameters
    ----------
    joint : Fit
        Of several tests.
    experiments : sequence of Experiment
        Others of the same material, with data.
    """
    predictions = {one.id: joint.predict(one, draws=DRAWS) for one in experiments}
    first = next(iter(predictions.values()))
    common = [
        caution
        for caution in first.cautions
        if all(caution in one.cautions for one in predictions.values())
    ]
    # Why it is not a yes stands where the page tells of the joint fit.
    verdicts = {
        one.sentence: f"{ANSWERS[one.kind][one.outcome]}." for one in joint.verdicts().values()
    }
    scores = {name: score_table(one) for name, one in predictions.items()}
    said = {name: score_sentence(one, scores[name]) for name, one in predictions.items()}
    table = pd.concat(scores)
    table.index.names = ["test", "score"]
    return PageSection(
        key=KEY,
        title=f"Predicted before it is seen: {experiments[0].material}",
        paragraphs=tuple(
            f"{name}: {surprise_sentence(one, scores[name])}" for name, one in predictions.items()
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
                partial(prediction_figure, replace(one, cautions=())),
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
    text: Mapping[str, list[str]] = {
        str(column): [f"{value:.2f}" for value in values] for column, values in table.items()
    }
    return pd.DataFrame(
        {
            "test": table.index.get_level_values("test"),
            "score": table.index.get_level_values("score"),
            "found": text["found"],
            "expected": text["expected"],
            "in 90 % of such tests": [
                f"{low} to {high}"
                for low, high in zip(text["expected_q5"], text["expected_q95"], strict=True)
            ],
            "share below": text["share_below"],
        }
    )

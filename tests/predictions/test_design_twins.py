"""The benchmark of designs on twins: its table, and where its new tests are read."""

import numpy as np
import pandas as pd
import pytest
from design_twins import FITS, PLAIN, PLAN, quantity_table, with_readings

from pyburgers.kinds.loading_history.experiment import HistoryExperiment


def test_table_compares_the_chosen_test_with_the_plain_one() -> None:
    row: dict[str, float] = {}
    for quantity in PLAN.about:
        for name, sd in zip(FITS, (1.0, 0.2, 0.8), strict=True):
            row |= {f"{name}.{quantity}.sd": sd, f"{name}.{quantity}.below": 0.5}
        row |= {f"chosen.{quantity}.expected": 0.25, f"plain.{quantity}.expected": 0.8}
    rows = pd.DataFrame([row, row])
    rows.loc[1, "chosen.stress_exponent.sd"] = 1.0
    rows.loc[1, "first.stress_exponent.below"] = 0.99
    n, other, _ = quantity_table(rows).to_dict("records")
    assert n["chosen is narrower"] == "1 of 2"
    assert n["chosen / plain"] == "0.75 (0.35 to 1.15)"
    assert n["first: truth in 90 %"] == "1 of 2"
    assert other["chosen is narrower"] == "2 of 2"
    assert other["chosen: reached / expected"] == "0.80 (0.80 to 0.80)"
    assert other["plain: reached / expected"] == "1.00 (1.00 to 1.00)"


@pytest.mark.parametrize("name", [PLAIN, "relaxation"])
def test_new_tests_have_the_readings_of_their_candidate(name: str) -> None:
    candidate = PLAN.candidates[name]
    test = with_readings(candidate)
    at_rest = name != PLAIN  # at its beginning, which no test reads
    assert test.n_points == candidate.n_readings - at_rest
    low, high = candidate.experiment.span
    assert test.position[0] >= low
    assert test.position[-1] == pytest.approx(high)
    if isinstance(test, HistoryExperiment):
        ends = np.array([stage.end_time for stage in test.stages])
        assert (test.time <= ends[test.reading_stage]).all()

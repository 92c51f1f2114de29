"""Several readings of one moment: their density does not depend on their order."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from kind_examples import EXAMPLES
from log_density import program_with
from stan_data import one_test_data
from truth_as_mode import at_truth

from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.model.priors import default_priors


@pytest.mark.usefixtures("programs")
def test_readings_of_one_moment_may_stand_in_any_order(tmp_path: Path) -> None:
    example = EXAMPLES["loading_history"]
    test = example.load("creep")
    assert isinstance(test, HistoryExperiment)
    time, order = test.time.copy(), np.arange(test.n_points)
    time[6:8] = time[5]
    order[5:8] = [7, 5, 6]
    density = []
    for reading in (test.reading, test.reading[order]):
        one = replace(test, time=time, reading=reading)
        truth = at_truth(one, default_priors(one.material, one.protocol), example.tight)
        data = one_test_data(one, truth.priors, solver=example.tight)
        program = program_with(likelihood_of(one).program, data, tmp_path)
        columns = program.columns_at({"coordinate": truth.mode.coordinate.tolist()})
        each = [columns[f"log_lik.{k + 1}"] for k in range(one.n_points)]
        assert np.isfinite(each).all()
        density.append(sum(each))
    assert density[1] == pytest.approx(density[0], rel=1e-10)

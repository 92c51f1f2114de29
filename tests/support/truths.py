"""True parameters of synthetic tests."""

from pyburgers.kinds.experiment import Experiment


def truth_of(experiment: Experiment) -> dict[str, float]:
    assert experiment.true_parameters is not None
    return dict(experiment.true_parameters)

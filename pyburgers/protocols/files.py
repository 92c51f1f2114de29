"""Experiment files of any protocol."""

from pathlib import Path
from typing import Literal

from pydantic import ConfigDict, Field

from pyburgers.common.toml_files import Table, read_toml
from pyburgers.protocols.constant_rate.experiment import (
    ConstantRateExperiment,
    load_constant_rate,
    save_constant_rate,
)
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.forced_oscillation.experiment import (
    OscillationExperiment,
    load_forced_oscillation,
    save_forced_oscillation,
)


class _ProtocolTable(Table):
    """The one key that tells how to read the others."""

    model_config = ConfigDict(extra="ignore")

    protocol: Literal["constant_rate", "forced_oscillation"] = Field(description="the kind of test")


def load_experiment(path: str | Path) -> Experiment:
    """Read and check an experiment file and the data files that it names.

    Parameters
    ----------
    path : str or Path
        The TOML file.

    Returns
    -------
    ConstantRateExperiment or OscillationExperiment
        By its key `protocol`; how each is read say
        `pyburgers.protocols.constant_rate.experiment.load_constant_rate`
        and `pyburgers.protocols.forced_oscillation.experiment.load_forced_oscillation`.

    Raises
    ------
    InputError
        If a file, key, unit or number is not what it has to be.
    """
    path = Path(path)
    match read_toml(path, _ProtocolTable).protocol:
        case "constant_rate":
            return load_constant_rate(path)
        case "forced_oscillation":
            return load_forced_oscillation(path)


def save_experiment(experiment: Experiment, directory: Path) -> Path:
    """Write a self-contained copy in SI units.

    `load_experiment` reads back exactly equal contents, notices included.

    Parameters
    ----------
    experiment : Experiment
        What to write.
    directory : Path
        An existing folder.

    Returns
    -------
    Path
        The TOML file, ``experiment.toml``.
    """
    match experiment:
        case ConstantRateExperiment():
            return save_constant_rate(experiment, directory)
        case OscillationExperiment():
            return save_forced_oscillation(experiment, directory)
    raise TypeError(f"no file format for {type(experiment).__name__}")

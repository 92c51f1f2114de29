"""Every protocol, and experiment files of any of them."""

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any

from pydantic import ConfigDict, Field

from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import Table, read_toml
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.protocol import Protocol

PROTOCOLS: Mapping[str, Protocol[Any]] = MappingProxyType(
    {
        name: import_module(f"pyburgers.protocols.{name}.protocol").PROTOCOL
        for name in (
            "constant_rate",
            "forced_oscillation",
        )
    }
)
"""By their names in files, which are those of their folders."""


class _ProtocolTable(Table):
    """The one key that tells how to read the others."""

    model_config = ConfigDict(extra="ignore")

    protocol: str = Field(description="the kind of test")


def protocol_of(experiment: Experiment) -> Protocol[Any]:
    """Return the protocol of a test."""
    return PROTOCOLS[experiment.protocol]


def load_experiment(path: str | Path) -> Experiment:
    """Read and check an experiment file and the data files that it names.

    Parameters
    ----------
    path : str or Path
        The TOML file.

    Returns
    -------
    Experiment
        Of the class of its key `protocol`; how it is read says the module ``experiment`` in the
        folder of that name.

    Raises
    ------
    InputError
        If a file, key, unit or number is not what it has to be.
    """
    path = Path(path)
    name = read_toml(path, _ProtocolTable).protocol
    if name not in PROTOCOLS:
        expected = " or ".join(map(repr, PROTOCOLS))
        raise InputError(
            f"{path}: key 'protocol': found {name!r}, expected {expected} (the kind of test)."
        )
    experiment: Experiment = PROTOCOLS[name].load(path)
    return experiment


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
    return protocol_of(experiment).save(experiment, directory)

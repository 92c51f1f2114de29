"""The open collection: published tests with the laws that were fitted to them."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from pyburgers.checks.fit_checks import Outcome
from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError, nearest
from pyburgers.common.paths import shipped_folder
from pyburgers.common.toml_files import read_json

LAWS = ("flow_law", "mechanisms", "hardening_law", "elastic_law", "kelvin_law", "microstructure")
"""Entries of an export that are expressions of laws, or what they hold for."""


@dataclass(frozen=True, eq=False)
class FittedRock:
    """A published test with the law that was fitted to it.

    The law predicts left-out readings best among those that were sampled well and describe the
    data. If there is none, it is the best that was sampled well, and `describes_data` says so.

    Attributes
    ----------
    name, material, kind : str
        Name in the collection, material, and kind of the test.
    source, doi, licence : str or None
        Where the readings were published, and what may be done with them.
    variant : str
        Laws of the model's parts, as options of the command line.
    laws : mapping of str to object
        Expressions of the flow law, the elastic law and the Kelvin law, with the microstructure
        that they hold for.
    sampled_well, describes_data : Outcome
        Both verdicts on the fit.
    names, units : tuple of str
        Parameters of the material, and their SI units.
    decided_by : tuple of str
        Who decides each number: data, both, prior, bound, conflict, fixed or cannot tell.
    mean : array, shape (n_parameters,)
        Means of the posterior.
    covariance : array, shape (n_parameters, n_parameters)
        Its covariance.
    draws : array, shape (n_draws, n_parameters)
        A sample of its draws.
    record : mapping
        The whole content of the file, with sentences of the verdicts, URIs of terms, the manifest
        and the results of other laws.

    Examples
    --------
    >>> rock = pyburgers.collection("dunite_4581")
    >>> isinstance(rock, pyburgers.FittedRock), rock.material
    (True, 'dunite')
    """

    name: str
    material: str
    kind: str
    source: str
    doi: str | None
    licence: str | None
    variant: str
    laws: Mapping[str, object]
    sampled_well: Outcome
    describes_data: Outcome
    names: tuple[str, ...]
    units: tuple[str, ...]
    decided_by: tuple[str, ...]
    mean: FloatArray
    covariance: FloatArray
    draws: FloatArray
    record: Mapping[str, Any]


def collection_names() -> tuple[str, ...]:
    """Return the names of the tests of the collection, in the order of its page.

    Examples
    --------
    >>> "dunite_4581" in pyburgers.collection_names()
    True
    """
    return tuple(entry["name"] for entry in read_json(_folder() / "index.json")["tests"])


def collection(name: str) -> FittedRock:
    """Return a published test with the law that was fitted to it.

    Parameters
    ----------
    name : str
        One of `collection_names`.

    Returns
    -------
    FittedRock
        Parameters with covariance and draws, laws, both verdicts and the origin of the readings.

    Raises
    ------
    InputError
        If there is no such test.

    Examples
    --------
    >>> rock = pyburgers.collection("dunite_4581")
    >>> exponent = dict(zip(rock.names, rock.mean))["stress_exponent"]
    >>> rock.draws.shape[1] == len(rock.names)
    True
    """
    names = collection_names()
    if name not in names:
        raise InputError(f"the collection has no test {name!r}, {nearest(name, names)}")
    record = read_json(_folder() / f"{name}.json")
    about = record["collection"]
    return FittedRock(
        name=name,
        material=record["material"],
        **{key: about[key] for key in ("kind", "source", "doi", "licence")},
        variant=record["variant"],
        laws=MappingProxyType({law: record[law] for law in LAWS if law in record}),
        sampled_well=Outcome(record["sampled_well"]),
        describes_data=Outcome(record["describes_data"]),
        names=tuple(record["names"]),
        units=tuple(record["units"]),
        decided_by=tuple(record["decided_by"]),
        mean=np.array(record["mean"]),
        covariance=np.array(record["covariance"]),
        draws=np.array(record["sample"]),
        record=MappingProxyType(record),
    )


def _folder() -> Path:
    return shipped_folder("data") / "collection"

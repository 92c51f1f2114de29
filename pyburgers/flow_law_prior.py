"""The flow law of a finished fit as a prior for fits of other data of the same material."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Self

import numpy as np
import numpy.typing as npt

from pyburgers.errors import InputError
from pyburgers.peak_stress import Conditions
from pyburgers.run_directory import write_json

FloatArray = npt.NDArray[np.float64]

PRIOR_QUANTITIES = ("stress_exponent", "grain_size_exponent", "log_reference_flow_rate", "beta")
"""Quantities of a `FlowLawPrior`: nearly normal and, but for beta, fixed by a table."""


@dataclass(frozen=True, eq=False)
class FlowLawPrior:
    """A multivariate normal of a flow law, for fits of other data of the same material.

    Attributes
    ----------
    quantities : tuple of str
        `PRIOR_QUANTITIES`: n, p, ln(flow rate s) at the conditions, beta (mol/J). The activation
        enthalpy follows from them.
    mean : array, shape (4,)
        Of the quantities.
    covariance : array, shape (4, 4)
        Of the quantities.
    conditions : Conditions
        Where the flow rate holds.
    """

    quantities: tuple[str, ...]
    mean: FloatArray
    covariance: FloatArray
    conditions: Conditions

    def save(self, path: Path) -> None:
        """Write a JSON file; `load` reads back equal contents."""
        write_json(
            path,
            {
                "quantities": list(self.quantities),
                "mean": self.mean.tolist(),
                "covariance": self.covariance.tolist(),
                "conditions": asdict(self.conditions),
            },
        )

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` wrote.

        Raises
        ------
        InputError
            If the file is missing or is not such a prior.
        """
        try:
            content = json.loads(Path(path).read_text(encoding="utf-8"))
            prior = cls(
                quantities=tuple(content["quantities"]),
                mean=np.array(content["mean"], dtype=np.float64),
                covariance=np.array(content["covariance"], dtype=np.float64),
                conditions=Conditions(**content["conditions"]),
            )
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror}).") from error
        except (ValueError, KeyError, TypeError) as error:
            raise InputError(
                f"{path}: is not a flow law prior, expected what pyburgers fit-peak-stress writes."
            ) from error
        size = len(prior.quantities)
        if prior.mean.shape != (size,) or prior.covariance.shape != (size, size):
            raise InputError(
                f"{path}: found a mean of shape {prior.mean.shape} and a covariance of shape "
                f"{prior.covariance.shape}, expected ({size},) and ({size}, {size})."
            )
        return prior

"""A flow law as a joint normal distribution: how one kind of data tells another what it knows.

Made from a fit of a table of rates (`pyburgers.flow_law_prior`); in the priors of a curve it takes
the place of those of n, p, Q_M and beta (`with_flow_law` in `pyburgers.model.priors`).
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt
from pydantic import Field

from pyburgers.common.array_types import FloatArray
from pyburgers.common.atomic_files import write_json
from pyburgers.common.errors import InputError
from pyburgers.common.paths import given_path
from pyburgers.common.toml_files import Table, Word, read_json
from pyburgers.model.arrhenius import GAS_CONSTANT, log_flow_rate
from pyburgers.model.peak_test import PeakTest

PRIOR_QUANTITIES = ("stress_exponent", "grain_size_exponent", "log_reference_flow_rate", "beta")
"""Quantities of a `FlowLawPrior`: nearly normal and, but for beta, fixed by a table."""

FLOW_LAW_PRIOR_FILE = "flow_law_prior.json"
"""Name of a saved flow law in a run directory."""

MOMENT_DRAWS = 20_000
"""Draws for the marginal moments of Q_M, which is not one of the quantities."""


@dataclass(frozen=True)
class Conditions:
    """A point of a flow law: temperature (K), differential stress (Pa), mean grain size (m)."""

    temperature: float
    stress: float
    grain_size: float


@dataclass(frozen=True, eq=False)
class FlowLawPrior:
    """A multivariate normal of a flow law, for fits of other data of the same material.

    `quantities`: `PRIOR_QUANTITIES`: n, p, ln(flow rate s) at the conditions, beta (mol/J). The
        activation enthalpy follows from them.
    `mean`, `covariance`: of the quantities, shapes (4,) and (4, 4).
    `conditions`: where the flow rate holds.
    `material`: what the flow law is of.
    `source`: what it was fitted to.
    `tests`: the same, test by test: none of them may be fitted with this prior.
    `read_off`: words in the id, source or DOI of other data that the flow law was read off.
    """

    quantities: tuple[str, ...]
    mean: FloatArray
    covariance: FloatArray
    conditions: Conditions
    material: str
    source: str
    tests: tuple[PeakTest, ...] = ()
    read_off: tuple[str, ...] = ()

    def __eq__(self, other: object) -> bool:
        """Whether it is the same distribution of the same material, from the same source."""
        return isinstance(other, FlowLawPrior) and (self.material, self.table()) == (
            other.material,
            other.table(),
        )

    def checked(self, where: str) -> Self:
        """Return the prior, or raise InputError if it is no distribution of the quantities.

        In the message, `where` is the file.
        """
        size = len(PRIOR_QUANTITIES)
        if self.mean.shape != (size,) or self.covariance.shape != (size, size):
            raise InputError(
                f"{where}: found a mean of shape {self.mean.shape} and a covariance of shape "
                f"{self.covariance.shape}, expected ({size},) and ({size}, {size})."
            )
        if self.quantities != PRIOR_QUANTITIES:
            raise InputError(
                f"{where}: found the quantities {', '.join(self.quantities)}, expected "
                f"{', '.join(PRIOR_QUANTITIES)}."
            )
        if not _is_covariance(self.covariance):
            raise InputError(
                f"{where}: found a covariance that is not symmetric and positive definite, "
                "expected that of a distribution."
            )
        if min(asdict(self.conditions).values()) <= 0:
            raise InputError(f"{where}: found {self.conditions}, expected positive numbers.")
        return self

    @property
    def factor(self) -> FloatArray:
        """Lower Cholesky factor of the covariance, shape (4, 4)."""
        return np.asarray(np.linalg.cholesky(self.covariance), dtype=np.float64)

    def sample(self, rng: np.random.Generator) -> dict[str, float]:
        """Draw n, p, Q_M (J/mol) and beta (mol/J), again where n or p is not positive."""
        while True:
            n, p, log_rate, beta = self.mean + self.factor @ rng.standard_normal(self.mean.size)
            if n > 0 and p > 0:
                return {
                    "stress_exponent": float(n),
                    "grain_size_exponent": float(p),
                    "activation_enthalpy": float(self.activation_enthalpy(n, p, log_rate, beta)),
                    "beta": float(beta),
                }

    def marginals(self) -> dict[str, tuple[float, float]]:
        """Mean and standard deviation of n, p, Q_M (J/mol) and beta (mol/J) each by itself."""
        rng = np.random.default_rng(0)
        draws = self.mean + rng.standard_normal((MOMENT_DRAWS, self.mean.size)) @ self.factor.T
        enthalpy = self.activation_enthalpy(*draws.T)
        spread = np.sqrt(np.diag(self.covariance))
        return {
            "stress_exponent": (float(self.mean[0]), float(spread[0])),
            "grain_size_exponent": (float(self.mean[1]), float(spread[1])),
            "activation_enthalpy": (float(np.mean(enthalpy)), float(np.std(enthalpy))),
            "beta": (float(self.mean[3]), float(spread[3])),
        }

    def log_flow_rate(self, values: Mapping[str, npt.ArrayLike]) -> FloatArray:
        """ln(flow rate s) at the conditions, of n, p, Q_M (J/mol) and beta (mol/J) by name."""
        return log_flow_rate(values, **asdict(self.conditions))

    def scores(self, values: Mapping[str, npt.ArrayLike]) -> FloatArray:
        """Independent standard normal scores of n, p, Q_M and beta, along the last axis.

        The values are those of `log_flow_rate`.
        """
        found = {**values, "log_reference_flow_rate": self.log_flow_rate(values)}
        beside = np.stack([np.asarray(found[name]) for name in self.quantities], axis=-1)
        solved = np.linalg.solve(self.factor, (beside - self.mean)[..., np.newaxis])
        return np.asarray(solved[..., 0], dtype=np.float64)

    def flow_rate_scores(self, log_flow_rate: FloatArray) -> FloatArray:
        """Return standard normal scores of what `log_flow_rate` gives, by itself."""
        k = PRIOR_QUANTITIES.index("log_reference_flow_rate")
        return np.asarray((log_flow_rate - self.mean[k]) / np.sqrt(self.covariance[k, k]))

    def activation_enthalpy(
        self,
        stress_exponent: npt.ArrayLike,
        grain_size_exponent: npt.ArrayLike,
        log_rate: npt.ArrayLike,
        beta: npt.ArrayLike,
    ) -> FloatArray:
        """Q_M (J/mol) from the quantities: `activation_enthalpy_from_flow` of the Stan functions.

        The arguments are n, p, ln(flow rate s) at `conditions`, and beta (mol/J), broadcast against
        each other. It stands outside Stan because priors are drawn from without a compiled program.
        """
        at = self.conditions
        log_factor = (
            np.asarray(log_rate)
            - np.asarray(stress_exponent) * np.log(at.stress)
            + np.asarray(grain_size_exponent) * np.log(at.grain_size)
        )
        return np.asarray(log_factor / (np.asarray(beta) - 1 / (GAS_CONSTANT * at.temperature)))

    def save(self, path: Path) -> None:
        """Write a JSON file; `load` reads back equal contents."""
        conditions = asdict(self.conditions)
        others = {key: value for key, value in self.table().items() if key not in conditions}
        write_json(path, {"material": self.material, **others, "conditions": conditions})

    def table(self) -> dict[str, Any]:
        """Return what a `FlowLawTable` reads."""
        return {
            "source": self.source,
            "quantities": list(self.quantities),
            "mean": self.mean.tolist(),
            "covariance": self.covariance.tolist(),
            "tests": [asdict(test) for test in self.tests],
            "read_off": list(self.read_off),
            **asdict(self.conditions),
        }

    @classmethod
    def load(cls, path: str | Path) -> "FlowLawPrior":
        """Read what `save` wrote.

        Raise InputError if the file cannot be read or is not such a prior.
        """
        content = read_json(given_path(path))
        try:
            material = str(content.pop("material"))
            table = FlowLawTable.model_validate({**content.pop("conditions"), **content})
            return table.flow_law_prior(material, str(path))
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise InputError(
                f"{path}: is not a flow law prior, expected what pyburgers fit-rates writes."
            ) from error


class PeakTestTable(Table):
    """A `PeakTest` in a file."""

    strain_rate: float = Field(gt=0, description="imposed, in 1/s")
    stress: float = Field(gt=0, description="at the peak, in Pa")
    temperature: float = Field(gt=0, description="in kelvin")
    grain_size: float = Field(gt=0, description="at the start, in m")


class FlowLawTable(Table):
    """A `FlowLawPrior` in a file."""

    source: str = Field(min_length=1, description="where the flow law comes from")
    quantities: list[str] = Field(description="n, p, ln(flow rate s) and beta by their names")
    mean: list[float] = Field(description="the mean of each quantity, SI")
    covariance: list[list[float]] = Field(description="the covariance of the quantities, SI")
    temperature: float = Field(description="of the flow rate, in kelvin")
    stress: float = Field(description="of the flow rate, in Pa")
    grain_size: float = Field(description="of the flow rate, in m")
    tests: list[PeakTestTable] = Field(
        default=[], description="the tests that it was fitted to, if it is a fit"
    )
    read_off: list[Word] = Field(
        default=[], description="words in the id, source or DOI of data that it was read off"
    )

    def flow_law_prior(self, material: str, where: str) -> FlowLawPrior:
        """Return the flow law of a material, checked; `where` is the file in messages.

        Raise InputError if its numbers are no flow law.
        """
        if len({len(row) for row in self.covariance}) > 1:
            raise InputError(
                f"{where}: found a covariance whose rows differ in length, expected a square one."
            )
        return FlowLawPrior(
            quantities=tuple(self.quantities),
            mean=np.array(self.mean),
            covariance=np.array(self.covariance),
            conditions=Conditions(self.temperature, self.stress, self.grain_size),
            material=material,
            source=self.source,
            tests=tuple(PeakTest(**test.model_dump()) for test in self.tests),
            read_off=tuple(self.read_off),
        ).checked(where)


def _is_covariance(matrix: FloatArray) -> bool:
    """Whether a matrix is symmetric and positive definite, whatever the units of its rows."""
    variance = np.diag(matrix)
    with np.errstate(over="ignore"):  # numbers as large as that make no covariance
        if not (np.allclose(matrix, matrix.T, rtol=1e-6, atol=0.0) and np.all(variance > 0)):
            return False
        correlation = matrix / np.sqrt(variance) / np.sqrt(variance)[:, None]
    return bool(np.all(np.isfinite(correlation)) and np.linalg.eigvalsh(correlation).min() > 0)


def load_flow_law_of_run(directory: Path) -> FlowLawPrior:
    """Read the flow law that a fit of a table of rates left in its run directory.

    Raise InputError if the directory is not such a run, or a part of its flow law was fixed.
    """
    file = directory / FLOW_LAW_PRIOR_FILE
    if not file.is_file():
        raise InputError(
            f"{directory}: has no {FLOW_LAW_PRIOR_FILE}, expected a run of pyburgers "
            "fit-rates --curve-priors with the whole flow law free."
        )
    return FlowLawPrior.load(file)

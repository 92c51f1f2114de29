"""Fits of a linear model to data that it made: exact posteriors, to count how often checks fail."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import xarray as xr

from pyburgers.checks.fit_checks import CheckedDraws
from pyburgers.common.array_types import FloatArray
from pyburgers.posterior.labelled_draws import CORRELATED

NOISE_GRID = np.exp(np.linspace(-1.5, 1.5, 601))


@dataclass(frozen=True, eq=False)
class LinearModel:
    """Responses f ~ N(0, prior), readings f + s e, with s = 1 and a prior of s like 1/s.

    `factor`, shape (n, n), is the Cholesky factor of the correlation of errors that correlate.
    """

    position: FloatArray
    segment: FloatArray
    prior: FloatArray
    factor: FloatArray | None = None

    @classmethod
    def like(cls, posterior: xr.DataTree) -> "LinearModel":
        """Return the linear model whose posterior of the responses is that of a test at a rate."""
        response = posterior["model_response"].to_dataset()["stress"]
        values = response.transpose("chain", "draw", "point").to_numpy()
        noise = posterior["posterior"].to_dataset()["stress_noise"].to_numpy()
        scaled = values.reshape(-1, values.shape[-1]) / noise.mean()
        variance, axes = np.linalg.eigh(np.cov(scaled.T))
        kept = variance > 1e-4
        # In directions as uncertain as a reading the prior is as good as flat.
        variance = np.minimum(variance[kept], 0.99)
        prior = (axes[:, kept] * (variance / (1 - variance))) @ axes[:, kept].T
        along = posterior["constant_data"].to_dataset()
        return cls(along["strain"].to_numpy(), along["segment"].to_numpy(), prior)

    @classmethod
    def of_polynomials(cls, n: int, steps: int, degree: int) -> "LinearModel":
        """Return one whose responses are wide polynomials between steps of a clock."""
        position = np.linspace(0.001, 0.2, n)
        segment = np.floor(np.linspace(0, steps + 1, n, endpoint=False))
        columns = []
        for one in range(steps + 1):
            x = np.linspace(-1, 1, int(np.sum(segment == one)))
            for power in range(degree + 1):
                column = np.zeros(n)
                column[segment == one] = x**power
                columns.append(column)
        design = np.stack(columns)
        return cls(position, segment, 100.0 * design.T @ design)

    def with_correlation(self, share: float, readings: float) -> Self:
        """Return the model with a part of the errors that correlates over some readings."""
        apart = np.abs(np.subtract.outer(*2 * [np.arange(self.position.size)]))
        part = share * np.exp(-apart / readings) * (self.segment[:, None] == self.segment)
        return replace(self, factor=np.linalg.cholesky(part + (1 - share) * np.eye(len(part))))

    def fits(self, n_fits: int, seed: int, *, draws: int = 1000) -> Iterator[CheckedDraws]:
        """Make truths, data and exact draws of the posterior given them."""
        rng = np.random.default_rng(seed)
        n = self.position.size
        factor = np.eye(n) if self.factor is None else self.factor
        whitened = np.linalg.solve(factor, np.linalg.solve(factor, self.prior).T)
        variance, axes = np.linalg.eigh(whitened)
        variance, axes = np.maximum(variance, 0.0), factor @ axes
        total = variance[:, None] + NOISE_GRID**2
        for _ in range(n_fits):
            data = np.sqrt(variance) * rng.standard_normal(n) + rng.standard_normal(n)
            log_density = -0.5 * (np.log(total) + data[:, None] ** 2 / total).sum(0)
            weights = np.exp(log_density - log_density.max())
            noise = rng.choice(NOISE_GRID, size=(draws, 1), p=weights / weights.sum())
            shrunk = variance / (variance + noise**2)
            deviation = noise * np.sqrt(shrunk) * rng.standard_normal((draws, n))
            model = (shrunk * data + deviation) @ axes.T
            replicated = model + noise * rng.standard_normal((draws, n)) @ factor.T
            yield self._labelled(axes @ data, model, replicated)

    def _labelled(
        self, data: FloatArray, model: FloatArray, replicated: FloatArray
    ) -> CheckedDraws:
        dims = ("chain", "draw", "point")
        correlated = {} if self.factor is None else {CORRELATED: xr.Dataset()}
        return CheckedDraws(
            xr.DataTree.from_dict(
                {
                    **correlated,
                    "/": xr.Dataset(attrs={"protocol": "constant_rate"}),
                    "model_response": xr.Dataset({"stress": (dims, model[None])}),
                    "posterior_predictive": xr.Dataset({"stress": (dims, replicated[None])}),
                    "observed_data": xr.Dataset({"stress": ("point", data)}),
                    "predictions": xr.Dataset({"x": (("strain",), np.zeros(1))}),
                    "constant_data": xr.Dataset(
                        {
                            "strain": ("point", self.position),
                            "segment": ("point", self.segment),
                        }
                    ),
                    "sample_stats": xr.Dataset(
                        {"diverging": (dims[:2], np.zeros((1, len(model)), dtype=bool))}
                    ),
                }
            )
        )

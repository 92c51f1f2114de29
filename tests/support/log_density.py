"""Log density and gradient of a compiled Stan program at a point, to full precision.

CmdStan 2.27 prints gradients with six digits only. But one leapfrog step of size e from rest
with momentum z moves a coordinate by e z + e^2 g/2, where g is the gradient of the log density at
the start, and the same seed gives the same z whatever e: two runs with steps e and 2 e give g
exactly, from positions that are printed with all digits.
"""

import json
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from pyburgers.cmdstan.compilation import compile_program
from pyburgers.cmdstan.program import ALL_DIGITS
from pyburgers.cmdstan.program import Program as CompiledProgram
from pyburgers.common.array_types import FloatArray
from pyburgers.kinds.problem import Problem
from pyburgers.kinds.program_data import program_data
from pyburgers.kinds.stan_data import SolverOptions, StanData

PRECISE = SolverOptions(1e-11, 1_000_000)
Unconstrain = Callable[[Mapping[str, float]], FloatArray]


@dataclass(frozen=True)
class Evaluation:
    """What a program says at a point: log density, its gradient, and the CSV's columns."""

    log_density: float
    gradient: FloatArray
    columns: Mapping[str, float]


@dataclass(frozen=True)
class Program:
    """A compiled program with its data and a folder for files.

    `unconstrain` turns columns of the output into unconstrained coordinates, shape (n,), whose
    typical sizes are `scale`.
    """

    executable: Path
    data_file: Path
    folder: Path
    unconstrain: Unconstrain
    scale: FloatArray

    def columns_at(self, initial_values: Mapping[str, object]) -> Mapping[str, float]:
        """Columns of the output at the given values of the program's parameters."""
        return self._leapfrog(initial_values, 1e-14 * self.scale)[0]

    def values_at(self, point: FloatArray) -> Mapping[str, float]:
        """Columns of the output at coordinates, without a gradient; `lp__` is no density here."""
        output = self._run({"coordinate": point.tolist()}, ["algorithm=fixed_param"])
        return _only_row(output)

    def gradient_at(self, point: FloatArray) -> Evaluation:
        """Log density and columns at coordinates, with a gradient to six digits."""
        columns, gradient = self._leapfrog({"coordinate": point.tolist()}, 1e-14 * self.scale)
        return Evaluation(columns["lp__"], gradient, columns)

    def at(self, initial_values: Mapping[str, object]) -> Evaluation:
        """Log density and gradient at the given values of the program's parameters."""
        still, rough = self._leapfrog(initial_values, 1e-14 * self.scale)
        step = 1e-3 * self.scale / np.sqrt(np.maximum(np.abs(rough * self.scale), 1.0))
        start = self.unconstrain(still)
        one, two = (
            self.unconstrain(self._leapfrog(initial_values, factor * step)[0]) - start
            for factor in (1, 2)
        )
        assert np.all(np.any([one, two], axis=1)), "a step was rejected"
        return Evaluation(still["lp__"], (two - 2 * one) / step**2, still)

    def generated_at(self, points: FloatArray) -> list[dict[str, float]]:
        """Columns of the generated quantities at points, shape (n, n_coordinates), in one run."""
        solved, draws = CompiledProgram(self.executable).generate_at(
            json.loads(self.data_file.read_text(encoding="utf-8")),
            "coordinate",
            points,
            digits=ALL_DIGITS,
        )
        assert solved.all()
        names = [
            ".".join([name, *(str(k + 1) for k in reversed(place))])
            for name, variable in draws.variables.items()
            for place in np.ndindex(*reversed(variable.dimensions))
        ]
        return [dict(zip(names, row, strict=True)) for row in draws.values[0].tolist()]

    def _leapfrog(
        self, initial_values: Mapping[str, object], step: FloatArray
    ) -> tuple[Mapping[str, float], FloatArray]:
        """Columns after one step, and the gradient there to six digits."""
        metric, trace_file = self.folder / "metric.json", self.folder / "trace.json"
        # A step of size 1 in coordinates scaled by `step`.
        metric.write_text(json.dumps({"inv_metric": (step**2).tolist()}), encoding="utf-8")
        method = [
            *("num_warmup=0", "adapt", "engaged=0", "algorithm=hmc", "engine=static"),
            *("int_time=1", "metric=diag_e", f"metric_file={metric}", "stepsize=1"),
        ]
        output = self._run(initial_values, method, [f"diagnostic_file={trace_file}"])
        trace = _only_row(trace_file)
        # CmdStan gives the gradient of the potential, which is minus the log density.
        gradient = [-value for name, value in trace.items() if name.startswith("g_")]
        return _only_row(output), np.array(gradient)

    def _run(
        self,
        initial_values: Mapping[str, object],
        method: Sequence[str],
        output_options: Sequence[str] = (),
    ) -> Path:
        """Take one draw from the given values of the program's parameters; return its file."""
        init, output = self.folder / "init.json", self.folder / "output.json"
        init.write_text(json.dumps(initial_values), encoding="utf-8")
        running = CompiledProgram(self.executable).start(
            ["method=sample", "num_samples=1", *method],
            data=self.data_file,
            init=init,
            output=output,
            seed=5,
            digits=ALL_DIGITS,
            output_options=output_options,
        )
        running.wait()
        assert not running.failed, running.console_tail()
        return output


def assert_gradient_is_slope(
    program: Program, point: FloatArray, along: Sequence[int] | None = None
) -> None:
    """Compare the gradient with differences of fourth order, along some coordinates or all.

    Densities are those that generated quantities repeat, in one run without gradients. The
    gradient has six digits, of which four are compared.
    """
    here, step = program.gradient_at(point), 1e-3
    along = range(point.size) if along is None else along
    shifts = step * np.eye(point.size)[along]
    points = np.vstack([point, *(point + m * shifts for m in (1, -1, 2, -2))])
    density = np.array([columns["log_density"] for columns in program.generated_at(points)])
    assert density[0] == pytest.approx(here.log_density, rel=1e-7)
    ahead, behind, far_ahead, far_behind = density[1:].reshape(4, -1)
    slope = (8 * (ahead - behind) - (far_ahead - far_behind)) / (12 * step)
    limit = 1e-4 * np.abs(here.gradient).max()
    assert here.gradient[along] == pytest.approx(slope, rel=1e-4, abs=limit)


def _only_row(file: Path) -> dict[str, float]:
    lines = file.read_text(encoding="utf-8").splitlines()
    header, row = (line.split(",") for line in lines if line and not line.startswith("#"))
    return dict(zip(header, map(float, row), strict=True))


def program_with(source: Path, data: StanData, folder: Path) -> Program:
    """Program of a protocol with its data."""
    folder.mkdir(exist_ok=True)
    data_file = folder / "data.json"
    data_file.write_text(json.dumps(data), encoding="utf-8")
    size = data["n_coordinates"]
    return Program(
        compile_program(source),
        data_file,
        folder,
        lambda columns: np.array([columns[f"coordinate.{k + 1}"] for k in range(size)]),
        np.ones(size),
    )


def program_of(
    problem: Problem, folder: Path, *, solver: SolverOptions = PRECISE, seed: int, width: float
) -> tuple[Program, FloatArray]:
    """Program of a problem with its data, and a point at random about its origin."""
    data = program_data(problem, solver=solver)
    point = width * np.random.default_rng(seed).standard_normal(data["n_coordinates"])
    return program_with(problem.likelihood.program, data, folder), np.array(point)


def assert_gradient_along(
    problem: Problem, names: Collection[str], folder: Path, *, solver: SolverOptions = PRECISE
) -> None:
    """Compare the gradient with differences along the coordinates of some parameters."""
    program, point = program_of(problem, folder, solver=solver, seed=2, width=0.1)
    free = list(problem.layout.names)
    assert_gradient_is_slope(program, point, [free.index(name) for name in names])

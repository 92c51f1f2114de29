"""Time of a gradient: leapfrogs that stay where they are."""

import os
import tempfile
import time
from pathlib import Path

import numpy as np
import numpy.typing as npt

from pyburgers.cmdstan.draw_files import read_draws
from pyburgers.cmdstan.program import Program
from pyburgers.common.atomic_files import write_json

FloatArray = npt.NDArray[np.float64]

STEP = 1e-14
"""Of these leapfrogs."""


def ms_per_gradient(program: Program, data: Path, points: FloatArray, number: int) -> FloatArray:
    """Return milliseconds of a gradient, by the clock and of the processors.

    Parameters
    ----------
    program, data
        What is evaluated.
    points : array, shape (n_points, n_coordinates)
        Coordinates at which it is.
    number : int
        Of gradients at each; the time of starting a program is taken off.
    """
    once, _ = leapfrogs(program, data, points, 1)
    often, _ = leapfrogs(program, data, points, 1 + number)
    return 1e3 * (often - once) / (number * len(points))


def leapfrogs(
    program: Program, data: Path, points: FloatArray, number: int
) -> tuple[FloatArray, FloatArray]:
    """Return seconds of the clock and of the processors for leapfrogs at points, and densities."""
    density = []
    clock, before = time.monotonic(), os.times()
    with tempfile.TemporaryDirectory() as folder:
        init, output = Path(folder) / "init.json", Path(folder) / "output.csv"
        for point in points:
            write_json(init, {"coordinate": point.tolist()})
            running = program.start(
                [
                    *("method=sample", "num_samples=1", "num_warmup=0", "adapt", "engaged=0"),
                    *("algorithm=hmc", "engine=static", f"int_time={number * STEP}"),
                    f"stepsize={STEP}",
                ],
                data=data,
                init=init,
                output=output,
                seed=1,
                digits=17,
            )
            running.wait()
            density.append(read_draws([output])["lp__"][0, 0])
    after = os.times()
    used = after.children_user - before.children_user
    return np.array([time.monotonic() - clock, used]), np.array(density)

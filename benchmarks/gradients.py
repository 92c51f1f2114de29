"""Time of a gradient: leapfrogs that stay where they are."""

import os
import tempfile
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from pyburgers.cmdstan.program import Program
from pyburgers.common.array_types import FloatArray
from pyburgers.common.atomic_files import write_json
from pyburgers.common.errors import SamplingError

Position = Mapping[str, object]

STEP = 1e-14
"""Of these leapfrogs."""


def coordinates(points: FloatArray) -> list[Position]:
    """Return points, shape (n_points, n_coordinates), as positions of a program."""
    return [{"coordinate": point.tolist()} for point in points]


def ms_per_gradient(
    program: Program, data: Path, positions: Sequence[Position], number: int
) -> FloatArray:
    """Return milliseconds of a gradient, by the clock and of the processors.

    At each position `number` of them are timed; the time of starting a program is taken off.
    """
    once = leapfrogs(program, data, positions, 1)
    often = leapfrogs(program, data, positions, 1 + number)
    return 1e3 * (often - once) / (number * len(positions))


def leapfrogs(
    program: Program, data: Path, positions: Iterable[Position], number: int
) -> FloatArray:
    """Return seconds of the clock and of the processors for leapfrogs at positions.

    Raise SamplingError if a program cannot start at one.
    """
    clock, before = time.monotonic(), os.times()
    with tempfile.TemporaryDirectory() as folder:
        init, output = Path(folder) / "init.json", Path(folder) / "output.csv"
        for position in positions:
            write_json(init, position)
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
            )
            running.wait()
            if running.failed:
                raise SamplingError("The program cannot start at a position.")
    used = os.times().children_user - before.children_user
    return np.array([time.monotonic() - clock, used])

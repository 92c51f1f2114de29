"""What the data of every Stan program have in common.

This module, `program_data` beside it and the `stan_data` of each protocol and of tables of peak
stresses are the only ones that know the data blocks in `stan/data/` and of the programs.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

from pyburgers.common.errors import InputError

StanData = dict[str, Any]

PLAIN, CHART = 1, 2
"""Codes of the coordinate systems: each program has plain ones and the chart of its protocol."""


@dataclass(frozen=True)
class SolverOptions:
    """Options of Stan's `ode_bdf_tol`.

    Attributes
    ----------
    tolerance : float
        Relative and absolute tolerance; the states are O(1), so one number fits both. The default
        is as loose as sampling allows: the log density of some oscillations varies by 0.05 between
        neighbouring points. At 3e-5 it varies by 0.3.
    max_num_steps : int
        Steps between two output strains before the solver gives up, which rejects the draw.
    """

    tolerance: float = 1e-5
    max_num_steps: int = 20_000

    def __post_init__(self) -> None:
        """Check the values.

        Raises
        ------
        InputError
            If one is out of range.
        """
        if not 1e-13 <= self.tolerance <= 1e-2:
            raise InputError(
                f"tolerance is {self.tolerance:g}, expected a number from 1e-13 to 1e-2 (option "
                "--tolerance)."
            )
        if self.max_num_steps < 1:
            raise InputError(f"max_num_steps is {self.max_num_steps}, expected at least 1.")


REFERENCE_SOLVER = SolverOptions(tolerance=1e-10, max_num_steps=1_000_000)
"""Tolerance at which a solution is taken as exact."""


def solver_block(solver: SolverOptions) -> StanData:
    """Return the block `stan/data/solver.stan`."""
    return {"tolerance": solver.tolerance, "max_num_steps": solver.max_num_steps}


def ends(sizes: Iterable[int]) -> list[int]:
    """Return where the parts of a ragged array end, after a leading 0."""
    return list(accumulate(sizes, initial=0))

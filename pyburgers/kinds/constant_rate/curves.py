"""Measured curves: puts points that are out of place by a reading error in order.

A curve may come as a whole or in parts, one for each rate segment; the points of a part have to lie
in the strain range of its segment.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from pyburgers.common.errors import InputError
from pyburgers.common.units import count_points
from pyburgers.kinds.limits import departure, slope_of
from pyburgers.model.parameters import PARAMETERS

FloatArray = npt.NDArray[np.float64]

JITTER_SHARE = 0.01
JITTER_STRAIN = 1e-3
"""Largest misplacement of a strain that counts as reading error: 1 % of the test's strain range,
at most 1e-3.

A curve digitised from a figure is good to about 1 % of the axis. In the dunite curves of Chopra
and Paterson (1984) as digitised by Masuti and Barbot (2021), strains of tests to 7-12 % are out of
order by 1e-5 (4581) and 1e-4 (4580), and the first segment of 4580 ends 5e-4 beyond the rate step.
"""


LATE_STRAIN = 0.01
"""Strain of a first reading beyond which strain may not count from the start of loading."""


@dataclass(frozen=True, eq=False)
class Curve:
    """Points of one data file, or of some of its rows, as read.

    `path`: the data file.
    `selection`: words about its rows that were taken, to follow its name; empty for all.
    `strain`, `stress` (n_rows,): strain (fraction) and stress (Pa) in the order of the file.
    `lower`, `upper`: strains between which the points have to lie.
    `notes`: sentences about what was done to read them.
    """

    path: Path
    selection: str
    strain: FloatArray
    stress: FloatArray
    lower: float
    upper: float
    notes: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name of the file and the rows, as notices give it: without the folder."""
        return f"{self.path.name}{self.selection}"

    @property
    def place(self) -> str:
        """The file and the rows in full, as errors give it."""
        return f"{self.path}{self.selection}"


def join_curves(
    curves: Sequence[Curve], final_strain: float
) -> tuple[FloatArray, FloatArray, list[str]]:
    """Put the points of all files into one curve.

    `final_strain`: strain (fraction) at the end of the test, which sets the tolerance. Return
    `strain`, `stress` (n_points,): strain (fraction, positive, non-decreasing) and stress (Pa).
    Return `notices`: sentences about what was moved, sorted or dropped. Raise InputError if strain
    runs backwards or out of its range by more than a reading error, or no point lies above zero
    strain or has a stress.
    """
    tolerance = min(JITTER_STRAIN, JITTER_SHARE * final_strain)
    strains, stresses = [np.empty(0)], [np.empty(0)]
    notices: list[str] = []
    for curve in curves:
        strain, moved = _inside(curve, tolerance)
        order, sorted_ = _order(curve, strain, tolerance)
        loaded = order[strain[order] > 0]
        strains.append(strain[loaded])
        stresses.append(curve.stress[loaded])
        notices += [*curve.notes, *moved, *sorted_, *_dropped(curve, len(strain) - len(loaded))]
    strain, stress = np.concatenate(strains), np.concatenate(stresses)
    if curves and strain.size == 0:
        raise InputError(f"{curves[0].place}: every point is at zero strain, expected a curve.")
    if curves and not stress.any():
        raise InputError(f"{curves[0].place}: every stress is zero, expected a curve.")
    return strain, stress, notices


def remarks_on(strain: FloatArray, stress: FloatArray) -> list[str]:
    """Say what a reader should know about a curve that can be used.

    The sentences name no file, so that a saved copy gives the same ones. `strain`, `stress`
    (n_points,): strain (fraction, not decreasing) and stress (Pa).
    """
    if strain.size == 0:
        return []
    remarks = []
    repeated = np.count_nonzero(np.diff(strain) == 0)
    if repeated > 0:
        remarks.append(f"{count_points(repeated)} at the same strain as the point before.")
    if strain.size < len(PARAMETERS):
        remarks.append(
            f"{count_points(strain.size)} for the {len(PARAMETERS)} parameters of the model: what "
            "the data do not fix is left to the priors."
        )
    if strain[0] > LATE_STRAIN:
        remarks.append(
            f"The first reading is at a strain of {100 * strain[0]:.2g} %: the model starts at "
            "rest at zero strain, so check that strain counts from the start of loading."
        )
    if np.mean(stress < 0) > 0.5:
        remarks.append(
            "Most stresses are negative, but compression is positive in this model: check the sign."
        )
    if strain[-1] > 1:
        remarks.append(
            f"The largest strain is {strain[-1]:g} as a fraction: check that it is not in percent."
        )
    return remarks


def unlike_rates(
    name: str, time: FloatArray, strain: FloatArray, imposed: FloatArray
) -> tuple[str, ...]:
    """Say where strain over time is not that of the stated rates.

    `time`, `strain` (n_rows,): as read, s and fraction. `imposed` (n_rows,): strain at those times
    by the rates, from the first reading on.
    """
    far = departure(strain, imposed, float(np.abs([*strain, *imposed]).max()))
    if far is None:
        return ()
    slope = slope_of(time, strain)
    by_slope = "" if slope is None else f" (its slope is {slope:.3g} 1/s)"
    return (
        f"{name}: the strain over time{by_slope} lies up to {far.largest:.3g} from the strain "
        f"that the stated rates impose, which it leaves at data row {far.first + 1}; check "
        "units and rates, of which each change starts a segment.",
    )


def _inside(curve: Curve, tolerance: float) -> tuple[FloatArray, list[str]]:
    """Strains with points a reading error outside the range moved onto its ends, and notices."""
    strain = np.clip(curve.strain, curve.lower, curve.upper)
    distance = np.abs(strain - curve.strain)
    worst = int(np.argmax(distance))
    if distance[worst] > tolerance:
        raise InputError(
            f"{curve.place}: data row {worst + 1}: found strain {curve.strain[worst]:g}, expected "
            f"{_range(curve)} (within {tolerance:.2g})."
        )
    if distance[worst] == 0:
        return strain, []
    return strain, [
        f"{curve.name}: {count_points(np.count_nonzero(distance))} moved by at most "
        f"{distance[worst]:.2g} in strain onto the ends of the range from {_range(curve)}."
    ]


def _order(
    curve: Curve, strain: FloatArray, tolerance: float
) -> tuple[npt.NDArray[np.intp], list[str]]:
    """Stable order of strains that do not truly run backwards, and notices."""
    backwards = np.maximum.accumulate(strain) - strain
    worst = int(np.argmax(backwards))
    if backwards[worst] > tolerance:
        raise InputError(
            f"{curve.place}: data row {worst + 1}: found strain {strain[worst]:g}, which runs "
            f"backwards by {backwards[worst]:.2g}, expected increasing strain "
            f"(within {tolerance:.2g})."
        )
    order = np.argsort(strain, kind="stable")
    if backwards[worst] == 0:
        return order, []
    return order, [
        f"{curve.name}: {count_points(np.count_nonzero(backwards))} out of order by at most "
        f"{backwards[worst]:.2g} in strain sorted."
    ]


def _dropped(curve: Curve, number: int) -> list[str]:
    if number == 0:
        return []
    return [
        f"{curve.name}: {count_points(number)} at zero strain dropped, because the model is at "
        "rest there and its stress is zero whatever the parameters."
    ]


def _range(curve: Curve) -> str:
    upper = "the end" if np.isinf(curve.upper) else f"{curve.upper:g}"
    return f"{curve.lower:g} to {upper}"

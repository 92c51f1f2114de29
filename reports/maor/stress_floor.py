"""What the stress floor of the piezometer decides in fits of an oscillating test.

The floor is a number of the prior file that nobody has measured. Draws of the posterior are solved
again under other floors: what their grains become, and, by the change of their likelihood, whether
the posterior would be another one.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from common import Fitted, FloatArray, central, interval, parameter_draws
from scipy.special import softmax

from pyburgers import PageSection, PageTable, SamplingError, SolverOptions, simulate

FLOOR = "piezometer_stress_floor"

FLOORS = (0.1e6, 1e6, 10e6)
"""Pa."""

SOLVER = SolverOptions(tolerance=1e-7, max_num_steps=100_000)
"""Errors of grain sizes are far below what a floor changes."""

SOLVED_DRAWS = 40
"""Draws of the posterior that are solved under each floor."""

MATTERS = 1.1
"""Factor between median grain sizes from which the floor is said to decide them."""

ALIKE = 0.5
"""Share of effective draws above which the posterior under another floor is the same."""


@dataclass(frozen=True, eq=False)
class FloorEffect:
    """Draws of one fit under one floor (Pa): last grain sizes (m) of those that have a solution.

    The effective share is that of the draws once they are weighed for this floor: 1 where the
    posterior is that of the fit.
    """

    floor: float
    grain_size: FloatArray
    effective_share: float
    n_unsolved: int


def floor_effects(fit: Fitted) -> tuple[FloorEffect, ...]:
    """Solve draws of a fit under each of `FLOORS`; raise SamplingError if none has a solution."""
    free = {name: parameter_draws(fit, name) for name in fit.priors.free}
    known = {name: prior.location for name, prior in fit.priors.priors.items() if prior.is_fixed}
    size = next(iter(free.values())).size
    chosen = np.unique(np.linspace(0, size - 1, SOLVED_DRAWS).round().astype(int))
    points = [known | {name: float(drawn[k]) for name, drawn in free.items()} for k in chosen]
    as_fitted = [_solved(fit, point) for point in points]
    effects = []
    for floor in FLOORS:
        pairs = [
            (before, after)
            for before, point in zip(as_fitted, points, strict=True)
            if (after := _solved(fit, point | {FLOOR: floor})) is not None and before is not None
        ]
        if not pairs:
            raise SamplingError(
                f"{fit.experiment.id}: none of {len(points)} draws has a solution with a stress "
                f"floor of {floor * 1e-6:g} MPa."
            )
        # Only the likelihood knows the floor: its ratio is the weight of a draw.
        weights = softmax([after[1] - before[1] for before, after in pairs])
        effects.append(
            FloorEffect(
                floor=floor,
                grain_size=np.array([after[0] for _, after in pairs]),
                effective_share=float(1 / np.sum(weights**2) / len(pairs)),
                n_unsolved=len(points) - len(pairs),
            )
        )
    return tuple(effects)


def stress_floor_section(fits: Mapping[str, Fitted]) -> PageSection:
    """Return what the stress floor decides under each treatment of the background."""
    effects = {treatment: floor_effects(fit) for treatment, fit in fits.items()}
    floor = next(iter(fits.values())).priors[FLOOR].location * 1e-6
    each = [(treatment, one) for treatment, found in effects.items() for one in found]
    table = PageTable(
        "floors",
        "Draws of each fit, solved under other floors",
        pd.DataFrame([_shown(*one) for one in each]),
        pd.DataFrame([_saved(*one) for one in each]),
        words=("background",),
        folded=True,
    )
    return PageSection(
        key="stress_floor",
        title="What the stress floor of the piezometer decides",
        details=(
            "At zero stress the piezometer has no value. The prior file gives it a floor, "
            f"{floor:g} MPa, that no measurement supports. Here {SOLVED_DRAWS} "
            "draws of each fit are solved again under other floors. The share of effective draws "
            "says what is left of them once each is weighed by its likelihood there: near 1 the "
            "posterior of the parameters would be the same, near 0 a fit of its own is needed.",
        ),
        paragraphs=tuple(sentence(treatment, found) for treatment, found in effects.items()),
        tables=(table,),
        after_fits=True,
    )


def sentence(treatment: str, effects: tuple[FloorEffect, ...]) -> str:
    """Say in words whether the floor decides grain size, and whether the data notice."""
    medians = [float(np.median(effect.grain_size)) * 1e6 for effect in effects]
    floors = ", ".join(f"{effect.floor * 1e-6:g}" for effect in effects)
    sizes = f"{', '.join(f'{median:.3g}' for median in medians)} µm"
    found = f"grains end at {sizes} for floors of {floors} MPa"
    if max(medians) < MATTERS * min(medians):
        return f"With the background {treatment} the floor does not matter: {found}."
    share = min(effect.effective_share for effect in effects)
    seen = (
        "and the data cannot tell the floors apart: the grain size is an assumption, not a result"
        if share > ALIKE
        else "and with it the posterior: fit again with the floor that you mean"
    )
    return f"With the background {treatment} the floor decides the grain size, {seen} ({found})."


def _solved(fit: Fitted, values: Mapping[str, float]) -> tuple[float, float] | None:
    """Grain size at the end (m) and log likelihood; None where there is no solution."""
    end = fit.posterior["predictions"]["time"].to_numpy()[-1:]
    try:
        solution = simulate(fit.experiment, values, at=end, solver=SOLVER)
    except SamplingError:
        return None  # counted
    return float(solution["grain_size_m"].iloc[-1]), solution.attrs["log_likelihood"]


def _shown(treatment: str, effect: FloorEffect) -> dict[str, str]:
    return {
        "background": treatment,
        "floor (MPa)": f"{effect.floor * 1e-6:g}",
        "grain size at the end (µm)": interval(effect.grain_size * 1e6, ".3g"),
        "effective draws": f"{100 * effect.effective_share:.0f} %",
        "without solution": str(effect.n_unsolved),
    }


def _saved(treatment: str, effect: FloorEffect) -> dict[str, object]:
    low, median, high = central(effect.grain_size)
    return {
        "background": treatment,
        "floor_Pa": effect.floor,
        "grain_size_m_q5": low,
        "grain_size_m_median": median,
        "grain_size_m_q95": high,
        "effective_share": effect.effective_share,
        "n_unsolved": effect.n_unsolved,
    }

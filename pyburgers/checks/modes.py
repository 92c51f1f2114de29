"""Check of the sampling that chains which begin at one mode cannot make among themselves."""

import numpy as np
import pandas as pd
import xarray as xr

from pyburgers.checks.fit_checks import CheckedDraws, CheckKind, Finding, Outcome, check
from pyburgers.model.display import shown_quantity, unit_after_number
from pyburgers.posterior.labelled_draws import groups_of_tests
from pyburgers.sampling.manifest import OtherMode

LEAST_WEIGHT = 0.01
"""Over that of the mode where chains begin: below it a mode is no part of what is reported."""

REACH = 0.25
"""Of the range of the draws, beyond which a value counts as one that no draw comes near."""


@check("other modes", CheckKind.SAMPLING)
def check_other_modes(draws: CheckedDraws) -> Finding:
    """Draws reach every mode that was met: R-hat is blind to one that no chain begins at."""
    table = pd.DataFrame(
        [
            {"weight": 1.0, "parameter": "", "value": np.nan, "beyond": -np.inf},
            *(_row(mode, draws.posterior) for mode in draws.other_modes),
        ],
        columns=["weight", "parameter", "value", "least_draw", "largest_draw", "beyond"],
        index=pd.RangeIndex(1, len(draws.other_modes) + 2, name="mode"),
    )
    missed = table[(table["weight"] >= LEAST_WEIGHT) & (table["beyond"] > REACH)]
    if missed.empty:
        met = (
            "Draws come near every mode of some weight that the climbs to the highest one met."
            if draws.other_modes
            else "The climbs to the posterior mode met no other one."
        )
        return Finding(Outcome.YES, table, met)
    worst = missed.sort_values("weight", kind="stable").iloc[-1]
    name, quantity = worst["parameter"], shown_quantity(worst["parameter"])
    value, low, high = (
        f"{worst[column] * quantity.display_factor:.3g}"
        for column in ("value", "least_draw", "largest_draw")
    )
    unit = unit_after_number(quantity)
    return Finding(
        Outcome.NO,
        table,
        f"There is another mode, with an estimated {worst['weight']:.2g} times the probability of "
        f"the one where chains began: {name} is {value}{unit} there, and no draw comes near (they "
        f"lie between {low} and {high}{unit})",
        f"say in the prior of {name} which of them is meant, and report each",
        unusable=bool(worst["weight"] > 1),
    )


def _row(mode: OtherMode, posterior: xr.DataTree) -> dict[str, float | str]:
    """Return the weight of a mode, and its parameter furthest beyond all draws, in their range."""
    rows: list[dict[str, float | str]] = []
    for values, test in zip(mode.values.values(), groups_of_tests(posterior).values(), strict=True):
        for name, value in values.items():
            drawn = test["posterior"].to_dataset()[name]
            low, high = float(drawn.min()), float(drawn.max())
            positive = min(value, low) > 0
            place, first, last = np.log([value, low, high]) if positive else (value, low, high)
            outside = max(first - place, place - last)
            rows.append(
                {
                    "weight": float(np.exp(mode.log_weight)),
                    "parameter": name,
                    "value": value,
                    "least_draw": low,
                    "largest_draw": high,
                    "beyond": float(outside / (last - first)) if last > first else np.inf,
                }
            )
    return max(rows, key=lambda row: row["beyond"])

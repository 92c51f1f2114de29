"""Minimum creep rates of a fit of a loading history, and the strains at them."""

import numpy as np
import numpy.typing as npt
import pandas as pd
from markupsafe import Markup

from pyburgers.common.draws import all_draws
from pyburgers.common.units import number, rounded
from pyburgers.drawing.page_parts import PageTable
from pyburgers.model.display import STRAIN_FACTOR, STRAIN_UNIT, STRESS_FACTOR, STRESS_UNIT
from pyburgers.protocols.loading_history.figures import loading_history_test, stages_of_times
from pyburgers.protocols.protocol import FittedTest

FloatArray = npt.NDArray[np.float64]

AT_THE_END = 0.99
"""Share of a stage's duration behind which a minimum is that of a rate that still falls."""


def minimum_rates(fit: FittedTest) -> pd.DataFrame:
    """Return the minimum strain rate of every stage of constant stress that creeps forward.

    Returns
    -------
    DataFrame
        A row for each stage; columns stage (from 1), stress_Pa, rate_per_s, rate_q5_per_s,
        rate_q95_per_s, strain, strain_q5, strain_q95 (medians and quantiles over the draws) and
        still_falling, the share of draws whose rate is least at the end of the stage.
    """
    experiment = loading_history_test(fit)
    predictions = fit.posterior["predictions"].to_dataset()
    time = predictions["time"].to_numpy()
    rate, strain = (
        all_draws(predictions[name]).astype(np.float64) for name in ("strain_rate", "strain")
    )
    stage_of = stages_of_times(experiment, time)
    rows = []
    for number_of_stage, stage in enumerate(experiment.stages):
        here = np.flatnonzero(stage_of == number_of_stage)
        forward = (rate[:, here] > 0).all(axis=1)
        if stage.control != "stress" or stage.value <= 0 or not forward.any():
            continue
        least = here[rate[:, here].argmin(axis=1)]
        draws = np.arange(rate.shape[0])
        low, middle, high = np.quantile(
            [rate[draws, least], strain[draws, least]], [0.05, 0.5, 0.95], axis=1
        )
        late = stage.start_time + AT_THE_END * (stage.end_time - stage.start_time)
        rows.append(
            {
                "stage": number_of_stage + 1,
                "stress_Pa": stage.value,
                "rate_per_s": middle[0],
                "rate_q5_per_s": low[0],
                "rate_q95_per_s": high[0],
                "strain": middle[1],
                "strain_q5": low[1],
                "strain_q95": high[1],
                "still_falling": float(np.mean(time[least] >= late)),
            }
        )
    return pd.DataFrame(rows)


def minimum_rate_table(fit: FittedTest) -> tuple[PageTable, ...]:
    """Return the table of minimum creep rates, or none where nothing creeps at constant stress."""
    found = minimum_rates(fit)
    if found.empty:
        return ()
    shown = pd.DataFrame(
        {
            "stage": found["stage"].astype(str),
            f"stress ({STRESS_UNIT})": [number(v * STRESS_FACTOR) for v in found["stress_Pa"]],
            "minimum rate (1/s)": [f"{v:.3g}" for v in found["rate_per_s"]],
            "5 to 95 %": [
                f"{low:.3g} to {high:.3g}"
                for low, high in zip(found["rate_q5_per_s"], found["rate_q95_per_s"], strict=True)
            ],
            f"strain there ({STRAIN_UNIT})": [
                rounded(STRAIN_FACTOR * v, STRAIN_FACTOR * (high - low))
                for v, low, high in zip(
                    found["strain"], found["strain_q5"], found["strain_q95"], strict=True
                )
            ],
            "strain, 5 to 95 %": [
                f"{STRAIN_FACTOR * low:.3g} to {STRAIN_FACTOR * high:.3g}"
                for low, high in zip(found["strain_q5"], found["strain_q95"], strict=True)
            ],
            "least at the end of the stage": [f"{v:.0%} of draws" for v in found["still_falling"]],
        }
    )
    return (
        PageTable(
            "minimum_rates",
            "Minimum creep rates",
            shown,
            found,
            text=Markup(
                "Of the solutions, for draws from the posterior; noise takes no part. Where the "
                "rate is least at the end of a stage it had not reached its minimum yet."
            ),
        ),
    )

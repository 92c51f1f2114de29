"""Whether what the model leaves over looks like a trend: neighbouring residuals go together.

At each draw the lag-1 autocorrelation of observed residuals along the clock, about zero, is
compared with that of replicated ones (a posterior predictive check of a realised discrepancy,
Gelman, Meng and Stern 1996, Statistica Sinica 6, 733-807). Pairs across a step of the rate do not
count. Replicates of residuals that may correlate do so too.
"""

from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from pyburgers.checks.fit_checks import (
    LEAST_DRAWS,
    CheckedDraws,
    CheckKind,
    Finding,
    Outcome,
    check,
)
from pyburgers.posterior.labelled_draws import TESTS, response_in
from pyburgers.protocols.protocol import protocols

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

LEVEL = 0.01
"""Probability at which the check fails, over the number of tests. Draws of the posterior follow the
data, so that fewer than 1 in 100 correct models fail: 22 of 6000 data sets from the priors, of
PIL40, PIL72 and the measured tests 4506 and 4581, the model linearised about one solution each."""


@check("residual trend", CheckKind.DESCRIPTION, least_draws=LEAST_DRAWS)
def check_residual_trend(draws: CheckedDraws) -> Finding:
    """Neighbouring residuals go together no more than replicated ones do."""
    posterior = draws.posterior
    several = TESTS in posterior.children
    tests = posterior[TESTS].children if several else {"the test": posterior}
    table = pd.DataFrame.from_dict({name: _row(test) for name, test in tests.items()}, "index")
    table = table.rename_axis("test")
    worst = table.iloc[int(table["probability"].argmin())]
    found = f"neighbouring residuals of {worst.name} correlate with {worst['autocorrelation']:.2f}"
    expected = f"at most {worst['at_most']:.2f} expected of a correct model"
    if worst["probability"] > LEVEL / len(table):
        return Finding(Outcome.YES, table, f"No trend: {found} ({expected}).")
    return Finding(
        Outcome.NO,
        table,
        f"The residuals look like a trend: {found} ({expected}), and {worst['points_in_run']} in a "
        f"row have one sign, from {worst['run']}: the model misses the shape of the curve there, "
        "and intervals are too narrow",
        "try another law (--variant kelvin=power_law), a joint fit with other tests, or residuals "
        "that may correlate (--variant residuals=autocorrelated)",
    )


def _row(test: xr.DataTree) -> dict[str, Any]:
    """Autocorrelations of a test, and its longest run of residuals of one sign."""
    model = response_in(test, "model_response")
    observed, replicated = (
        (response_in(test, group) - model).transpose("chain", "draw", "point").to_numpy()
        for group in ("observed_data", "posterior_predictive")
    )
    along = test["constant_data"].to_dataset()
    clock = next(p.clock for p in protocols().values() if p.clock.name in test["predictions"].dims)
    segment = along["segment"] if "segment" in along else xr.zeros_like(along[clock.name])
    joined = np.diff(segment) == 0
    found, of_replicates = (autocorrelation(each, joined) for each in (observed, replicated))
    run = longest_run(observed.mean((0, 1)), joined)
    start, end = clock.display_factor * along[clock.name].to_numpy()[list(run)]
    return {
        "autocorrelation": float(found.mean()),
        "at_most": float(np.quantile(of_replicates, 1.0 - LEVEL)),
        "probability": float((of_replicates >= found).mean()),
        "points_in_run": run[1] - run[0] + 1,
        "run": f"{clock.name} {start:.3g} to {end:.3g} {clock.display_unit}",
    }


def autocorrelation(residuals: FloatArray, joined: BoolArray) -> FloatArray:
    """Lag-1 autocorrelation about zero.

    Parameters
    ----------
    residuals : array, shape (..., n)
        Along the clock.
    joined : array of bool, shape (n - 1,)
        Whether a point and the next one count as a pair.

    Returns
    -------
    array, shape (...,)
    """
    pairs = residuals[..., 1:] * residuals[..., :-1]
    found: FloatArray = pairs @ joined / (residuals**2).sum(-1)
    return found


def longest_run(residuals: FloatArray, joined: BoolArray) -> tuple[int, int]:
    """Return the first and the last point, from 0, of the longest run of one sign in one segment.

    Parameters
    ----------
    residuals : array, shape (n,)
        Along the clock.
    joined : array of bool, shape (n - 1,)
        As for `autocorrelation`.
    """
    ends = np.flatnonzero((np.diff(np.sign(residuals)) != 0) | ~joined) + 1
    edges = np.concatenate([[0], ends, [residuals.size]])
    longest = int(np.diff(edges).argmax())
    return int(edges[longest]), int(edges[longest + 1]) - 1

"""What figures of the posterior show, in a sentence, for those who cannot see them."""

import numpy as np
from scipy import stats

from pyburgers.common.draws import all_draws
from pyburgers.kinds.kind import FittedTest
from pyburgers.model.display import shown_quantity
from pyburgers.page.decades import shown_draws
from pyburgers.posterior.labelled_draws import (
    convergence_table,
    free_parameters,
)


def narrowed(fit: FittedTest) -> str:
    """Say which quantity is narrowest beside its prior, and which is widest."""
    share = {name: shown_draws(fit, name).width_beside_prior for name in fit.priors.free}
    least, most = min(share, key=share.__getitem__), max(share, key=share.__getitem__)
    return (
        f"{shown_quantity(least).label} is narrowest beside its prior ({share[least]:.0%} of its "
        f"standard deviation), {shown_quantity(most).label} widest ({share[most]:.0%})."
    )


def strongest_trade_off(fit: FittedTest) -> str:
    """Name the two quantities that go together most closely."""
    draws = fit.posterior["posterior"].to_dataset()
    names = free_parameters(fit.posterior)
    ranks = np.array([stats.rankdata(all_draws(draws[name])) for name in names])
    divergent = int(fit.posterior["sample_stats"].to_dataset()["diverging"].sum())
    said = f"{divergent} divergent draws."
    if len(names) < 2:
        return said
    correlation = np.triu(np.corrcoef(ranks), 1)
    one, other = divmod(int(np.abs(correlation).argmax()), len(names))
    labels = " and ".join(shown_quantity(names[k]).label for k in (one, other))
    return f"{labels} go together most, rank correlation {correlation[one, other]:+.2f}; {said}"


def agreement(fit: FittedTest) -> str:
    """Say how far chains agree."""
    if fit.posterior["posterior"].sizes["chain"] == 1:
        return "one chain, with none to compare it with."
    rhat = convergence_table(fit.posterior)["rhat"].fillna(np.inf)
    return f"largest R-hat {rhat.max():.3f}, of {rhat.idxmax()}."

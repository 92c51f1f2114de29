"""What the page of a campaign shows: complete fits, how far all are, and whether seeds agree."""

import logging
import math
from collections.abc import Mapping
from itertools import groupby
from pathlib import Path

import pandas as pd

from pyburgers.common.errors import InputError
from pyburgers.drawing.page_parts import PageSection, PageTable
from pyburgers.fitting.campaign import (
    DAMAGED,
    Campaign,
    Combination,
    run_folder,
    shown_status_table,
    status_table,
)
from pyburgers.fitting.fit import Fit
from pyburgers.sampling.manifest import COMPLETE

logger = logging.getLogger(__name__)


def shown_fits(campaign: Campaign, out: Path) -> tuple[list[Fit], PageSection] | None:
    """Return complete fits of a campaign, one seed a model, and the part about all; or None."""
    table = status_table(campaign, out)
    complete: dict[Combination, Fit] = {}
    for one in campaign.tasks:
        if table["status"][one.name] == COMPLETE:
            try:
                complete[one] = Fit.load(run_folder(out, one))
            except InputError as error:
                logger.info(f"{one.name} is not on the page: {error}")
                table.loc[one.name, "status"] = DAMAGED
    if not complete:
        return None
    first, rows = [], []
    for (test, variant, priors), group in groupby(
        complete, key=lambda one: (one.test, one.variant, one.priors)
    ):
        fits = {one.seed: complete[one] for one in group}
        first.append(next(iter(fits.values())))
        rows.append(
            {
                "test": test,
                "variant": variant,
                "priors": priors,
                "seeds": " ".join(map(str, fits)),
                "between_seeds": _between_seeds(fits),
            }
        )
    return first, _section(table, pd.DataFrame(rows))


def _between_seeds(fits: Mapping[int, Fit]) -> float:
    """Largest difference of a posterior mean between seeds, in posterior sd; NaN of one seed."""
    if len(fits) == 1:
        return math.nan
    tables = [fit.summary("SI") for fit in fits.values()]
    means = pd.concat([table["mean"] for table in tables], axis=1)
    spread = (means.max(axis=1) - means.min(axis=1)) / tables[0]["sd"]
    return float(spread.max())


def _section(status: pd.DataFrame, models: pd.DataFrame) -> PageSection:
    """Return the part of the page about how far the campaign is and whether seeds agree."""
    n_done = int((status["status"] == COMPLETE).sum())
    between = [
        "one seed" if math.isnan(found) else f"{found:.2f}" for found in models["between_seeds"]
    ]
    shown_models = models.drop(columns="between_seeds")
    return PageSection(
        key="campaign",
        title="The campaign",
        paragraphs=(f"{n_done} of {len(status)} fits are complete.",),
        tables=(
            PageTable(
                "status",
                "How far each fit is",
                shown_status_table(status),
                status.reset_index(),
                words=("run", "status"),
            ),
            PageTable(
                "models",
                "Models, each shown by the fit of its first seed",
                shown_models.assign(**{"largest difference between seeds (sd)": between}),
                models,
                words=("test", "variant", "priors", "seeds"),
            ),
        ),
    )

"""What a page says about one fit: its tables, its figures, and what is told of its making."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from pyburgers.checks.fit_checks import CheckResult
from pyburgers.checks.prior_influence import Influence, Origin, influence_numbers
from pyburgers.common.atomic_files import write_text
from pyburgers.drawing.page_parts import PageTable
from pyburgers.fitting.fit import Fit
from pyburgers.model.parameters import PARAMETER_BY_NAME
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.protocol import Protocol, protocol_of
from pyburgers.report import tables
from pyburgers.report.illustrations import Illustration, picture_file
from pyburgers.report.names import file_key
from pyburgers.report.overview import Entry, entry_of
from pyburgers.report.posterior_figures import figures_for


@dataclass(frozen=True, eq=False)
class Section:
    """What the page says about one fit.

    Attributes
    ----------
    key : str
        Name of its files and its anchor, unique on the page.
    name : str
        How the page calls it.
    fit : Fit
        The fit.
    entry : Entry
        What the top of the page says about it.
    parameters, priors, sampler : DataFrame
        Tables as text.
    fixed : tuple of dict
        What is not inferred: texts by symbol, quantity, mean, unit.
    truth : DataFrame or None
        Comparison with the truth (`pyburgers.report.tables.truth_table`), for synthetic data.
    more_tables : tuple of PageTable
        Tables of the protocol.
    illustrations : tuple of Illustration
        Figures.
    same_data_as : Section or None
        One before it on the page that tells what its data are.
    """

    key: str
    name: str
    fit: Fit
    entry: Entry
    parameters: pd.DataFrame
    priors: pd.DataFrame
    sampler: pd.DataFrame
    fixed: tuple[dict[str, str], ...]
    truth: pd.DataFrame | None
    more_tables: tuple[PageTable, ...]
    illustrations: tuple[Illustration, ...]
    same_data_as: "Section | None" = None

    @property
    def experiment(self) -> Experiment:
        """The experiment of the fit."""
        return self.fit.experiment

    @property
    def protocol(self) -> Protocol[Any]:
        """What kind of test it is."""
        return protocol_of(self.experiment)

    @property
    def about_data(self) -> tuple[object, ...]:
        """What the page tells about the data."""
        one = self.experiment
        known = (one.material, one.temperature, one.initial_grain_size)
        return *known, one.provenance, dict(one.metadata), list(self.protocol.facts(one))

    @property
    def how_made(self) -> tuple[object, ...]:
        """What the page tells of the making of the fit but for time and hash."""
        entries = (
            "command",
            "sampler",
            "more_draws",
            "noisy",
            "refits",
            "shortened",
            "coordinates",
        )
        fit, told = self.fit, [self.fit.manifest.get(entry) for entry in entries]
        flow_law = fit.priors.flow_law and fit.priors.flow_law.source
        return fit.variant, fit.priors.title, flow_law, len(self.sampler), repr(told)

    @property
    def not_by_data(self) -> dict[str, list[bool]]:
        """Rows of the parameters that are the prior's, or about which prior and data disagree."""
        if tables.DECISION not in self.parameters:
            return {}
        doubtful = (tables.DECIDED_BY[one] for one in (Origin.PRIOR, Origin.DISAGREEMENT))
        return {tables.DECISION: self.parameters[tables.DECISION].isin(tuple(doubtful)).tolist()}

    @property
    def passed(self) -> list[CheckResult]:
        """Checks that passed."""
        return [one for one in self.entry.checks if one.passed]


def write_section(name: str, fit: Fit, out: Path) -> Section:
    """Write the tables of one fit, draw its figures, and gather what the page shows of it.

    Parameters
    ----------
    name : str
        How the page calls it.
    fit : Fit
        Of one test, or of a test of a joint fit.
    out : Path
        Folder of the page.
    """
    key = file_key(name)
    summary, checks = fit.summary("SI"), fit.checks()
    truth = tables.truth_table(fit)
    sampler = tables.sampler_table(fit)
    files = {
        "summary": summary.reset_index(),
        "checks": tables.checks_table(checks),
        "priors": tables.prior_table(fit.priors),
        "sampler": sampler,
    }
    if truth is not None:
        files["truth"] = truth.reset_index()
    influences: Mapping[str, Influence] = fit.influences().get(fit.problem.name, {})
    if influences:
        files["influence"] = influence_numbers(influences).reset_index()
    more_tables = protocol_of(fit.experiment).tables(fit)
    files |= {table.name: table.saved for table in more_tables}
    for table_name, table in files.items():
        write_text(out / "tables" / f"{key}_{table_name}.csv", table.to_csv(index=False))
    return Section(
        key=key,
        name=name,
        fit=fit,
        entry=entry_of(key, name, fit, checks, influences),
        parameters=tables.result_table(summary, fit.priors, influences, truth),
        priors=files["priors"],
        sampler=sampler,
        fixed=tuple(
            tables.fixed_row(PARAMETER_BY_NAME[name], prior)
            for name, prior in fit.priors.priors.items()
            if prior.is_fixed
        ),
        truth=truth,
        more_tables=more_tables,
        illustrations=tuple(
            Illustration(
                recipe,
                recipe.draw(fit),
                picture_file(out, key, recipe),
                f"{recipe.title}, {name}: {recipe.result(fit)}",
            )
            for recipe in figures_for(fit.experiment)
        ),
    )

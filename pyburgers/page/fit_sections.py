"""What a page says about a fit, and about fits of the same data, which share a section."""

import itertools
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from pyburgers.checks.fit_checks import CheckKind, Outcome
from pyburgers.checks.prior_influence import Origin, influence_numbers
from pyburgers.common.atomic_files import write_text
from pyburgers.common.csv_tables import csv_text
from pyburgers.comparison.conclusions import shift_sentences, what_a_yes_leaves_open
from pyburgers.comparison.same_data import data_hash
from pyburgers.drawing.page_parts import PageTable
from pyburgers.drawing.view import view_of
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.program_data import fixed_in_effect
from pyburgers.model.display import shown_quantity
from pyburgers.model.neighbouring_laws import redefined
from pyburgers.model.parameters import PARAMETER_BY_NAME
from pyburgers.page import tables
from pyburgers.page.illustrations import Illustration, illustrate
from pyburgers.page.methods import methods_text
from pyburgers.page.names import alike
from pyburgers.page.overview import Entry, entry_of
from pyburgers.page.posterior_figures import figures_for

NAMED = ["symbol", "quantity", "unit"]
"""Columns of a table of parameters that say what a row is about."""

NOT_THE_SAME = " (not the same in all fits)"
"""Behind a quantity that means something else under the law of another fit."""


@dataclass(frozen=True, eq=False)
class Section:
    """What the page says about one fit; `fixed` has texts by symbol, quantity, mean and unit.

    `same_data_as`: a section before it on the page that tells what its data are, else None.
    """

    key: str
    name: str
    fit: Fit
    entry: Entry
    parameters: pd.DataFrame
    priors: pd.DataFrame
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
    def facts(self) -> list[tuple[str, str]]:
        """What the page says about the test: names and values."""
        return list(view_of(self.experiment).facts(self.experiment))

    @property
    def about_test(self) -> str:
        """Material, kind and temperature of the test in words."""
        one = self.experiment
        kind = one.protocol.replace("_", " ")
        return f"{one.material}, {kind}, {one.temperature_text}"

    @property
    def found(self) -> list[tuple[str, list[dict[Hashable, Any]]]]:
        """Return openings of sentences with rows that data decide; none unless sampled well."""
        outcome = self.entry.verdicts[CheckKind.SAMPLING].outcome
        if tables.DECISION not in self.parameters or outcome is not Outcome.YES:
            return []
        rows = self.parameters.to_dict("records")
        decided = [
            (opening, [row for row in rows if row[tables.DECISION].startswith(origin)])
            for opening, origin in (
                ("The data decide", Origin.DATA),
                ("Data and priors together decide", Origin.BOTH),
            )
        ]
        return [one for one in decided if one[1]] or [("The data decide no number.", [])]

    @property
    def about_data(self) -> tuple[object, ...]:
        """What the page tells about the data."""
        one = self.experiment
        known = (one.material, one.temperature_text, one.initial_grain_size)
        return *known, one.provenance, dict(one.metadata), self.facts

    @property
    def methods(self) -> str:
        """How the fit was made and what its checks found."""
        return methods_text(self.fit, self.entry.checks, self.entry.verdicts)


def write_section(
    key: str, name: str, fit: Fit, out: Path, *, elsewhere: Sequence[str] = ()
) -> Section:
    """Write the tables of one fit, and gather what the page shows of it.

    Figures leave out panels of parameters that are `elsewhere` on the page.
    """
    summary, checks = fit.summary("SI"), fit.checks()
    truth = tables.truth_table(fit)
    files = {
        "summary": summary.reset_index(),
        "checks": tables.checks_table(checks),
        "priors": tables.prior_table(fit.priors),
        "sampler": tables.sampler_table(fit),
    }
    if truth is not None:
        files["truth"] = truth.reset_index()
    influences = fit.decisions()
    if influences:
        files["influence"] = influence_numbers(influences).reset_index()
    parameters = tables.result_table(summary, fit.priors, truth)
    quoted = tables.quoted(fit, summary, parameters, influences)
    more_tables = view_of(fit.experiment).tables(fit)
    files |= {table.name: table.saved for table in more_tables}
    for table_name, table in files.items():
        write_text(out / "tables" / f"{key}_{table_name}.csv", csv_text(table))
    return Section(
        key=key,
        name=name,
        fit=fit,
        entry=entry_of(key, name, fit, checks, influences),
        parameters=parameters.assign(**{tables.VALUE: quoted}),
        priors=files["priors"],
        fixed=tuple(
            tables.fixed_row(PARAMETER_BY_NAME[prior.parameter], prior)
            for prior in fixed_in_effect(fit)
        ),
        truth=truth,
        more_tables=more_tables,
        illustrations=illustrate(figures_for(fit, elsewhere), out, key, name),
    )


@dataclass(frozen=True)
class Said:
    """Sentences `lines` on the fits named `of`; no names if the section is about one fit."""

    lines: tuple[str, ...]
    of: tuple[str, ...]
    outcome: Outcome | None = None


@dataclass(frozen=True, eq=False)
class SameData:
    """Fits of the same data: the section of each, at least one; the first is unfolded."""

    sections: tuple[Section, ...]

    @property
    def first(self) -> Section:
        """What is said of the first."""
        return self.sections[0]

    @property
    def others(self) -> tuple[Section, ...]:
        """What is said of the others."""
        return self.sections[1:]

    def answers(self, kind: CheckKind) -> list[Said]:
        """Say what speaks against a yes to a question, alike answers once."""
        told = alike(
            self.sections,
            lambda one: (one.entry.verdicts[kind].outcome, tuple(one.entry.doubts(kind))),
        )
        return [Said(lines, self._names(of), outcome) for (outcome, lines), of in told.items()]

    @property
    def left_open(self) -> tuple[str, ...]:
        """What a yes does not exclude, and commands; nothing beside a fit of another law."""
        if any(section.fit.variant != self.first.fit.variant for section in self.others):
            return ()
        told = (what_a_yes_leaves_open(section.fit) for section in self.sections)
        return next(filter(None, told), ())

    @property
    def conflicts(self) -> list[Said]:
        """Say what prior and data disagree about, alike sentences once."""
        told = alike(self.sections, lambda one: one.entry.conflict)
        return [Said((text,), self._names(of)) for text, of in told.items() if text]

    @property
    def decisions(self) -> list[Said]:
        """Say which bounds and priors to mind, alike sentences once."""
        each = dict.fromkeys(text for one in self.sections for text in one.entry.decisions)
        return [
            Said((text,), self._names(one for one in self.sections if text in one.entry.decisions))
            for text in each
        ]

    @property
    def without_data(self) -> list[Said]:
        """Say which fits the data were kept from."""
        without = [one for one in self.sections if not one.fit.manifest["use_likelihood"]]
        return [Said((), self._names(without))] if without else []

    def _names(self, of: Iterable[Section]) -> tuple[str, ...]:
        """Names of fits; none where there is one fit."""
        return tuple(one.name for one in of) if self.others else ()

    @property
    def values(self) -> pd.DataFrame:
        """Return what data say of the parameters as text: rows not left to the prior in all.

        Several fits have a column each. There, the word prior takes the place of a number that its
        own prior decides. If neither data nor that prior decides, brackets say who does.
        """
        if not self.others:
            rows = self.first.parameters.filter([*NAMED, tables.VALUE, tables.DECISION])
            return self._rows(rows, left_to_prior=False)
        rows = _union(section.parameters[NAMED] for section in self.sections)
        for section in self.sections:
            told = dict(
                zip(section.parameters["symbol"], _in_one_cell(section.parameters), strict=True)
            )
            rows[section.name] = [told.get(symbol, "") for symbol in rows["symbol"]]
        differ = {
            shown_quantity(name).label
            for one, other in itertools.combinations(self.sections, 2)
            for name in redefined(one.fit.variant, other.fit.variant)
        }
        rows["quantity"] += [NOT_THE_SAME * (label in differ) for label in rows["quantity"]]
        return self._rows(rows, left_to_prior=False)

    @property
    def shifts(self) -> tuple[str, ...]:
        """How far parameters move between fits with data of the group that were sampled well."""
        with_data = [one for one in self.sections if one.fit.manifest["use_likelihood"]]
        usable = {
            one.name: one.fit
            for one in with_data
            if one.entry.verdicts[CheckKind.SAMPLING].outcome is Outcome.YES
        }
        if len(usable) < 2:
            return ()
        left_out = ", ".join(one.name for one in with_data if one.name not in usable)
        told = f"Left out, because the posterior was not sampled well: {left_out}."
        return (*shift_sentences(usable), *([told] if left_out else []))

    @property
    def left_to_prior(self) -> list[dict[Hashable, Any]]:
        """Symbols and quantities that are the prior's in every fit."""
        rows = _union(section.parameters[NAMED] for section in self.sections)
        return self._rows(rows, left_to_prior=True).to_dict("records")

    @property
    def doubtful(self) -> dict[str, list[bool]]:
        """Cells of `values` that the data do not decide, by column."""
        values = self.values
        return {
            column: [
                text.startswith(tables.DOUBTFUL)
                or (text.endswith("]") and f"[{Origin.BOTH}" not in text)
                for text in values[column]
            ]
            for column in map(str, values.columns)
            if column not in NAMED
        }

    def _rows(self, table: pd.DataFrame, *, left_to_prior: bool) -> pd.DataFrame:
        """Return the rows of quantities that are the prior's in every fit, or the others."""
        by_data = {
            symbol
            for section in self.sections
            for symbol, decided in zip(
                section.parameters["symbol"], _decided_by(section.parameters), strict=True
            )
            if not tables.is_own_prior(decided)
        }
        is_left = ~table["symbol"].isin(by_data)
        return table[is_left if left_to_prior else ~is_left].reset_index(drop=True)


def by_data(named: Iterable[tuple[str, str, Fit]]) -> list[list[tuple[str, str, Fit]]]:
    """Put fits of equal readings, also in being measured or computed, together in their order."""
    return [*alike(named, lambda one: (one[2].provenance.kind, data_hash(one[2]))).values()]


def _decided_by(parameters: pd.DataFrame) -> list[str]:
    """Say what decides each quantity, nothing without likelihood."""
    return list(parameters.get(tables.DECISION, [""] * len(parameters)))


def _in_one_cell(parameters: pd.DataFrame) -> list[str]:
    """Value of each quantity, and who decides it where the data do not."""
    cells = []
    for value, decided in zip(parameters[tables.VALUE], _decided_by(parameters), strict=True):
        doubted = (
            f"{value} [{decided}]" if decided.startswith((*tables.DOUBTFUL, Origin.BOTH)) else value
        )
        cells.append(decided if tables.is_own_prior(decided) else doubted)
    return cells


def _union(parts: Iterable[pd.DataFrame]) -> pd.DataFrame:
    """Rows of all tables, each once, in the order of the first that has them."""
    return pd.concat(list(parts)).drop_duplicates("symbol").reset_index(drop=True)

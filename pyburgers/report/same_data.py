"""Fits of the same data, which share a section: what is said of them, and their numbers."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import pandas as pd

from pyburgers.checks.fit_checks import CheckKind, Outcome
from pyburgers.checks.prior_influence import Origin
from pyburgers.comparison.same_data import data_hash
from pyburgers.fitting.fit import Fit
from pyburgers.report.fit_section import Section
from pyburgers.report.tables import DECIDED_BY, DECISION

NAMED = ["symbol", "quantity", "unit"]
"""Columns of a table of parameters that say what a row is about."""

OF_THE_PRIOR, DISAGREE = DECIDED_BY[Origin.PRIOR], DECIDED_BY[Origin.DISAGREEMENT]


@dataclass(frozen=True)
class Said:
    """What is said of one or several fits of the same data.

    Attributes
    ----------
    lines : tuple of str
        Sentences.
    of : tuple of str
        Names of the fits, none where the section is about one fit alone.
    outcome : Outcome or None
        The answer that the sentences are about.
    """

    lines: tuple[str, ...]
    of: tuple[str, ...]
    outcome: Outcome | None = None


@dataclass(frozen=True, eq=False)
class SameData:
    """Fits of the same data.

    Attributes
    ----------
    sections : tuple of Section
        What the page says about each, at least one; the first is unfolded.
    """

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
        told = [
            (section.entry.verdicts[kind].outcome, tuple(section.entry.doubts(kind)))
            for section in self.sections
        ]
        return [
            Said(lines, self._names(told, (outcome, lines)), outcome)
            for outcome, lines in dict.fromkeys(told)
        ]

    @property
    def conflicts(self) -> list[Said]:
        """Say what prior and data disagree about, alike sentences once."""
        told = [section.entry.conflict for section in self.sections]
        return [Said((text,), self._names(told, text)) for text in dict.fromkeys(told) if text]

    @property
    def without_data(self) -> list[Said]:
        """Say which fits the data were kept from."""
        told = [section.fit.manifest["use_likelihood"] for section in self.sections]
        return [] if all(told) else [Said((), self._names(told, False))]

    def _names(self, told: Sequence[object], this: object) -> tuple[str, ...]:
        """Names of the fits of which the same is told; none where there is one fit."""
        if not self.others:
            return ()
        pairs = zip(self.sections, told, strict=True)
        return tuple(section.name for section, one in pairs if one == this)

    @property
    def values(self) -> pd.DataFrame:
        """Return what data say of the parameters: rows that are not the prior's in every fit.

        Returns
        -------
        DataFrame
            Text. Columns symbol, quantity, unit; then mean, sd and, with a likelihood, what
            decides of the one fit, or mean ± sd of each of several, with the word prior in place
            of a number that is the prior's and an exclamation mark behind one about which prior
            and data disagree.
        """
        if not self.others:
            columns = [*NAMED, "mean", "sd", *([DECISION] if self._is_decided else [])]
            return self._rows(self.first.parameters[columns], left_to_prior=False)
        rows = _union(section.parameters[NAMED] for section in self.sections)
        for section in self.sections:
            told = dict(
                zip(section.parameters["symbol"], _in_one_cell(section.parameters), strict=True)
            )
            rows[section.name] = [told.get(symbol, "") for symbol in rows["symbol"]]
        return self._rows(rows, left_to_prior=False)

    @property
    def left_to_prior(self) -> list[dict[str, str]]:
        """Symbols and quantities that are the prior's in every fit."""
        rows = _union(section.parameters[NAMED] for section in self.sections)
        return [
            {str(key): str(value) for key, value in row.items()}
            for row in self._rows(rows, left_to_prior=True).to_dict("records")
        ]

    @property
    def doubtful(self) -> dict[str, list[bool]]:
        """Cells of `values` about which prior and data disagree, by column."""
        values = self.values
        return {
            column: [text == DISAGREE or text.endswith(" !") for text in values[column]]
            for column in map(str, values.columns)
            if column not in NAMED
        }

    @property
    def _is_decided(self) -> bool:
        return DECISION in self.first.parameters

    def _rows(self, table: pd.DataFrame, *, left_to_prior: bool) -> pd.DataFrame:
        """Return the rows of quantities that are the prior's in every fit, or the others."""
        by_data = {
            symbol
            for section in self.sections
            for symbol, decided in zip(
                section.parameters["symbol"], _decided_by(section.parameters), strict=True
            )
            if decided != OF_THE_PRIOR
        }
        is_left = ~table["symbol"].isin(by_data)
        return table[is_left if left_to_prior else ~is_left].reset_index(drop=True)


def by_data(named: Iterable[tuple[str, Fit]]) -> list[list[tuple[str, Fit]]]:
    """Put fits of the same data together, in the order of the first of each.

    Parameters
    ----------
    named : iterable of tuple of str and Fit
        Fits with their names.
    """
    found: dict[str, list[tuple[str, Fit]]] = {}
    for name, fit in named:
        found.setdefault(data_hash(fit), []).append((name, fit))
    return list(found.values())


def _decided_by(parameters: pd.DataFrame) -> list[str]:
    """Say what decides each quantity, nothing without likelihood."""
    return parameters[DECISION].tolist() if DECISION in parameters else [""] * len(parameters)


def _in_one_cell(parameters: pd.DataFrame) -> list[str]:
    """Mean ± sd of each quantity, and whether it is the prior's or disputed."""
    cells = []
    for row, decided in zip(parameters.to_dict("records"), _decided_by(parameters), strict=True):
        value = f"{row['mean']} ± {row['sd']}"
        disputed = f"{value} !" if decided == DISAGREE else value
        cells.append(OF_THE_PRIOR if decided == OF_THE_PRIOR else disputed)
    return cells


def _union(tables: Iterable[pd.DataFrame]) -> pd.DataFrame:
    """Rows of all tables, each once, in the order of the first that has them."""
    return pd.concat(list(tables)).drop_duplicates("symbol").reset_index(drop=True)

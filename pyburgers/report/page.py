"""One self-contained page about one or several fits, with its figures and tables as files."""

import base64
import importlib.metadata
import logging
import platform
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd
from matplotlib.figure import Figure

from pyburgers.checks.fit_checks import CheckKind, CheckResult, Outcome
from pyburgers.checks.prior_influence import (
    THRESHOLDS_TEXT,
    Influence,
    Origin,
    influence_numbers,
    influence_table,
)
from pyburgers.common.atomic_files import sha256_of_file, write_json, write_text
from pyburgers.common.errors import InputError
from pyburgers.common.processes import completed, number_of_processes
from pyburgers.common.toml_files import read_json
from pyburgers.drawing.page_parts import FigureText, PageSection, PageTable
from pyburgers.drawing.style import write_images
from pyburgers.fitting.fit import Fit
from pyburgers.model.display import shown_quantity
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.protocol import Protocol, protocol_of
from pyburgers.report import tables
from pyburgers.report.overview import (
    ANSWER_COLUMNS,
    CONFLICT_COLUMN,
    Entry,
    answers,
    bad_answers,
    entry_of,
    joint_entry,
    overview_table,
)
from pyburgers.report.posterior_figures import figures_for

logger = logging.getLogger(__name__)

REPORT_KIND = "pyburgers report"
"""What the manifest of a report says, so that no other manifest is overwritten."""

PIXELS_PER_INCH = 100

PACKAGES = ("pyburgers", "arviz", "jinja2", "matplotlib", "numpy", "pandas", "scipy", "xarray")


@dataclass(frozen=True, eq=False)
class Illustration:
    """A figure on the page.

    Attributes
    ----------
    text : FigureText
        Its name, title and caption.
    figure : Figure
        The figure itself.
    file : Path
        Where it is written as PNG; beside it as SVG.
    """

    text: FigureText
    figure: Figure
    file: Path

    @property
    def data_uri(self) -> str:
        """The written picture."""
        encoded = base64.b64encode(self.file.read_bytes()).decode("ascii")
        return f"data:image/png;base64,{encoded}"

    @property
    def width(self) -> int:
        """Width on the page (CSS pixels), the same size of letters for every figure."""
        return round(PIXELS_PER_INCH * self.figure.get_figwidth())


@dataclass(frozen=True, eq=False)
class Section:
    """What the page says about one fit.

    Attributes
    ----------
    key : str
        Name of its files and its anchor, unique on the page.
    fit : Fit
        The fit.
    checks : tuple of CheckResult
        Verdicts.
    entry : Entry
        What the top of the page says about it.
    parameters, priors, sampler : DataFrame
        Tables as text.
    influences : mapping of str to Influence
        What each quantity owes to prior and data; empty without likelihood.
    truth : DataFrame or None
        Comparison with the truth (`pyburgers.report.tables.truth_table`), for synthetic data.
    more_tables : tuple of PageTable
        Tables of the protocol.
    illustrations : tuple of Illustration
        Figures.
    """

    key: str
    fit: Fit
    checks: tuple[CheckResult, ...]
    entry: Entry
    parameters: pd.DataFrame
    priors: pd.DataFrame
    sampler: pd.DataFrame
    influences: Mapping[str, Influence]
    truth: pd.DataFrame | None
    more_tables: tuple[PageTable, ...]
    illustrations: tuple[Illustration, ...]

    @property
    def experiment(self) -> Experiment:
        """The experiment of the fit."""
        return self.fit.experiment

    @property
    def protocol(self) -> Protocol[Any]:
        """What kind of test it is."""
        return protocol_of(self.experiment)

    @property
    def from_prior(self) -> list[str]:
        """Quantities whose number is that of the prior."""
        return [
            shown_quantity(name).label
            for name, influence in self.influences.items()
            if influence.origin is Origin.PRIOR
        ]

    def checks_of(self, kind: CheckKind) -> list[CheckResult]:
        """Return the checks behind one of the two answers."""
        return [check for check in self.checks if check.check.kind is kind]


def write_report(
    fits: Sequence[Fit],
    out: Path,
    *,
    title: str,
    command: str,
    joints: Sequence[Fit] = (),
    extras: Sequence[PageSection] = (),
    jobs: int | None = 1,
) -> Path:
    """Write the page ``index.html``, ``figures/``, ``tables/`` and ``manifest.json``.

    The page needs no other file and no network. An earlier report in the same folder is replaced,
    file by file and each at once, the page last.

    Parameters
    ----------
    fits : sequence of Fit
        At least one, of single tests or of the tests of joint fits. Measured ones come first on
        the page.
    out : Path
        Folder, new or of an earlier report.
    title : str
        Heading of the page.
    command : str
        What makes the report again.
    joints : sequence of Fit
        Joint fits, whose parts of the page are among the extras.
    extras : sequence of PageSection
        Parts of the page beside the fits, in their order.
    jobs : int, optional
        Processes that write figures; None takes one for each core, which pays for many figures.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    InputError
        If there is no fit, or the folder cannot be written or holds something else.
    """
    if not fits:
        raise InputError(f"{out}: a report needs at least one run, found none.")
    _claim(out)
    write_json(out / "manifest.json", _manifest(fits, title, command))
    sections = []
    for key, fit in sorted(zip(page_keys(fits), fits, strict=True), key=_is_synthetic):
        logger.info(f"Writing the section of {key}.")
        sections.append(_write_section(key, fit, out))
    illustrated = []
    for extra in extras:
        logger.info(f"Writing the part {extra.title!r}.")
        illustrated.append((extra, _write_extra(extra, out)))
    of_fits = [one for section in sections for one in section.illustrations]
    of_extras = [one for _, figures in illustrated for one in figures]
    illustrations = [*of_fits, *of_extras]
    logger.info(f"Writing {len(illustrations)} figures.")
    _write_figures(illustrations, out, jobs)
    page = out / "index.html"
    entries = [
        *(
            joint_entry(joint_key(name), name, joint)
            for name, joint in zip(page_keys(joints), joints, strict=True)
        ),
        *(section.entry for section in sections),
    ]
    entries.sort(key=lambda entry: entry.is_synthetic)
    text = render_page(sections, illustrated, entries=entries, title=title, command=command)
    write_text(page, text)
    return page


def _is_synthetic(named: tuple[str, Fit]) -> bool:
    """Whether nobody measured the data of a fit with its name."""
    return named[1].experiment.provenance.kind == "synthetic"


def _write_figures(illustrations: Sequence[Illustration], out: Path, jobs: int | None) -> None:
    """Write every figure as PNG and SVG, most of the work of a page."""
    calls = {one.file: (one.figure, one.file) for one in illustrations}
    processes = number_of_processes(jobs, len(calls))
    if processes == 1:
        for figure, file in calls.values():
            write_images(figure, file)
        return
    for _ in completed(write_images, calls, processes=processes, folder=out):
        continue


def render_page(
    sections: Sequence[Section],
    extras: Sequence[tuple[PageSection, tuple[Illustration, ...]]],
    *,
    entries: Sequence[Entry],
    title: str,
    command: str,
) -> str:
    """Fill the page's template; everything that comes from files is escaped."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("pyburgers"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("report.html").render(
        title=title,
        command=command,
        sections=sections,
        extras=extras,
        entries=entries,
        overview=overview_table(entries),
        bad_answers=bad_answers(entries),
        answer_columns=[*ANSWER_COLUMNS.values(), CONFLICT_COLUMN],
        answers=answers(entries),
        alarms=[alarm for extra, _ in extras for alarm in extra.alarms],
        kinds=tuple(CheckKind),
        outcomes=Outcome,
        synthetic=[s for s in sections if s.experiment.provenance.kind == "synthetic"],
        written=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        version=importlib.metadata.version("pyburgers"),
        number_table=_number_table,
        thresholds=THRESHOLDS_TEXT,
        influence_table=influence_table,
        truth_table=tables.shown_truth_table,
    )


def _claim(out: Path) -> None:
    """Make the folders, and refuse one that holds a run or a page of another kind."""
    manifest = out / "manifest.json"
    if manifest.is_file():
        is_report = read_json(manifest).get("kind") == REPORT_KIND
    else:
        is_report = not (out / "index.html").exists()
    if not is_report:
        raise InputError(
            f"{out}: holds something else than a report (a run or a page), expected a new folder "
            "or one of an earlier report."
        )
    try:
        for folder in (out, out / "figures", out / "tables"):
            folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{out}: cannot be written ({error.strerror}).") from error


def page_keys(fits: Sequence[Fit]) -> list[str]:
    """Name each fit after its tests, and whether it is a part of a joint fit.

    Further ones have a number: the second A is A_run2.
    """
    seen: Counter[str] = Counter()
    keys = []
    for fit in fits:
        name = fit.problem.name + ("_joint" if fit.is_part else "")
        seen[name] += 1
        keys.append(name if seen[name] == 1 else f"{name}_run{seen[name]}")
    return keys


def joint_key(name: str) -> str:
    """Anchor of the part of a page about a joint fit, by its name."""
    return f"joint_{file_key(name)}"


def file_key(name: str) -> str:
    """Name without what a file name or an anchor had better not hold."""
    return name.replace("+", "_")


def _write_section(key: str, fit: Fit, out: Path) -> Section:
    """Write the tables of one fit, draw its figures, and gather what the page shows of it."""
    summary, checks = fit.summary(), fit.checks()
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
    for name, table in files.items():
        write_text(out / "tables" / f"{key}_{name}.csv", table.to_csv(index=False))
    return Section(
        key=key,
        fit=fit,
        checks=checks,
        entry=entry_of(key, fit, checks, influences),
        parameters=tables.parameter_table(summary, fit.priors),
        priors=files["priors"],
        sampler=sampler,
        influences=influences,
        truth=truth,
        more_tables=more_tables,
        illustrations=tuple(
            Illustration(recipe, recipe.draw(fit), _picture_file(out, key, recipe))
            for recipe in figures_for(fit.experiment)
        ),
    )


def _write_extra(extra: PageSection, out: Path) -> tuple[Illustration, ...]:
    """Write the tables of an extra section and draw its figures."""
    for table in extra.tables:
        name = f"{extra.key}_{table.name}.csv"
        write_text(out / "tables" / name, table.saved.to_csv(index=False))
    return tuple(
        Illustration(figure, figure.draw(), _picture_file(out, extra.key, figure))
        for figure in extra.figures
    )


def _picture_file(out: Path, key: str, text: FigureText) -> Path:
    return out / "figures" / f"{key}_{text.name}.png"


def _number_table(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table of numbers as text of four significant digits, its index as a column."""
    columns = table.reset_index(names=table.index.name or "index")
    if table.index.name is None:
        columns = columns.drop(columns="index")
    return columns.map(lambda cell: f"{cell:.4g}" if isinstance(cell, float) else str(cell))


def _manifest(fits: Sequence[Fit], title: str, command: str) -> dict[str, Any]:
    """Record what made the report and from what."""
    return {
        "kind": REPORT_KIND,
        "title": title,
        "command": command,
        "written": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": {
            "python": platform.python_version(),
            **{package: importlib.metadata.version(package) for package in PACKAGES},
        },
        "runs": [
            {
                "id": key,
                "directory": fit.directory.path.name,
                "data_kind": fit.experiment.provenance.kind,
                "command": fit.manifest["command"],
                "fingerprint": fit.manifest["fingerprint"],
                "status": fit.manifest["status"],
                "manifest_sha256": sha256_of_file(fit.directory.manifest_file),
            }
            for key, fit in zip(page_keys(fits), fits, strict=True)
        ],
    }

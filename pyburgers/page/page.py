"""One self-contained page about one or several fits, with its figures and tables as files."""

import importlib.metadata
import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType

import jinja2

from pyburgers.checks.fit_checks import CheckKind, Outcome
from pyburgers.checks.prior_influence import CONFLICT_MEANING
from pyburgers.common.atomic_files import write_json, write_text
from pyburgers.common.csv_tables import csv_text
from pyburgers.common.errors import InputError, require_type
from pyburgers.common.messages import printable
from pyburgers.common.paths import given_path
from pyburgers.common.toml_files import read_json
from pyburgers.drawing.page_parts import PageSection
from pyburgers.drawing.view import view_of
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.sampled_fit import A_FIT, SampledFit
from pyburgers.flow_law_tables.fit import RateFit
from pyburgers.model.display import symbol_text
from pyburgers.model.parameters import PARAMETER_BY_NAME
from pyburgers.model.reference_quantities import REFERENCE_QUANTITIES
from pyburgers.page import overview, tables
from pyburgers.page.comparison_sections import comparison_sections
from pyburgers.page.fit_sections import SameData, Section, by_data, write_section
from pyburgers.page.glossary import SHARE_TEXT, with_definitions
from pyburgers.page.illustrations import (
    Illustration,
    Picture,
    dark_colours,
    illustrate,
    write_figures,
)
from pyburgers.page.joint_section import joint_sections
from pyburgers.page.methods import REPORT_KIND, bibtex, report_manifest, runs_table
from pyburgers.page.names import alike, file_key, in_words, joint_key, page_keys, page_names
from pyburgers.page.overview import Entry, entry_of, joint_entry
from pyburgers.page.rate_section import rate_section

logger = logging.getLogger(__name__)


def write_report(
    fits: Sequence[Fit],
    out: str | Path,
    *,
    title: str,
    command: str,
    joints: Sequence[Fit] = (),
    extras: Sequence[PageSection] = (),
    told: Mapping[str, Sequence[SampledFit]] = MappingProxyType({}),
    to_come: Mapping[str, str] = MappingProxyType({}),
    drawn: dict[Path, str] | None = None,
    jobs: int | None = 1,
) -> Path:
    """Write a page about fits: ``index.html``, ``figures/``, ``tables/`` and ``manifest.json``.

    The page needs no other file and no network. An earlier report in the same folder is replaced,
    file by file and each at once, the page last.

    Parameters
    ----------
    fits : sequence of Fit
        Of single tests or of the tests of joint fits. Measured ones come first on the page.
    out : path
        Folder, new or of an earlier report.
    title : str
        Heading of the page.
    command : str
        Command that makes the report again.
    joints : sequence of Fit
        Joint fits, whose parts of the page are among the extras.
    extras : sequence of PageSection
        Parts of the page beside the fits, in their order.
    told : mapping of str to sequence of SampledFit
        Fits that one of the extras is about, by its key. They have no section of their own. Both
        verdicts on them stand at the top of the page.
    to_come : mapping of str to str
        Parts that a later call is to add, by name. Those that are runs have the name of their
        test, others an empty text.
    drawn : dict of Path to str, optional
        Pictures of earlier calls by their files, which are not drawn again; those of this call are
        added.
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

    Examples
    --------
    >>> page = pyburgers.write_report(
    ...     [fit], Path("page"), title="Creep", command="python my_script.py"
    ... )
    """
    out = given_path(out)
    if not fits and not told:
        raise InputError(f"{out}: a report needs at least one run, found none.")
    _claim(out)
    others = [(key, fit) for key, some in told.items() for fit in some]
    all_fits: list[SampledFit] = [*fits, *(fit for _, fit in others)]
    keys, names = page_keys(all_fits), page_names(all_fits)
    named = list(zip(names, all_fits, strict=True))
    own = list(zip(map(file_key, keys), names, fits, strict=False))
    manifest = report_manifest(list(zip(keys, all_fits, strict=True)), title, command)
    write_json(out / "manifest.json", manifest)
    own.sort(key=lambda one: one[2].provenance.kind == "synthetic")
    groups = _write_groups(by_data(own), out, joints)
    sections = [section for group in groups for section in group.sections]
    illustrated = []
    for extra in extras:
        logger.info(f"Writing the part {extra.title!r}.")
        for table in extra.tables:
            name = f"{extra.key}_{file_key(table.name)}.csv"
            write_text(out / "tables" / name, csv_text(table.saved))
        illustrated.append((extra, illustrate(extra.figures, out, extra.key)))
    ahead = [figures for extra, figures in illustrated if not extra.after_fits]
    behind = [figures for extra, figures in illustrated if extra.after_fits]
    figures = [*ahead, *(section.illustrations for section in sections), *behind]
    illustrations = [one for part in figures for one in part]
    logger.info(f"Writing {len(illustrations)} figures.")
    pictures = write_figures(illustrations, out, jobs, {} if drawn is None else drawn)
    of_part: dict[str, list[Entry]] = {extra.key: [] for extra in extras}
    for (part, fit), key, name in zip(others, keys[len(fits) :], names[len(fits) :], strict=True):
        anchor = f"verdicts-{file_key(key)}"
        entry = entry_of(anchor, name, fit, fit.checks(), fit.decisions())
        of_part.setdefault(part, []).append(entry)
    entries = [
        *(
            joint_entry(joint_key(key), name, joint)
            for key, name, joint in zip(page_keys(joints), page_names(joints), joints, strict=True)
        ),
        *(section.entry for section in sections),
        *(entry for told_entries in of_part.values() for entry in told_entries),
    ]
    entries.sort(key=lambda entry: entry.is_synthetic)
    page = out / "index.html"
    text = render_page(
        groups,
        illustrated,
        pictures,
        entries,
        of_part,
        runs=runs_table(named),
        references=bibtex(all_fits),
        title=title,
        command=command,
        to_come=[in_words(*one) for one in to_come.items()],
    )
    write_text(page, text)
    return page


def report(
    fits: Sequence[Fit],
    path: str | Path,
    *,
    title: str | None = None,
    command: str = "pyburgers.report(...)",
    tables: Mapping[str, RateFit] = MappingProxyType({}),
) -> Path:
    """Write a page about fits of one test or of several.

    Parameters
    ----------
    fits : sequence of Fit
        The fits.
    path : path
        A file that ends in ``.html``, with a folder of tables and figures beside it.
        Or a folder, new or that of an earlier page.
    title : str, optional
        Heading of the page.
    command : str
        Command that makes the page again, as the page tells it.
    tables : mapping of str to RateFit
        Fits of tables by their key on the page.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    InputError
        If there is nothing to show, or the folder cannot be written or holds something else.

    Examples
    --------
    >>> page = pyburgers.report([fit, other], "page.html", title="Two curves")
    """
    require_type("fits", fits, (list, tuple), "a list of fits")
    for fit in fits:
        require_type("fits", fit, Fit, A_FIT)
    path = given_path(path)
    is_file = path.suffix == ".html"
    folder = path.with_name(f"{path.stem}_files") if is_file else path
    title = title or _default_title(fits, tables)
    page = page_about(fits, folder, title=title, command=command, tables=tables)
    if not is_file:
        return page
    text = page.read_text(encoding="utf-8")
    for part in ("tables", "figures"):
        text = text.replace(f'href="{part}/', f'href="{folder.name}/{part}/')
    write_text(path, text)
    page.unlink()
    return path


def _default_title(fits: Sequence[Fit], tables: Mapping[str, RateFit]) -> str:
    """Say which test a page is about, if it is about one."""
    if len(fits) != 1 or tables or fits[0].is_joint:
        return "Nonlinear Burgers fits"
    test = fits[0].experiment
    return f"{test.id}: {test.material}, {test.protocol.replace('_', ' ')}"


def page_about(
    fits: Sequence[Fit],
    folder: Path,
    *,
    title: str,
    command: str,
    first: Sequence[PageSection] = (),
    tables: Mapping[str, RateFit] = MappingProxyType({}),
    jobs: int | None = 1,
) -> Path:
    """Write a page about fits, tests of joint fits and fits of the same data, some parts first."""
    joints = [fit for fit in fits if fit.is_joint]
    alone = [fit for fit in fits if not fit.is_joint]
    tests = [*(fit for joint in joints for fit in joint.tests().values()), *alone]
    of_tables = [rate_section(table, key) for key, table in tables.items()]
    if len(of_tables) > 1:
        names = page_names([*tables.values()])
        of_tables = [
            replace(section, title=f"{section.title}: {name}")
            for section, name in zip(of_tables, names, strict=True)
        ]
    return write_report(
        tests,
        folder,
        title=title,
        command=command,
        joints=joints,
        extras=(
            *first,
            *joint_sections(joints, alone),
            *comparison_sections([*joints, *tests]),
            *of_tables,
        ),
        told={key: [table] for key, table in tables.items()},
        jobs=jobs,
    )


def _write_groups(
    groups: Sequence[Sequence[tuple[str, str, Fit]]], out: Path, joints: Sequence[Fit]
) -> list[SameData]:
    """Write the tables of all fits, and gather what the page shows of them."""
    told: list[Section] = []
    found = []
    for group in groups:
        sections = []
        for key, name, fit in group:
            logger.info(f"Writing the section of {name}.")
            shared = next((one.problem.shared for one in joints if one is fit.whole), ())
            section = write_section(key, name, fit, out, elsewhere=shared)
            same = next((one for one in told if one.about_data == section.about_data), None)
            sections.append(replace(section, same_data_as=same))
            told.append(sections[-1])
        found.append(SameData(tuple(sections)))
    return found


def render_page(
    groups: Sequence[SameData],
    extras: Sequence[tuple[PageSection, tuple[Illustration, ...]]],
    pictures: Mapping[str, Picture],
    entries: Sequence[Entry],
    of_part: Mapping[str, Sequence[Entry]],
    **told: object,
) -> str:
    """Fill the page's template, also with what is `told` as it is; texts of files are escaped."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("pyburgers"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=lambda one: type(one)(printable(one)) if isinstance(one, str) else one,
    )
    environment.filters["terms"] = with_definitions
    sections = [section for group in groups for section in group.sections]
    first = {section.key: section.illustrations[0] for section in sections}
    for extra, figures in extras:
        if figures:
            first |= dict.fromkeys((extra.key, *(e.key for e in of_part[extra.key])), figures[0])
    return environment.get_template("report.html").render(
        **told,
        groups=groups,
        extras=extras,
        pictures=pictures,
        dark_colours=dark_colours(one.svg for one in pictures.values()),
        first=first,
        entries=entries,
        of_part=of_part,
        overview=overview.overview_table(entries),
        bad_answers=overview.bad_answers(entries),
        answer_columns=[*overview.ANSWER_COLUMNS.values(), overview.CONFLICT_COLUMN],
        answers=overview.answers(entries),
        remedies=overview.remedies(entries),
        alarms=[alarm for extra, _ in extras for alarm in extra.alarms],
        kinds=tuple(CheckKind),
        outcomes=Outcome,
        checks_made={kind: _names_of_checks(entries, kind) for kind in CheckKind},
        laws_of_fits=alike(sections, lambda one: one.fit.variant.text).items(),
        tests_of_joint_fits=any(section.fit.is_part for section in sections),
        synthetic=[entry for entry in entries if entry.is_synthetic],
        prior_sources=tables.prior_sources([s.priors for s in sections]),
        prior_notes=list(dict.fromkeys(s.fit.priors.notes for s in sections if s.fit.priors.notes)),
        # The first part of the page that has a paragraph in its details tells it.
        told_by={text: extra for extra, _ in reversed(extras) for text in extra.details},
        made_alike=alike(sections, lambda one: (one.methods, one.fit.manifest["command"])).values(),
        is_of_one_fit=len(entries) == 1 and not any(not extra.after_fits for extra, _ in extras),
        findings=[
            one
            for one in extras
            if one[0].paragraphs and not one[0].after_fits and len(entries) > 1
        ],
        reference_texts=list(dict.fromkeys(view_of(s.experiment).reference_text for s in sections)),
        tex=_TEX,
        written=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        version=importlib.metadata.version("pyburgers"),
        share_text=SHARE_TEXT,
        deciders=tables.table_of_deciders(),
        has_truth=any(section.truth is not None for section in sections),
        tells_who_decided=any(tables.DECISION in section.parameters for section in sections)
        or any(tables.DECISION in table.shown for extra, _ in extras for table in extra.tables),
        conflict_meaning=CONFLICT_MEANING,
        truth_sentence=tables.truth_sentence,
        not_by_data=tables.not_by_data,
        checks_page_table=tables.checks_page_table,
    )


def _names_of_checks(entries: Sequence[Entry], kind: CheckKind) -> list[str]:
    """Names of all checks of a kind that were made, each once."""
    found = (one for entry in entries for one in entry.checks if one.check.kind is kind)
    return list(dict.fromkeys(one.name for one in found))


_TEX = {
    symbol_text(quantity): f"${quantity.symbol}$"
    for quantity in (*PARAMETER_BY_NAME.values(), *REFERENCE_QUANTITIES.values())
}
"""Symbols as LaTeX has them, by what tables show."""


def _claim(out: Path) -> None:
    """Make the folders, and refuse one that holds a run or a page of another kind."""
    manifest = out / "manifest.json"
    if manifest.is_file():
        is_report = read_json(manifest).get("kind") == REPORT_KIND
    else:
        # A page that is not finished has folders alone.
        is_report = not any(entry.is_file() for entry in out.glob("[!.]*"))
    if not is_report:
        raise InputError(
            f"{out}: holds something else than a report (a run, a page or other files), expected a "
            "new folder or one of an earlier report."
        )
    try:
        for folder in (out, out / "figures", out / "tables"):
            folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{out}: cannot be written ({error.strerror}).") from error

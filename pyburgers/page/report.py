"""A page about some fits, with what it holds of joint fits, comparisons and tables."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from pyburgers.common.atomic_files import write_text
from pyburgers.common.paths import given_path
from pyburgers.fitting.fit import Fit
from pyburgers.flow_law_tables.fit import PeakStressFit
from pyburgers.page.comparison_sections import comparison_sections
from pyburgers.page.joint_section import joint_sections
from pyburgers.page.page import write_report
from pyburgers.page.peak_stress_section import peak_stress_section


def report(
    fits: Sequence[Fit],
    path: str | Path,
    *,
    title: str | None = None,
    command: str = "pyburgers.report(...)",
    tables: Mapping[str, PeakStressFit] = MappingProxyType({}),
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
    tables : mapping of str to PeakStressFit
        Fits of tables of peak stresses by their key on the page.

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
    path = given_path(path)
    is_file = path.suffix == ".html"
    folder = path.with_name(f"{path.stem}_files") if is_file else path
    joints = [fit for fit in fits if fit.is_joint]
    alone = [fit for fit in fits if not fit.is_joint]
    sections = joint_sections(joints, alone)
    tests = [*(fit for joint in joints for fit in joint.tests().values()), *alone]
    page = write_report(
        tests,
        folder,
        title=title or "Nonlinear Burgers fits",
        command=command,
        joints=joints,
        extras=(
            *sections,
            *comparison_sections([*joints, *tests]),
            *(peak_stress_section(table, key) for key, table in tables.items()),
        ),
        told={key: [table] for key, table in tables.items()},
    )
    if not is_file:
        return page
    text = page.read_text(encoding="utf-8").replace('href="tables/', f'href="{folder.name}/tables/')
    write_text(path, text)
    page.unlink()
    return path

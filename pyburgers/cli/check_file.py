"""`pyburgers check-file`: everything that is wrong with an input file, and what to do about it."""

import argparse
from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from typing import Any

from pyburgers.cli.hints import hints, looks, text_files, unchecked_rates
from pyburgers.cli.unread_columns import contradictions, unread_note
from pyburgers.common.errors import InputError, StructureError
from pyburgers.common.paths import shown
from pyburgers.common.scratch import scratch_folder
from pyburgers.common.tables_in_files import read_once
from pyburgers.common.toml_files import read_tables, write_toml
from pyburgers.common.units import count_points, counted
from pyburgers.flow_law_tables.table_files import load_rate_table
from pyburgers.flow_law_tables.tables import KIND as RATES
from pyburgers.flow_law_tables.tables import RateTable
from pyburgers.kinds.conditions import doubts
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.kind import load_experiment
from pyburgers.kinds.loading_history.driver import ARE_USED
from pyburgers.model.plausible import PlausibleRanges, plausible_ranges
from pyburgers.model.priors import PriorSet, shipped_prior_files
from pyburgers.model.unlikely_numbers import unlikely_priors

STAND_INS: Mapping[str, Any] = {
    "id": "test",
    "material": "ice",
    "temperature_K": 263.0,
    "initial_grain_size_m": 1e-3,
    "provenance": {"kind": "measured", "source": "unknown"},
    "kind": "measured",
    "source": "unknown",
    "start_strain": 0.0,
    "strain_rate_per_s": 1e-4,
    "strain_unit": "fraction",
    "stress_unit": "MPa",
    "time_unit": "s",
}
"""What stands in for keys that are missing or of another type, to look at the rest of a file."""


READERS_BY_KEY: Mapping[str, tuple[str, str]] = {
    "mechanisms": ("pyburgers.flow_law_tables.laws", "load_rate_law"),
    "candidates": ("pyburgers.predictions.design_plans", "load_design_plan"),
    "parameters": ("pyburgers.model.priors", "load_priors"),
    "tests": ("pyburgers.fitting.campaign", "load_campaign"),
}
"""Module and function that read a file with a key that no other kind of file has."""

KEYS_OF_OTHERS = {"parameters", "tests"}
"""Those of the keys that a file with a protocol may have."""


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.add_argument(
        "files",
        type=Path,
        nargs="+",
        metavar="FILE.toml",
        help="experiment, table of rates, priors, law of tables, or plan of a campaign",
    )


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    with read_once():
        return max([check(path) for path in options.files])


def check(path: Path, *, tells_unread: bool = True) -> int:
    """Print all that is wrong with a file, or what it holds; return the exit code."""
    with read_once():
        try:
            content = read_tables(path)
        except InputError as error:  # those after it are still to be looked at
            content, errors, loaded, tables = {}, list(error.sentences), None, []
        else:
            tables = list(looks(path, content))
            errors, loaded = all_errors(path, content)
    notes = {note for look in tables for note in look.notes}
    notices = loaded.notices if isinstance(loaded, Experiment | RateTable) else ()
    lines = [f"error: {sentence}" for sentence in errors]
    lines += [f"note: {note}" for note in sorted(notes) if errors]
    unread = (unread_note(look, content) for look in tables if tells_unread and not errors)
    lines += [f"note: {note}" for note in dict.fromkeys(unread) if note]
    lines += [f"hint: {sentence}" for sentence in hints(tables, content)]
    lines += [f"note: {note}" for note in ([] if errors else unchecked_rates(content))]
    for one in notices:
        lines.append(f"{'note' if one in notes or ARE_USED in one else 'warning'}: {one}")
    if isinstance(loaded, Experiment):
        beside = (one for look in tables for one in contradictions(look, content, loaded))
        lines += [f"warning: {sentence}" for sentence in (*doubts(loaded), *beside)]
    # A law of tables has priors, too.
    priors = loaded if isinstance(loaded, PriorSet) else getattr(loaded, "priors", None)
    if isinstance(priors, PriorSet):
        lines += [f"warning: {sentence}" for sentence in unlikely_priors(priors)]
        lines += [f"note: {sentence}" for sentence in _not_compared(path, content, priors)]
    for line in lines:
        print(shown(line))
    if errors:
        print(f"{shown(path)}: {counted(len(errors), 'error')}; it cannot be used yet")
        return InputError.exit_code
    what = ""
    if isinstance(loaded, Experiment):
        points = count_points(loaded.n_points)
        what = f", {loaded.id}: {loaded.protocol} of {loaded.material}, {points}"
    print(f"{shown(path)}: no errors{what}")
    return 0


def _not_compared(path: Path, content: Mapping[str, Any], priors: PriorSet) -> Iterator[str]:
    """Say what about priors is read without effect, and that there may be none to compare with."""
    own = content.get("plausible")
    if own and PlausibleRanges.model_validate(own) != plausible_ranges(priors.material):
        yield (
            f"{path}: [plausible] has no effect in a file of your own: numbers of tests are "
            "compared with those that come with pyburgers, where there are any."
        )
    if priors.material not in shipped_prior_files():
        yield (
            f"{path}: no priors of {priors.material!r} come with pyburgers, so that there is "
            "nothing to compare these with: check every unit."
        )


def all_errors(path: Path, content: Mapping[str, Any]) -> tuple[list[str], object]:
    """Return errors of a file, with keys put right, and what it was read into, None with errors."""
    load = _reader(content)
    try:
        return [], load(path)
    except StructureError as error:
        # A copy of a plan would not find the files that it names.
        mended = None if _is_plan(content) else _mended(content, error)
        further = [] if mended is None else _errors_of(mended, path, load)
        return [*error.sentences, *further], None
    except InputError as error:
        return list(error.sentences), None


def _reader(content: Mapping[str, Any]) -> Callable[[Path], object]:
    """Return what reads a file of its kind."""
    keys = content.keys() - (KEYS_OF_OTHERS if "protocol" in content else set())
    for key, (module, name) in READERS_BY_KEY.items():
        if key in keys:
            # Most of the modules take long to load, or need docstrings, which no other file does.
            read: Callable[[Path], object] = getattr(import_module(module), name)
            return read
    # The reader of rates tells how a table of peak stresses is written.
    return load_rate_table if content.get("protocol") in (RATES, "peak_stress") else load_experiment


def _is_plan(content: Mapping[str, Any]) -> bool:
    """Whether a file is the plan of a campaign or of a design: it names other input files."""
    return bool({"tests", "candidates"} & content.keys()) and "protocol" not in content


def _mended(content: Mapping[str, Any], error: StructureError) -> dict[str, Any] | None:
    """Return content with keys put right from alike ones or stand-ins; None without a stand-in."""
    mended = deepcopy(dict(content))
    missing = [location for location, unknown in error.faults if not unknown]
    for location, unknown in error.faults:
        *above, key = location
        table: Any = mended
        try:
            for part in above:
                table = table[part]
            if unknown:
                value = table.pop(key)
                beside = [str(one[-1]) for one in missing if [*one[:-1]] == above]
                for meant in get_close_matches(str(key), beside, n=1):
                    table[meant] = value
                    missing.remove((*above, meant))
            elif location in missing:
                table[key] = deepcopy(STAND_INS[str(key)])
        except (KeyError, IndexError, TypeError):
            return None
    return mended


def _errors_of(
    content: dict[str, Any], path: Path, load: Callable[[Path], object]
) -> tuple[str, ...]:
    """Return the errors of content as if it stood in a file at `path`."""
    for table, key in text_files(content):
        table[key] = str((path.parent / table[key]).absolute())
    data = content.get("data")
    if isinstance(data, dict) and isinstance(data.get("data_root"), str):
        data["data_root"] = str((path.parent / data["data_root"]).absolute())
    with scratch_folder() as folder:
        copy = folder / path.name
        write_toml(copy, content)
        try:
            load(copy)
        except InputError as error:
            return tuple(sentence.replace(str(copy), str(path)) for sentence in error.sentences)
    return ()

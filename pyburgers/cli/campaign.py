"""`pyburgers campaign`: fits of tests by laws, priors and seeds, and one page about them."""

import argparse
from pathlib import Path

from pyburgers.cli.shared import command_line, exit_code, writing
from pyburgers.cli.terminal import print_table
from pyburgers.cli.workers import add_worker_options, require_no_worker_options, workers_of
from pyburgers.common.atomic_files import write_text
from pyburgers.common.csv_tables import csv_text
from pyburgers.common.paths import shown
from pyburgers.fitting.campaign import (
    Campaign,
    load_campaign,
    run_campaign,
    shown_status_table,
    status_table,
)
from pyburgers.page.campaign_page import shown_fits
from pyburgers.page.page import page_about
from pyburgers.sampling.manifest import COMPLETE

EXIT_NOT_DONE = 1


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.add_argument("plan", type=Path, metavar="PLAN.toml", help="what is to be fitted")
    command.add_argument("--out", type=Path, metavar="DIR", help="default: campaigns/ID")
    command.add_argument(
        "--status", action="store_true", help="fit nothing: show how far each fit is"
    )
    add_worker_options(command)


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    if options.status:
        require_no_worker_options(options, "--status, which fits nothing")
    campaign = load_campaign(options.plan)
    out = options.out or Path("campaigns") / campaign.id
    command = command_line()
    failed = {}
    if not options.status:
        with workers_of(options) as workers:
            with writing(out):
                out.mkdir(parents=True, exist_ok=True)
            failed = run_campaign(campaign, out, workers=workers, command=command)
    table = status_table(campaign, out)
    print_table(shown_status_table(table), keys=["run"])
    if options.status:
        return 0
    for name, error in failed.items():
        print(f"{name}: could not be done: {error}")
    with writing(out):
        out.mkdir(parents=True, exist_ok=True)
        write_text(out / "status.csv", csv_text(table, index=True))
        print(shown(f"table: {out / 'status.csv'}"))
    if options.part is None:
        _write_page(campaign, out, command)
    if failed:
        return EXIT_NOT_DONE
    done = table[table["status"] == COMPLETE]
    return exit_code(bool((done["sampled_well"] == "yes").all()))


def _write_page(campaign: Campaign, out: Path, command: str) -> None:
    """Write the page about complete fits; if there is none, give an earlier page another name."""
    old = out / "report" / "index.html"
    if (found := shown_fits(campaign, out)) is not None:
        fits, section = found
        title = f"Campaign {campaign.id}"
        page = page_about(
            fits, old.parent, title=title, command=command, first=(section,), jobs=None
        )
        print(shown(f"The page is {page}"))
    elif old.is_file():
        with writing(out):
            outdated = old.replace(old.with_name("outdated.html"))
        print(shown(f"No fit is complete now: the earlier page is {outdated}"))

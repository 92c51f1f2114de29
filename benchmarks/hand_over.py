"""Calibrate what a table of peak stresses hands on (python benchmarks/hand_over.py).

Tables like that of Qi and Goldsby (2021) are simulated from Table 1's priors and fitted; the flow
law of one more test is ranked in the prior handed on (`simulated_tables`). With --curves the
row of PIL40 is left out, and curves of the one more test, taken like PIL40, are fitted with the
prior handed on and their parameters ranked. Each table and each curve is a
file that is written when it is done: the same command continues. Synthetic throughout.
"""

import argparse
import json
import shutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd
from simulated_tables import rank_curve, rank_hand_over, simulate_table
from tables import verdict_table

from pyburgers.common.atomic_files import write_json, write_text
from pyburgers.common.errors import InputError, SamplingError
from pyburgers.flow_law_tables.laws import SCATTER, RateLaw, rate_law
from pyburgers.flow_law_tables.table_files import load_rate_table
from pyburgers.flow_law_tables.tables import RateTable, without_test
from pyburgers.kinds.kind import load_experiment
from pyburgers.model.flow_law_prior import FlowLawPrior
from pyburgers.model.prior_families import Prior
from pyburgers.model.priors import default_priors
from pyburgers.sampling.options import SamplerOptions
from pyburgers.sbc.data_sets import DataSetPlan, calibration_priors
from pyburgers.sbc.rank_uniformity import VERDICTS_TEXT

ROOT = Path(__file__).parents[1]
TABLE = ROOT / "data" / "ice" / "rates" / "qi_goldsby_2021.toml"
CURVE = ROOT / "data" / "ice" / "PIL40.toml"
OF_TABLE = DataSetPlan(
    sampler=SamplerOptions(
        chains=4, warmup=1000, draws=1000, adapt_delta=0.99, parallel_chains=1, coordinates="plain"
    )
)
OF_CURVE = DataSetPlan(
    sampler=SamplerOptions(chains=2, warmup=300, draws=400, adapt_delta=0.9, parallel_chains=1)
)

LABORATORY_SCATTER = Prior.of_family(
    SCATTER,
    "half_normal",
    {"scale": 0.4},
    unit="1",
    source="About twice the scatter of the measured table, so that tables look like it",
)

Record = dict[str, Any]
DoOne = Callable[[int, Path], Record]


def law_of_tables() -> RateLaw:
    """Law of a table with weak priors and a scatter that laboratory tests have."""
    weak = rate_law("ice_flow_law")
    priors = {**weak.priors.priors, SCATTER: LABORATORY_SCATTER}
    return replace(weak, priors=replace(weak.priors, priors=priors))


@dataclass(frozen=True)
class Stage:
    """Fits of one kind, a file each.

    Attributes
    ----------
    kind : str
        What is fitted.
    among : str
        What the truth is ranked among.
    folder : Path
        Of the files.
    seeds : range
        Planned.
    do_one : callable
        Does the one with a seed, with a folder for its runs.
    """

    kind: str
    among: str
    folder: Path
    seeds: range
    do_one: DoOne

    def file(self, seed: int) -> Path:
        """Return where the outcome of a seed is."""
        return self.folder / f"{self.kind}_{seed:06d}.json"

    def run(self, seed: int, scratch: Path) -> None:
        """Do the one with a seed, if it is missing."""
        if self.file(seed).is_file():
            return
        shutil.rmtree(scratch, ignore_errors=True)  # of a run that was interrupted
        try:
            record = {"seed": seed, "failure": None, **self.do_one(seed, scratch)}
        except (InputError, SamplingError) as error:
            record = {"seed": seed, "failure": str(error), "ranks": {}, "n_refits": 0}
        shutil.rmtree(scratch, ignore_errors=True)
        write_json(self.file(seed), record)

    @property
    def done(self) -> list[Record]:
        """Outcomes that are there."""
        files = (self.file(seed) for seed in self.seeds)
        return [json.loads(f.read_text(encoding="utf-8")) for f in files if f.is_file()]


def law_file(folder: Path, seed: int) -> Path:
    """Return where the law is that a table has handed on."""
    return folder / f"law_{seed:06d}.json"


def do_table(template: RateTable, folder: Path) -> DoOne:
    """Return what simulates and fits a table like a template."""

    def do_one(seed: int, scratch: Path) -> Record:
        ranked = rank_hand_over(
            template,
            law_of_tables(),
            default_priors("ice"),
            scratch,
            seed=seed,
            plan=OF_TABLE,
        )
        ranked.law.save(law_file(folder, seed))
        return {
            "ranks": ranked.ranks,
            "n_refits": ranked.n_refits,
            "failed_checks": ranked.failed_checks,
        }

    return do_one


def do_curve(template: RateTable, tables: Stage) -> DoOne:
    """Return what simulates and fits a curve with the prior that its table has handed on."""

    def do_one(seed: int, scratch: Path) -> Record:
        table = json.loads(tables.file(seed).read_text(encoding="utf-8"))
        if not table["ranks"]:
            raise InputError(f"table {seed} has handed nothing on.")
        done = rank_curve(
            simulate_table(template, law_of_tables(), default_priors("ice"), seed=seed),
            FlowLawPrior.load(law_file(tables.folder, seed)),
            load_experiment(CURVE),
            calibration_priors("ice"),
            scratch,
            seed=seed,
            plan=OF_CURVE,
        )
        return done.model_dump()

    return do_one


def rows(table: pd.DataFrame) -> list[str]:
    """Return a table as lines of Markdown."""
    cells = [list(map(str, table)), ["---"] * table.shape[1], *table.to_numpy().tolist()]
    return ["| " + " | ".join(map(str, row)) + " |" for row in cells]


def section(stage: Stage) -> list[str]:
    """Return counts and verdicts of a stage as lines of Markdown."""
    done = stage.done
    ranked = [one for one in done if one["ranks"]]
    lost = [one for one in done if one["failure"]]
    unconverged = [one for one in done if not one["ranks"] and not one["failure"]]
    lines = [
        f"## {stage.kind.capitalize()}s",
        "",
        f"- {len(done)} of {len(stage.seeds)} planned are done (the number was fixed before the "
        f"first); {len(ranked)} are ranked, the truth among {OF_CURVE.n_ranked} draws of "
        f"{stage.among}.",
        f"- Repeated longer because a check of the sampling failed: "
        f"{sum(one['n_refits'] > 0 for one in done)}; still failed and not ranked: "
        + (
            "; ".join(
                f"seed {one['seed']}: {', '.join(one['failed_checks'])}" for one in unconverged
            )
            or "none"
        )
        + ".",
        "- Without a fit: "
        + ("; ".join(f"seed {one['seed']}: {one['failure']}" for one in lost) or "none."),
        "",
    ]
    if not ranked:
        return lines
    names = list(ranked[0]["ranks"])
    table = verdict_table(
        {name: [one["ranks"][name] for one in ranked] for name in names}, OF_CURVE.n_ranked
    )
    return [*lines, *rows(table), ""]


def report(stages: Sequence[Stage], command: str) -> str:
    """Return the verdicts on what is done, as Markdown."""
    return "\n".join(
        [
            "# Calibration of the flow law handed on by a table of peak stresses",
            "",
            "All data are synthetic.",
            "",
            *(line for stage in stages for line in section(stage)),
            VERDICTS_TEXT,
            "",
            f"Command: `{command}`",
            "",
        ]
    )


def rank_table(done: Sequence[Record]) -> pd.DataFrame:
    """Return every outcome: seed, longer fits, failed checks, failure, and its ranks."""
    return pd.DataFrame(
        [
            {
                "seed": one["seed"],
                "refits": one["n_refits"],
                "failed_checks": "; ".join(one.get("failed_checks", [])),
                "failure": one["failure"],
                **one["ranks"],
            }
            for one in done
        ]
    )


def main() -> None:
    """Do what is missing; write the report after each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--simulations", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1, help="of the first data set")
    parser.add_argument("--curves", action="store_true", help="fit curves of one more test, too")
    parser.add_argument("--out", type=Path, default=ROOT / "reports" / "calibration" / "hand_over")
    options = parser.parse_args()
    template = load_rate_table(TABLE)
    if options.curves:
        template = without_test(template, load_experiment(CURVE))
    folder: Path = options.out / "simulations"
    seeds = range(options.seed, options.seed + options.simulations)
    tables = Stage("table", "the prior handed on", folder, seeds, do_table(template, folder))
    stages = [tables]
    if options.curves:
        do_one = do_curve(template, tables)
        stages.append(Stage("curve", "the posterior", folder, seeds, do_one))
    out: Path = options.out
    arguments = f"--simulations {options.simulations} --seed {options.seed}"
    command = f"python benchmarks/hand_over.py {arguments}{' --curves' if options.curves else ''}"

    def write() -> None:
        write_text(out / "calibration.md", report(stages, command))
        for stage in stages:
            write_text(out / f"{stage.kind}s.csv", rank_table(stage.done).to_csv(index=False))

    folder.mkdir(parents=True, exist_ok=True)
    for seed in seeds:
        for stage in stages:
            stage.run(seed, out / "scratch")
        write()
    sys.stdout.write(report(stages, command))


if __name__ == "__main__":
    main()

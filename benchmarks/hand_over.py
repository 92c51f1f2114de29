"""Calibrate what a table of peak stresses hands on (python benchmarks/hand_over.py).

Tables like that of Qi and Goldsby (2021) are simulated from Table 1's priors and fitted; the flow
law of one more test is ranked in the prior handed on (pyburgers.sbc.hand_over). Each data set is a
file that is written when it is done: the same command continues. Synthetic throughout.
"""

import argparse
import json
import shutil
from dataclasses import replace
from pathlib import Path

import pandas as pd

from pyburgers.common.atomic_files import write_json, write_text
from pyburgers.common.errors import InputError, SamplingError
from pyburgers.flow_law_tables.inputs import (
    STRESS_SCATTER,
    default_peak_stress_priors,
    load_peak_stress,
)
from pyburgers.model.prior_families import Prior
from pyburgers.model.priors import PriorSet, default_priors
from pyburgers.sampling.options import SamplerOptions
from pyburgers.sbc.hand_over import rank_hand_over
from pyburgers.sbc.rank_uniformity import VERDICTS_TEXT, judge_ranks, rank_bands

ROOT = Path(__file__).parents[1]
TABLE = ROOT / "data" / "ice" / "peak_stress_qi_goldsby_2021.toml"
OPTIONS = SamplerOptions(chains=2, warmup=500, draws=500)
N_RANKED = 99

SCATTER = Prior.of_family(
    STRESS_SCATTER.name,
    "half_normal",
    {"scale": 0.1},
    unit="1",
    source="About twice the scatter of the measured table, so that tables look like it",
)


def priors_of_tables() -> PriorSet:
    """Weak priors of a table with a scatter that laboratory tests have."""
    weak = default_peak_stress_priors("ice")
    return replace(weak, priors={**weak.priors, STRESS_SCATTER.name: SCATTER})


def run_one(seed: int, file: Path, scratch: Path) -> None:
    """Do one data set and write its file."""
    content: dict[str, object] = {"seed": seed, "failure": None}
    try:
        ranks, fit = rank_hand_over(
            load_peak_stress(TABLE),
            priors_of_tables(),
            default_priors("ice"),
            scratch,
            seed=seed,
            options=OPTIONS,
            n_ranked=N_RANKED,
        )
        content |= {
            "ranks": ranks,
            "failed_checks": [check.name for check in fit.checks() if not check.passed],
        }
    except (InputError, SamplingError) as error:
        content["failure"] = str(error)
    shutil.rmtree(scratch, ignore_errors=True)
    write_json(file, content)


def report(files: list[Path], planned: int, seed: int) -> str:
    """Return the verdicts on the data sets that are done, as Markdown."""
    done = [json.loads(file.read_text(encoding="utf-8")) for file in files]
    ranked = [one for one in done if one["failure"] is None]
    names = list(ranked[0]["ranks"])
    ranks = {name: [one["ranks"][name] for one in ranked] for name in names}
    verdicts = judge_ranks(ranks, rank_bands(len(ranked), N_RANKED, len(names)))
    table = pd.DataFrame(
        {
            "quantity": names,
            "mean rank": [f"{verdicts[name].mean:.3f}" for name in names],
            "spread": [f"{verdicts[name].spread:.3f}" for name in names],
            "verdict": [verdicts[name].verdict for name in names],
            "in words": [verdicts[name].sentence for name in names],
        }
    )
    n_failed = sum(bool(one["failed_checks"]) for one in ranked)
    rows = [list(map(str, table)), ["---"] * table.shape[1], *table.to_numpy().tolist()]
    return "\n".join(
        [
            "# Calibration of the flow law handed on by a table of peak stresses",
            "",
            f"- {len(done)} of {planned} planned simulated tables are done; {len(ranked)} have "
            f"ranks among {N_RANKED} draws of the prior handed on. All data are synthetic.",
            f"- Without ranks: {len(done) - len(ranked)}"
            + "".join(f"; seed {one['seed']}: {one['failure']}" for one in done if one["failure"]),
            f"- Fits that failed a check of the sampling and are ranked all the same: {n_failed}.",
            f"- Command: `python benchmarks/hand_over.py --simulations {planned} --seed {seed}`",
            "",
            *("| " + " | ".join(map(str, row)) + " |" for row in rows),
            "",
            VERDICTS_TEXT,
            "",
        ]
    )


def rank_table(files: list[Path]) -> pd.DataFrame:
    """Return every data set that is done: seed, failed checks, failure, and its ranks."""
    done = [json.loads(file.read_text(encoding="utf-8")) for file in files]
    return pd.DataFrame(
        [
            {
                "seed": one["seed"],
                "failed_checks": "; ".join(one.get("failed_checks", [])),
                "failure": one["failure"],
                **one.get("ranks", {}),
            }
            for one in done
        ]
    )


def main() -> None:
    """Do the data sets that are missing, then write the report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--simulations", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1, help="of the first data set")
    parser.add_argument(
        "--report-only", action="store_true", help="write the report of the data sets that are done"
    )
    parser.add_argument("--out", type=Path, default=ROOT / "reports" / "calibration" / "hand_over")
    options = parser.parse_args()
    folder = options.out / "simulations"
    folder.mkdir(parents=True, exist_ok=True)
    files = [
        folder / f"simulation_{seed:06d}.json"
        for seed in range(options.seed, options.seed + options.simulations)
    ]
    for seed, file in enumerate(files, start=options.seed):
        if not file.is_file() and not options.report_only:
            run_one(seed, file, options.out / "scratch")
            done = [one for one in files if one.is_file()]
            if "ranks" in file.read_text(encoding="utf-8"):
                write_text(
                    options.out / "calibration.md", report(done, options.simulations, options.seed)
                )
    done = [one for one in files if one.is_file()]
    text = report(done, options.simulations, options.seed)
    write_text(options.out / "calibration.md", text)
    write_text(options.out / "ranks.csv", rank_table(done).to_csv(index=False))
    print(text)


if __name__ == "__main__":
    main()

"""Calibrate what a table of peak stresses hands on (python benchmarks/hand_over.py).

Tables like that of Qi and Goldsby (2021) are simulated from Table 1's priors and fitted; the flow
law of one more test is ranked in the prior handed on (`simulated_tables`). With --curves the
row of PIL40 is left out, and curves of the one more test, taken like PIL40, are fitted with the
prior handed on and their parameters ranked. Each table and each curve is a row of a file: the same
command continues. Synthetic throughout.
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import pandas as pd
from growing_tables import Key, Row, grow
from simulated_tables import rank_curve, rank_hand_over, simulate_table
from tables import ICE, ROOT, markdown, verdict_table

from pyburgers import Prior, SamplerOptions, load_experiment, load_rate_table
from pyburgers.common.atomic_files import write_text
from pyburgers.common.errors import InputError, SamplingError
from pyburgers.flow_law_tables.laws import SCATTER, RateLaw, rate_law
from pyburgers.flow_law_tables.tables import RateTable, without_test
from pyburgers.model.flow_law_prior import FlowLawPrior
from pyburgers.model.priors import default_priors
from pyburgers.sbc.data_sets import DataSetPlan, calibration_priors
from pyburgers.sbc.rank_uniformity import VERDICTS_TEXT

CURVE = ICE / "PIL40.toml"
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

AMONG = {"table": "the prior handed on", "curve": "the posterior"}
"""What the truth is ranked among, by what is fitted."""


def law_of_tables() -> RateLaw:
    """Law of a table with weak priors and a scatter that laboratory tests have."""
    weak = rate_law("ice_flow_law")
    priors = {**weak.priors.priors, SCATTER: LABORATORY_SCATTER}
    return replace(weak, priors=replace(weak.priors, priors=priors))


def law_file(folder: Path, seed: int) -> Path:
    """Return where the law is that a table has handed on."""
    return folder / "simulations" / f"law_{seed:06d}.json"


def row_of(
    seed: int,
    ranks: Mapping[str, int],
    *,
    n_refits: int = 0,
    failed_checks: Sequence[str] = (),
    failure: str | None = None,
) -> Row:
    """Return the outcome of a fit as a row."""
    return {
        "seed": seed,
        "refits": n_refits,
        "failed_checks": ", ".join(failed_checks),
        "failure": failure or "",
        **ranks,
    }


def rank_table(out: Path, template: RateTable, seed: int) -> Row:
    """Simulate and fit a table like a template, and keep the law that it hands on."""
    law, curve = law_of_tables(), default_priors("ice")
    with TemporaryDirectory() as scratch:
        try:
            ranked = rank_hand_over(template, law, curve, Path(scratch), seed=seed, plan=OF_TABLE)
        except (InputError, SamplingError) as error:
            return row_of(seed, {}, failure=str(error))
    if ranked.ranks:
        ranked.law.save(law_file(out, seed))
    return row_of(seed, ranked.ranks, n_refits=ranked.n_refits, failed_checks=ranked.failed_checks)


def rank_curve_of(out: Path, template: RateTable, seed: int) -> Row:
    """Simulate and fit a curve with the prior that its table has handed on."""
    if not law_file(out, seed).is_file():
        return row_of(seed, {}, failure=f"table {seed} has handed nothing on.")
    with TemporaryDirectory() as scratch:
        try:
            done = rank_curve(
                simulate_table(template, law_of_tables(), default_priors("ice"), seed=seed),
                FlowLawPrior.load(law_file(out, seed)),
                load_experiment(CURVE),
                calibration_priors("ice"),
                Path(scratch),
                seed=seed,
                plan=OF_CURVE,
            )
        except (InputError, SamplingError) as error:
            return row_of(seed, {}, failure=str(error))
    return row_of(
        seed,
        done.ranks,
        n_refits=done.n_refits,
        failed_checks=done.failed_checks,
        failure=done.failure,
    )


def section(kind: str, rows: pd.DataFrame, n_planned: int) -> str:
    """Return counts and verdicts of tables or curves as Markdown."""
    names = rows.columns.drop([*row_of(0, {})])
    ranked, lost = rows[rows[names].notna().any(axis=1)], rows.dropna(subset="failure")
    unconverged = rows.drop([*ranked.index, *lost.index])

    def listed(of: pd.DataFrame, column: str) -> str:
        said = zip(of["seed"], of[column], strict=True)
        return "; ".join(f"seed {seed}: {text}" for seed, text in said) or "none"

    ranks = {name: ranked[name].astype(int).tolist() for name in names}
    return SECTION.format(
        heading=f"{kind.capitalize()}s",
        done=len(rows),
        planned=n_planned,
        ranked=len(ranked),
        n_draws=OF_CURVE.n_ranked,
        among=AMONG[kind],
        longer=(rows["refits"] > 0).sum(),
        unconverged=listed(unconverged, "failed_checks"),
        lost=listed(lost, "failure"),
        table=markdown(verdict_table(ranks, OF_CURVE.n_ranked)) if ranks else "",
    )


def main() -> None:
    """Do what is missing; write the report after each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--simulations", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1, help="of the first data set")
    parser.add_argument("--curves", action="store_true", help="fit curves of one more test, too")
    parser.add_argument("--out", type=Path, default=ROOT / "reports" / "calibration" / "hand_over")
    parser.add_argument("--jobs", type=int, default=1, help="fits side by side")
    options = parser.parse_args()
    out: Path = options.out
    template = load_rate_table(ICE / "rates" / "qi_goldsby_2021.toml")
    if options.curves:
        template = without_test(template, load_experiment(CURVE))
    works = {"table": rank_table, **({"curve": rank_curve_of} if options.curves else {})}
    files = {kind: out / f"{kind}s.csv" for kind in works}
    arguments = f"--simulations {options.simulations} --seed {options.seed}"
    command = f"python benchmarks/hand_over.py {arguments}{' --curves' if options.curves else ''}"

    def write_page(_rows: pd.DataFrame) -> None:
        sections = [
            section(kind, pd.read_csv(file), options.simulations)
            for kind, file in files.items()
            if file.is_file()
        ]
        text = PAGE.format(sections="\n".join(sections), verdicts=VERDICTS_TEXT, command=command)
        write_text(out / "calibration.md", text)

    (out / "simulations").mkdir(parents=True, exist_ok=True)
    seeds = range(options.seed, options.seed + options.simulations)
    tasks: dict[Key, Sequence[object]] = {(seed,): (out, template, seed) for seed in seeds}
    for kind, work in works.items():
        grow(files[kind], ("seed",), work, tasks, options.jobs, write_page)


SECTION = """## {heading}

- {done} of {planned} planned are done (the number was fixed before the first); {ranked} are \
ranked, the truth among {n_draws} draws of {among}.
- Repeated longer because a check of the sampling failed: {longer}; still failed and not ranked: \
{unconverged}.
- Without a fit: {lost}

{table}
"""

PAGE = """# Calibration of the flow law handed on by a table of peak stresses

All data are synthetic.

{sections}
{verdicts}

Command: `{command}`
"""


if __name__ == "__main__":
    main()

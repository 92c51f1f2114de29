"""Whether the test that `pyburgers design` chooses tells more than the same test again.

    python benchmarks/design_twins.py OUT                               # 50 twins: hours
    python benchmarks/design_twins.py OUT --chains 4 --draws 1000       # as `pyburgers fit` does

Each twin has parameters drawn from the priors of the calibration of ice. Its first test has the
conditions of PIL40 and is fitted with the default priors. For that fit `design` chooses the
candidate of data/designs/ice.toml within the limits that narrows n most. The chosen test and the
first one again are simulated with the parameters of the twin. Each is fitted together with the
first test, with the default pooling. Chains are as short as those of calibrations, and judged as
there. Each twin is one row of OUT/twins.csv. The same command goes on where it stopped; with other
settings take another folder.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from first_go import data_set
from growing_tables import Key, Row, grow, parser_of
from measures import core_seconds
from tables import ROOT, markdown

from pyburgers import Experiment, HistoryExperiment, SamplerOptions, SamplingError
from pyburgers.common.atomic_files import write_text
from pyburgers.common.draws import all_draws
from pyburgers.fitting.fit import Fit, fit_problem
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.forward import simulate_data
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.kinds.problem import problem_of
from pyburgers.kinds.together import default_priors_for, pooling_for
from pyburgers.model.parameters import PARAMETER_BY_NAME
from pyburgers.predictions.design_plans import Candidate, load_design_plan
from pyburgers.predictions.designs import design, places_read
from pyburgers.sbc.data_sets import SHORT_RUN, not_converged

PLAN = load_design_plan(ROOT / "data" / "designs" / "ice.toml")
CHOSEN_FOR, PLAIN = "stress_exponent", "again"
FITS = ("first", "chosen", "plain")
N_TWINS = 50

LEAST_ESS = 100
"""Effective draws of each parameter below which a twin is left out: they tell 7 % of a width."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Fit the twins that are missing, and write the table."""
    parser = parser_of(__doc__, range(N_TWINS))
    parser.add_argument("--chains", type=int, default=SHORT_RUN.chains)
    parser.add_argument("--draws", type=int, default=SHORT_RUN.draws)
    options = parser.parse_args(arguments)
    # Each twin is one process: its chains take turns.
    sampler = replace(SHORT_RUN, chains=options.chains, draws=options.draws)
    tasks: dict[Key, Sequence[object]] = {
        (seed,): (options.out, seed, sampler) for seed in options.seeds
    }
    file = options.out / "twins.csv"
    grow(file, ("seed",), judge_twin, tasks, options.jobs, partial(write_page, out=options.out))


def judge_twin(out: Path, seed: int, options: SamplerOptions) -> Row:
    """Fit the tests of a twin; return its row."""
    row: Row = {"seed": seed, "draws": options.chains * options.draws}
    try:
        row |= _three_fits(out, seed, replace(options, seed=seed))
    except SamplingError as error:
        row["failure"] = str(error)
    return row


def _three_fits(out: Path, seed: int, options: SamplerOptions) -> Row:
    """Return the choice for a twin, and what its fits say of the quantities of the plan."""
    alone = data_set("constant_rate", seed)
    test = alone.experiments[0]
    truth = test.true_parameters
    assert truth is not None  # simulated
    command = f"benchmarks/design_twins.py, twin {seed}"
    folder = out / f"{seed:06d}"
    first = fit_problem(alone, out=folder / "first", options=options, command=command)
    row = _said_by("first", first, truth)

    began = time.monotonic()
    table = design(first, PLAN, seed=seed).table
    row["design.seconds"] = time.monotonic() - began
    row["choice"] = choice = str(
        table.loc[table["beyond_limits"] == "", f"{CHOSEN_FOR}_width"].idxmin()
    )
    for k, (name, candidate) in enumerate({"chosen": choice, "plain": PLAIN}.items()):
        new = simulate_data(
            with_readings(PLAN.candidates[candidate]),
            truth,
            np.random.default_rng([seed, k]),
            source=command,
        )
        tests = [test, new]
        problem = problem_of(tests, default_priors_for(tests), pooling_for(tests))
        row |= _said_by(
            name, fit_problem(problem, out=folder / name, options=options, command=command), truth
        )
        row |= {f"{name}.{q}.expected": table[f"{q}_width"][candidate] for q in PLAN.about}
    return row


def with_readings(candidate: Candidate) -> Experiment:
    """Return a test with readings of zero at the places where `design` has them."""
    test, n = candidate.experiment, candidate.n_readings
    grid = likelihood_of(test).grid(test)
    at = grid[places_read(len(grid), n)]
    if isinstance(test, HistoryExperiment):
        at = at[at > 0]  # where the model is at rest
        starts = [stage.start_time for stage in test.stages]
        stage = np.searchsorted(starts, at, side="right") - 1
        return replace(test, time=at, reading_stage=stage, reading=np.zeros_like(at))
    assert isinstance(test, ConstantRateExperiment)
    return replace(test, strain=at, stress=np.zeros_like(at))


def _said_by(name: str, result: Fit, truth: Mapping[str, float]) -> Row:
    """Return verdict and cost of a fit, and its draws of each quantity beside the truth.

    Standard deviation and error are of the logarithm, as in `design`; the error is in standard
    deviations. `below` is the share of draws below the truth.
    """
    posterior = result.posterior["posterior"].to_dataset()
    row: Row = {
        f"{name}.failed": ", ".join(not_converged(result, LEAST_ESS)),
        f"{name}.sampled_well": result.sampled_well.value,
        f"{name}.core_seconds": core_seconds(result),
    }
    for quantity in PLAN.about:
        distance = np.log(all_draws(posterior[quantity]) / truth[quantity])
        row |= {
            f"{name}.{quantity}.sd": distance.std(),
            f"{name}.{quantity}.error": abs(distance.mean()) / distance.std(),
            f"{name}.{quantity}.below": float(np.mean(distance < 0)),
        }
    return row


def write_page(rows: pd.DataFrame, out: Path) -> None:
    """Write the table in Markdown."""
    lacks = rows.reindex(columns=["failure", *(f"{name}.failed" for name in FITS)])
    kept = rows[lacks.isna().all(axis=1)]
    if kept.empty:
        return
    seconds = kept[[f"{name}.core_seconds" for name in FITS]].sum(axis=1)
    text = PAGE.format(
        twins=len(rows),
        left_out=len(rows) - len(kept),
        ess=LEAST_ESS,
        draws=", ".join(str(one) for one in sorted(set(rows["draws"]))),
        choices=", ".join(f"{c} {n}" for c, n in kept["choice"].value_counts().items()),
        seconds=seconds.median() + kept["design.seconds"].median(),
        table=markdown(quantity_table(kept)),
    )
    write_text(out / "design_twins.md", text)


def quantity_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Compare the chosen test with the plain one, for each quantity of the plan."""
    found = []
    for quantity in PLAN.about:
        sd = {name: rows[f"{name}.{quantity}.sd"] for name in FITS}
        ratio = sd["chosen"] / sd["plain"]
        row: Row = {
            "quantity": PARAMETER_BY_NAME[quantity].symbol,
            "chosen is narrower": f"{(ratio < 1).sum()} of {len(rows)}",
            "chosen / plain": _spread(ratio),
        }
        for name in FITS[1:]:
            expected = rows[f"{name}.{quantity}.expected"]
            row |= {
                f"{name}: expected": expected.median(),
                f"{name}: reached / expected": _spread(sd[name] / sd["first"] / expected),
            }
        for name in FITS:
            inside = rows[f"{name}.{quantity}.below"].between(0.05, 0.95)
            row[f"{name}: truth in 90 %"] = f"{inside.sum()} of {len(rows)}"
        found.append(row)
    return pd.DataFrame(found)


def _spread(values: pd.Series) -> str:
    """Say the median of values, and what 80 % of them lie within."""
    low, middle, high = values.quantile([0.1, 0.5, 0.9])
    return f"{middle:.2f} ({low:.2f} to {high:.2f})"


PAGE = """# Designs on twins

Written by `benchmarks/design_twins.py`; do not edit. All tests are **synthetic**. Parameters of a
twin come from the priors of the calibration of ice. Its first test has the conditions of PIL40.
`pyburgers design` chooses the test of data/designs/ice.toml that is expected to narrow n most. The
plain choice is the same test again. First and new test are fitted together, with default priors and
pooling. Each test has a microstructure of its own, and shares the other parameters.
Fits have {draws} draws, fewer than by default.

Of {twins} twins {left_out} are left out, because a fit failed or has not converged: R-hat above
1.05, fewer than {ess} effective draws, or another check of the sampling failed. Choices: {choices}.
The chains and the design of a twin took {seconds:.0f} seconds (median), one process at a time.

{table}

Standard deviations are those of logarithms. `chosen / plain` is their ratio after the two fits.
`expected` is the width by `design`, `reached` the standard deviation after the joint fit over that
after the first. Numbers are medians, in parentheses the range of the middle 80 % of the twins. The
last columns count truths inside the 90 % interval.
"""


if __name__ == "__main__":
    main()

"""How often a default fit is sampled well at first go, and at which cost.

    python benchmarks/first_go.py OUT                      # 40 data sets of each kind: hours
    python benchmarks/first_go.py OUT --kinds creep joint --seeds 0 1 2 --jobs 1
    python benchmarks/first_go.py OUT --chains 2 --draws 500    # a quick look

For each data set parameters are drawn from the priors of a calibration. The test is simulated with
them and fitted as `pyburgers fit` does without options, with the default priors. Each fit is one
row of OUT/first_go.csv. The same command goes on where it stopped; with other settings take another
folder.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pandas as pd
from growing_tables import Key, Row, grow, parser_of
from measures import core_seconds, measure
from tables import ROOT, markdown

from pyburgers import Experiment, HistoryExperiment, SamplerOptions, SamplingError, load_experiment
from pyburgers.checks.fit_checks import CheckKind, Outcome
from pyburgers.common.atomic_files import write_text
from pyburgers.fitting.fit import Fit, fit_problem
from pyburgers.kinds.loading_history.stages import Stage
from pyburgers.kinds.problem import Problem, problem_of
from pyburgers.kinds.together import pooling_for
from pyburgers.model.priors import default_priors, load_priors
from pyburgers.sampling.repetitions import shortened
from pyburgers.sbc.data_sets import Range, calibration_priors, simulate_from_prior

DATA = ROOT / "data"
TEMPLATES = DATA / "calibration"


@dataclass(frozen=True)
class DataSets:
    """Where data sets of a kind come from.

    `templates`: files of the tests whose conditions they have.
    `priors`: of their truths; None takes those of calibrations.
    `stress_range`, `strain_range`: of data like those of a laboratory (Pa, fraction).
    """

    templates: tuple[Path, ...]
    priors: Path | None = None
    stress_range: Range | None = (2e6, 60e6)
    strain_range: Range | None = None


STRAIN_RANGE = (0.01, 0.3)
CREEP = DataSets(
    (TEMPLATES / "ice_creep.toml",), TEMPLATES / "priors" / "ice_creep.toml", None, STRAIN_RANGE
)
MIXED = DataSets(
    (TEMPLATES / "ice_mixed.toml",),
    TEMPLATES / "priors" / "ice_mixed.toml",
    strain_range=(0.05, 0.4),
)
CURVE = DATA / "ice" / "PIL40.toml"

KINDS: Mapping[str, DataSets] = MappingProxyType(
    {
        "constant_rate": DataSets((CURVE,)),
        "rate_steps": DataSets((TEMPLATES / "ice_rate_steps.toml",)),
        "creep": CREEP,
        "load_unload": CREEP,
        "relaxation": replace(MIXED, strain_range=None),
        "three_stages": MIXED,
        "joint": DataSets((CURVE, DATA / "ice" / "PIL72.toml")),
        "oscillation_kept": DataSets((TEMPLATES / "olivine_kept.toml",), stress_range=None),
        "oscillation_removed": DataSets((TEMPLATES / "olivine_removed.toml",), stress_range=None),
    }
)

N_DATA_SETS = 40
"""Of each kind."""

WITHOUT_DRAWS: Row = {"coordinates": "", "divergences": 0, "shortened": 0, "draws": 0}
"""Of a fit that failed."""

LOADS = ((1500.0, 5e6), (1000.0, 5e5), (1500.0, 6e6))
"""Duration (s) and stress (Pa) of the stages of load and unload."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Fit what is missing, and write the tables."""
    parser = parser_of(__doc__, range(N_DATA_SETS))
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--chains", type=int, default=SamplerOptions.chains)
    parser.add_argument("--draws", type=int, default=SamplerOptions.draws)
    options = parser.parse_args(arguments)
    # Each fit is one process: its chains take turns, in the time of two cores.
    sampler = SamplerOptions(chains=options.chains, draws=options.draws, parallel_chains=1)
    sampler = replace(sampler, max_minutes=2 * sampler.minutes_of_sampling)
    tasks: dict[Key, Sequence[object]] = {
        (kind, seed): (options.out, kind, seed, sampler)
        for seed in options.seeds
        for kind in options.kinds
    }

    def write_page(rows: pd.DataFrame) -> None:
        page = PAGE.format(table=markdown(kind_table(rows)))
        write_text(options.out / "first_go.md", page)

    file = options.out / "first_go.csv"
    grow(file, ("kind", "seed"), fit_one, tasks, options.jobs, write_page)


def fit_one(out: Path, kind: str, seed: int, options: SamplerOptions) -> Row:
    """Simulate and fit one data set; return its row."""
    folder = out / kind / f"{seed:06d}"
    try:
        result = fit_problem(
            data_set(kind, seed),
            out=folder,
            options=replace(options, seed=seed),
            command=f"benchmarks/first_go.py, {kind}, data set {seed}",
        )
        row = _row(result)
    except SamplingError as error:
        row = {"sampled_well": Outcome.NO.value, "failed_checks": str(error), **WITHOUT_DRAWS}
    return {"kind": kind, "seed": seed, **row}


def data_set(kind: str, seed: int) -> Problem:
    """Simulate the tests of a data set, with the default priors for their fit."""
    source = KINDS[kind]
    tests = [_template(kind, load_experiment(file)) for file in source.templates]
    first = tests[0]
    priors = (
        calibration_priors(first.material, first.protocol)
        if source.priors is None
        else load_priors(source.priors)
    )
    pooling = pooling_for(tests, None)
    simulated = simulate_from_prior(
        problem_of(tests, priors, pooling),
        seed=seed,
        stress_range=source.stress_range,
        strain_range=source.strain_range,
    ).problem
    return problem_of(
        simulated.experiments, default_priors(first.material, first.protocol), pooling
    )


def _template(kind: str, test: Experiment) -> Experiment:
    """Return the test of a file, or what is made of its clock where the kind has no file."""
    if kind == "relaxation":
        assert isinstance(test, HistoryExperiment)
        kept = test.reading_stage < 2
        return replace(
            test,
            id=kind,
            stages=test.stages[:2],
            time=test.time[kept],
            reading_stage=test.reading_stage[kept],
            reading=test.reading[kept],
        )
    if kind == "load_unload":
        assert isinstance(test, HistoryExperiment)
        edges = np.cumsum([0.0, *(duration for duration, _ in LOADS)])
        share = test.time / test.end_time
        return replace(
            test,
            id=kind,
            stages=tuple(
                Stage("stress", start, end, test.temperature, stress)
                for (start, end), (_, stress) in zip(pairwise(edges), LOADS, strict=True)
            ),
            time=np.concatenate([a + share * (b - a) for a, b in pairwise(edges)]),
            reading_stage=np.repeat(np.arange(len(LOADS)), share.size),
            reading=np.tile(test.reading, len(LOADS)),
        )
    return test


def _row(result: Fit) -> Row:
    """Read verdict and cost of a fit.

    Checks that failed are those of the sampling without a yes. Divergences are among the draws of
    the end and among those put aside, draws those of a chain in the end. Seconds, leapfrogs and
    gradients are of all chains with warm-up; gradients of the warm-up are estimated by its time.
    R-hat and ESS are the worst over the sampled quantities.
    """
    found, manifest = measure(result), result.manifest
    failed = [
        one.name
        for one in result.checks()
        if one.check.kind is CheckKind.SAMPLING and one.outcome is not Outcome.YES
    ]
    aside = shortened(manifest)
    seconds = core_seconds(result)
    least = min(found.ess_bulk, found.ess_tail)
    return {
        "sampled_well": result.sampled_well.value,
        "failed_checks": ", ".join(failed),
        "coordinates": manifest["coordinates"]["system"],
        "divergences": found.divergences + sum(one["divergences"] for one in aside),
        "shortened": len(aside),
        "draws": result.posterior["posterior"].sizes["draw"],
        "core_seconds": seconds,
        "leapfrogs_per_draw": found.leapfrogs / found.draws,
        "gradients": found.leapfrogs * (seconds / found.sampling_seconds),
        "rhat": found.rhat,
        "least_ess": least,
        "ess_per_core_second": least / seconds,
    }


def kind_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Count fits of each kind that were sampled well, and what others lack; medians of costs."""
    found = []
    for kind in (one for one in KINDS if one in set(rows["kind"])):
        own = rows[rows["kind"] == kind]
        checks = Counter(
            name for text in own["failed_checks"].dropna() for name in str(text).split(", ")
        )
        found.append(
            {
                "kind": kind,
                "fits": len(own),
                "sampled well": f"{(own['sampled_well'] == Outcome.YES.value).mean():.0%}",
                "without a yes": ", ".join(f"{n} {c}" for c, n in checks.most_common()),
                "with divergences": int((own["divergences"] > 0).sum()),
                "went on with shorter steps": int((own["shortened"] > 0).sum()),
                "leapfrogs a draw": own["leapfrogs_per_draw"].median(),
                "core-seconds": own["core_seconds"].median(),
                "largest": own["core_seconds"].max(),
                "least ESS a core-second": own["ess_per_core_second"].median(),
                "least ESS per 1000 gradients": (
                    1000 * own["least_ess"] / own["gradients"]
                ).median(),
            }
        )
    return pd.DataFrame(found)


PAGE = """# Default fits at first go

Written by `benchmarks/first_go.py`; do not edit. Data simulated at draws from the priors of
calibrations, fitted with default priors and options. Counts of fits, and medians over fits.
Core-seconds are those of all chains with warm-up, ESS is the least of bulk and tail over the
sampled quantities.

{table}
"""


if __name__ == "__main__":
    main()

"""What a gradient of a loading history takes, beside one of a test at constant rate.

    python benchmarks/histories.py           # some minutes

Three synthetic tests of one material with as many readings each: PIL40, creep, and creep that is
unloaded and loaded again. A short fit sets up the coordinates of each and gives draws, at which
gradients of all tests are timed in turn. Writes a table.
"""

import argparse
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
import pandas as pd
from gradients import ms_per_gradient
from tables import ICE, RESULTS, markdown

from pyburgers.cmdstan.draw_files import read_draws
from pyburgers.cmdstan.program import Program, load_program
from pyburgers.fitting.fit import fit
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.forward import simulate_data
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.stages import Stage
from pyburgers.model.priors import default_priors
from pyburgers.sampling.options import SamplerOptions
from pyburgers.sampling.run_directory import RunDirectory

FloatArray = npt.NDArray[np.float64]

BESIDE = "PIL40"

LOADS: Mapping[str, tuple[tuple[float, float], ...]] = MappingProxyType(
    {
        "creep": ((4000.0, 5e6),),
        "load_unload_load": ((1500.0, 5e6), (1000.0, 5e5), (1500.0, 6e6)),
    }
)
"""Duration (s) and stress (Pa) of the stages of each history."""

NOISE: Mapping[str, float] = MappingProxyType(
    {
        "strain_noise": 5e-4,
        "residual_correlation_time": 150.0,
        "residual_correlated_share": 0.6,
    }
)
"""Of their readings (SI)."""

SHORT_FIT = SamplerOptions(chains=1, warmup=60, draws=16, max_treedepth=6, seed=1)
POINTS, TIMED, ROUNDS = 8, 100, 7
"""Draws at which gradients are timed, how many at each, and how often in turn."""

PAGE = """# Gradients of loading histories

Written by `make bench`; do not edit. Synthetic tests of the material of PIL40 with {readings}
readings each; milliseconds of one core for a gradient, median of {rounds} rounds in which {timed}
gradients are timed at each of {points} draws of a short fit, least and largest round in brackets.
Ratios of rounds are less uncertain than times: the tests take turns.

{table}
"""


@dataclass(frozen=True)
class Timed:
    """A fitted test whose gradients are timed.

    Attributes
    ----------
    program : Program
        Its program.
    data : Path
        Data of the program.
    points : array, shape (n_points, n_coordinates)
        Draws.
    """

    program: Program
    data: Path
    points: FloatArray


def main() -> None:
    """Fit, measure, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=RESULTS)
    out: Path = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    beside = load_constant_rate(ICE / f"{BESIDE}.toml")
    tests: list[Experiment] = [beside, *(_history(name, beside) for name in LOADS)]
    with tempfile.TemporaryDirectory() as folder:
        timed = {test.id: _fitted(test, Path(folder) / test.id) for test in tests}
        rounds = [
            {name: ms_per_gradient(one.program, one.data, one.points, TIMED)[1]
             for name, one in timed.items()}
            for _ in range(ROUNDS)
        ]  # fmt: skip
    taken = pd.DataFrame(rounds)
    table = markdown(_table(taken, taken.div(taken[BESIDE], axis=0)))
    print(table)
    page = PAGE.format(
        readings=beside.n_points, rounds=ROUNDS, timed=TIMED, points=POINTS, table=table
    )
    (out / "histories.md").write_text(page, encoding="utf-8")


def _history(name: str, beside: ConstantRateExperiment) -> HistoryExperiment:
    """Make a history of the material of a test with as many readings, dense after each load."""
    stages, start = [], 0.0
    for duration, stress in LOADS[name]:
        end = start + duration
        stages.append(Stage("stress", start, end, beside.temperature, stress))
        start = end
    shares = np.array_split(np.arange(beside.n_points), len(stages))
    times = [
        stage.start_time
        + (stage.end_time - stage.start_time) * np.linspace(0, 1, here.size + 1)[1:] ** 2
        for stage, here in zip(stages, shares, strict=True)
    ]
    empty = HistoryExperiment(
        id=name,
        material=beside.material,
        temperature=beside.temperature,
        initial_grain_size=beside.initial_grain_size,
        provenance=beside.provenance,
        metadata={},
        notices=(),
        true_parameters=None,
        stages=tuple(stages),
        time=np.concatenate(times),
        reading_stage=np.repeat(np.arange(len(stages)), [here.size for here in shares]),
        reading=np.zeros(beside.n_points),
    )
    truth = {**(beside.true_parameters or {}), **NOISE}
    return simulate_data(empty, truth, np.random.default_rng(20261122), source="one material")


def _fitted(test: Experiment, out: Path) -> Timed:
    """Fit a test for a short while."""
    fit(test, default_priors(test.material), out=out, options=SHORT_FIT)
    run = RunDirectory(out)
    draws = read_draws([run.draws_file(1)])["coordinate"][0]
    points = draws[:: max(1, len(draws) // POINTS)][:POINTS]
    return Timed(load_program(likelihood_of(test).program), run.stan_data_file, points)


def _table(taken: pd.DataFrame, ratio: pd.DataFrame) -> pd.DataFrame:
    """Return times of a gradient (ms) and ratios: median and range of the rounds."""

    def spread(values: "pd.Series[float]") -> str:
        return f"{values.median():.3g} ({values.min():.3g} to {values.max():.3g})"

    return pd.DataFrame(
        {
            "test": list(taken),
            "stages": [len(LOADS[name]) if name in LOADS else 1 for name in map(str, taken)],
            "a gradient (ms)": [spread(taken[name]) for name in map(str, taken)],
            f"over that of {BESIDE}": [spread(ratio[name]) for name in map(str, taken)],
        }
    )


if __name__ == "__main__":
    main()

"""How the sampler takes other records: noise levels, short ones, few points.

Simulates tests at the truth behind the synthetic test PIL40 with other noise or less of the curve,
fits each with the defaults, and writes a table:

    python benchmarks/records.py             # about 8 minutes on two cores
"""

import argparse
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from measures import measure
from tables import ICE, RESULTS, markdown

from pyburgers import ConstantRateExperiment, SamplerOptions, fit
from pyburgers.common.array_types import FloatArray
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.forward import simulate_data
from pyburgers.model.priors import default_priors
from pyburgers.page.tables import truth_table

EXPLANATION = """# Other records

Written by `python benchmarks/records.py`; do not edit. All records are **synthetic**: the curve at
the truth behind PIL40 (peak 8 MPa at 3.1 % strain, 61 points to 20 %), with other noise or less of
it. Defaults throughout: 4 chains of 300 + 1000 iterations, target acceptance 0.98. ESS are the
least over the sampled quantities; ESS/s are per second of one core, sampling alone and with
warm-up.

{table}
"""


@dataclass(frozen=True)
class Record:
    """A simulated record: its noise in Pa and the points that are kept of PIL40's strains."""

    name: str
    noise: float
    kept: Callable[[FloatArray], FloatArray]


RECORDS = (
    *(Record(f"noise {noise:g} MPa", noise * 1e6, lambda e: e) for noise in (0.05, 0.1, 0.3)),
    Record("0.05 MPa, every fourth point", 5e4, lambda e: e[::4]),
    Record("0.05 MPa, to 6 % strain: no steady state", 5e4, lambda e: e[e <= 0.06]),
    Record("0.05 MPa, to 2.4 % strain: no peak", 5e4, lambda e: e[e <= 0.024]),
    Record("noise 0.02 MPa", 2e4, lambda e: e),
)


def main() -> None:
    """Fit every record and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=RESULTS)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rows = []
    options.out.mkdir(parents=True, exist_ok=True)
    for record in RECORDS:
        with tempfile.TemporaryDirectory() as folder:
            rows.append(_row(record, Path(folder) / "run", options.seed))
        print(rows[-1], flush=True)
        page = EXPLANATION.format(table=markdown(pd.DataFrame(rows)))
        (options.out / "records.md").write_text(page, encoding="utf-8")


def _row(record: Record, folder: Path, seed: int) -> dict[str, str | float]:
    experiment = _simulated(record, seed)
    result = fit(experiment, default_priors("ice"), out=folder, options=SamplerOptions(seed=seed))
    got = measure(result)
    truth = truth_table(result)
    assert truth is not None
    return {
        "record": record.name,
        "points": experiment.n_points,
        "coordinates": result.manifest["coordinates"]["system"],
        "leapfrogs per draw": got.leapfrogs / got.draws,
        "divergences": got.divergences,
        "R-hat": got.rhat,
        "bulk ESS": got.ess_bulk,
        "tail ESS": got.ess_tail,
        "bulk ESS/s": got.ess_bulk / got.sampling_seconds,
        "with warm-up": got.ess_bulk / (got.sampling_seconds + got.warmup_seconds),
        "true values inside 95 %": f"{int(truth['inside_95'].sum())} of {len(truth)}",
    }


def _simulated(record: Record, seed: int) -> ConstantRateExperiment:
    full = load_constant_rate(ICE / "PIL40.toml")
    assert full.true_parameters is not None
    strain = record.kept(full.strain)
    cut = replace(full, id="PIL40_other", strain=strain, final_strain=float(strain[-1]))
    values = {**full.true_parameters, "stress_noise": record.noise}
    rng = np.random.default_rng(seed)
    return simulate_data(cut, values, rng, source="at the truth of PIL40")


if __name__ == "__main__":
    main()

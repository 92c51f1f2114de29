"""Use the Stan functions of pyburgers in a program of your own.

    python flow_stress.py runs/PIL40 --strain 0.2 --out flow_stress.csv

`flow_stress.stan` beside this file includes two files of the installed package. Here it is
compiled, and run at the draws of a saved fit: stress against strain rate after some strain, which
says how well one test fixes the strength of ice at the much lower rates of a glacier.
"""

import argparse
import logging
from pathlib import Path

import numpy as np
import pandas as pd

import pyburgers

PROGRAM = Path(__file__).with_name("flow_stress.stan")
PARAMETERS = (
    "stress_exponent",
    "grain_size_exponent",
    "activation_enthalpy",
    "beta",
    "steady_state_grain_size",
    "steady_state_fabric_factor",
    "critical_strain_grain_size",
    "critical_strain_fabric",
)


def main() -> None:
    """Write a table of posterior quantiles of the stress (MPa) by strain rate."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, help="run directory of a fit of ice")
    parser.add_argument("--strain", type=float, default=0.2, help="fraction")
    parser.add_argument("--draws", type=int, default=200, help="draws to use")
    parser.add_argument("--out", type=Path, default=Path("flow_stress.csv"), metavar="FILE.csv")
    options = parser.parse_args()

    fit = pyburgers.Fit.load(options.run)
    draws = fit.posterior["posterior"].to_dataset().stack(sample=("chain", "draw"))
    chosen = np.linspace(0, draws.sizes["sample"] - 1, options.draws).round().astype(int)
    strain_rate = np.geomspace(1e-9, 1e-3, 7)

    # "#include physics/..." in a program is looked up in the package. The first call compiles,
    # later ones find the executable in a cache.
    logging.basicConfig(format="%(message)s")
    logging.getLogger("pyburgers").setLevel(logging.INFO)
    program = pyburgers.load_program(PROGRAM)
    values = program.evaluate(
        {
            "n_draws": chosen.size,
            **{name: draws[name].to_numpy()[chosen].tolist() for name in PARAMETERS},
            "n_rates": strain_rate.size,
            "strain_rate": strain_rate.tolist(),
            "path_strain": options.strain,
            "initial_grain_size": fit.experiment.initial_grain_size,
            "temperature": fit.experiment.temperature,
        },
    )

    stress = values["flow_stress"] / 1e6  # shape (n_draws, n_rates)
    low, median, high = np.quantile(stress, [0.05, 0.5, 0.95], axis=0)
    table = pd.DataFrame(
        {"strain_rate_per_s": strain_rate, "q5_MPa": low, "q50_MPa": median, "q95_MPa": high}
    )
    options.out.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(options.out, index=False)
    print(table.to_string(index=False))
    print("written to", options.out)


if __name__ == "__main__":
    main()

"""Predict from a saved fit how strongly the material damps stress cycles.

    python predict_attenuation.py runs/PIL40 --out attenuation

The fit knows one test at a constant strain rate; the prediction is for another load, cycles of
stress about a constant median stress. `pyburgers predict attenuation` does the same in one line.
"""

import argparse
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt

import pyburgers


def main() -> None:
    """Write a table of posterior quantiles and a figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, help="run directory of a fit")
    parser.add_argument("--out", type=Path, default=Path("attenuation"), help="folder")
    parser.add_argument(
        "--median-stress-MPa", type=float, nargs="+", default=[0.5, 1.0, 2.0], metavar="M"
    )
    parser.add_argument("--temperature-K", type=float, help="default: that of the test")
    options = parser.parse_args()

    fit = pyburgers.Fit.load(options.run)

    # Here the cycles are a tenth of the median stress either way, from 3 hours to 1 s long.
    regimes = [
        pyburgers.Regime(median_stress=stress * 1e6, amplitude=0.1 * stress * 1e6)
        for stress in options.median_stress_MPa
    ]
    spectrum = pyburgers.predict_attenuation(
        fit,
        np.geomspace(1e-4, 1.0, 80),
        regimes,
        microstructure="initial",  # or "steady_state", as after much strain
        temperature=options.temperature_K,
    )

    # tan(delta) of every draw, dimensions (chain, draw, regime, frequency).
    at_one_millihertz = spectrum["tan_delta"].sel(frequency=1e-3, method="nearest")
    for label in spectrum["regime"].to_numpy():
        low, high = at_one_millihertz.sel(regime=label).quantile([0.05, 0.95])
        print(f"{label}: tan(delta) at 1 mHz is {low:.3g} to {high:.3g} (90 %)")
        # Beyond some strain of the hold and the cycles, the microstructure would change.
        fails = float(spectrum["frozen_fails"].sel(regime=label).mean())
        print(f"  the strain is too large for frozen grains in {100 * fails:.0f} % of the draws")

    options.out.mkdir(parents=True, exist_ok=True)
    bands = spectrum["tan_delta"].quantile([0.05, 0.5, 0.95], ("chain", "draw"))
    table = bands.to_dataset("quantile").to_dataframe()
    table.to_csv(options.out / "attenuation.csv")
    figure, axes = plt.subplots(layout="constrained")
    for label in spectrum["regime"].to_numpy():
        low, median, high = bands.sel(regime=label)
        (line,) = axes.loglog(spectrum["frequency"], median, label=label)
        axes.fill_between(spectrum["frequency"], low, high, alpha=0.3, color=line.get_color())
    axes.set(xlabel="frequency (Hz)", ylabel="tan δ", title=spectrum.attrs["title"])
    axes.legend(title="median stress ± amplitude")
    figure.savefig(options.out / "attenuation.png")
    print("written to", options.out)


if __name__ == "__main__":
    main()

"""How often bands of predicted tests cover the truth, beside how often they say they do.

Truths from priors; for each a short constant-rate test with a step of the rate and noise, its fit,
and the creep test that the same truth gives, predicted from the fit:

    python benchmarks/predictions.py         # 50 twins, minutes on two idle cores
"""

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy import stats
from tables import ICE, RESULTS, markdown

from pyburgers import Fit, LoadingHistory, Outcome, Prediction, SamplerOptions, fit
from pyburgers.common.array_types import FloatArray
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment, RateSegment
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.forward import simulate, simulate_data
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.model.parameters import PARAMETER_BY_NAME
from pyburgers.model.prior_families import fixed_prior
from pyburgers.model.priors import PriorSet, default_priors
from pyburgers.predictions.other_tests import BANDS

EXPLANATION = """# Predicted creep

Written by `python benchmarks/predictions.py`; do not edit. All tests are **synthetic**. Truths come
from the priors of ice, with {free} free
and the rest known (fixed at the truth of PIL40). Each gives a constant-rate test of {points} points
to {final:g} % strain with one step of the rate and noise of {noise:g} % of the largest stress. It
is fitted with {chains} chains of {warmup} + {draws} iterations (of {longer_warmup} + {longer_draws}
where a check of the sampling fails after that, and then with {more_draws} draws more), and the fit
predicts a creep test of that truth: {stress:g} of the largest stress of the curve for {time:g} h,
then {lower:g} of it as long. Whether the true strain, with as many digits as predictions have, lies
in the bands of the solution is counted at the ends of both stages and early in each. {n} twins,
{longer} of them fitted longer, {left_out} left out because a check still failed.

{table}

`expected` is the range that holds 95 % of such counts if every band had its nominal probability.
"""

TWIN = load_constant_rate(ICE / "PIL40.toml")

FREE = ("kelvin_viscosity", "stress_exponent", "activation_enthalpy", "stress_noise")
"""As few as let elements and flow law matter, so that many twins can be fitted."""

NOISE = 0.01
STRESS_SHARE, LOWER_SHARE, STAGE_TIME = 0.7, 0.5, 1800.0
"""Creep is as stressed as its sample asks for: at fixed stresses some truths of these priors do not
flow at all, and their strains, then known to more digits than draws are kept with, tell nothing."""

OPTIONS = SamplerOptions(chains=2, warmup=200, draws=500, parallel_chains=1)
LONGER = replace(OPTIONS, warmup=800, draws=2000)
LONGER_NAME = "_longer"
MORE_DRAWS = 6000
KEPT_DIGITS = 6
"""Of predicted strains: what CmdStan writes."""

SHARES = (0.02, 1.0)
"""Of a stage, where its strain is looked at."""


def main() -> None:
    """Simulate, fit and predict every twin and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--twins", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--runs", type=Path, help="folder that keeps the fits; default: none")
    options = parser.parse_args()
    template, priors = constant_rate_template(), mostly_known()
    rows, n_longer, left_out = [], 0, 0
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.runs or Path(scratch)
        for number in range(options.twins):
            rng = np.random.default_rng([options.seed, number])
            truth = draw_truth(priors, rng)
            test = simulate_data(template, truth, rng, source="benchmarks/predictions.py")
            fitted = well_sampled(test, priors, folder / str(number), seed=number + 1)
            if fitted is None:
                left_out += 1
                continue
            n_longer += fitted.directory.path.name.endswith(LONGER_NAME)
            rows += hits(fitted, truth)
    table = coverage(pd.DataFrame(rows))
    text = EXPLANATION.format(
        free=", ".join(PARAMETER_BY_NAME[name].label for name in FREE),
        points=template.n_points,
        final=100 * template.final_strain,
        noise=100 * NOISE,
        chains=OPTIONS.chains,
        warmup=OPTIONS.warmup,
        draws=OPTIONS.draws,
        longer_warmup=LONGER.warmup,
        longer_draws=LONGER.draws,
        more_draws=MORE_DRAWS,
        stress=STRESS_SHARE,
        lower=LOWER_SHARE,
        time=STAGE_TIME / 3600,
        n=options.twins,
        longer=n_longer,
        left_out=left_out,
        table=markdown(table),
    )
    (RESULTS / "predictions.md").write_text(text, encoding="utf-8")
    print(text)


def well_sampled(
    test: ConstantRateExperiment, priors: PriorSet, out: Path, *, seed: int
) -> Fit | None:
    """Fit a test; with longer chains, and then with more draws, where a check of them fails.

    None if a check fails to the last.
    """
    longer = out.with_name(out.name + LONGER_NAME)
    for options, folder in ((OPTIONS, out), (LONGER, longer)):
        fitted = fit(test, priors, out=folder, options=replace(options, seed=seed))
        if fitted.sampled_well is Outcome.YES:
            return fitted
    if not fitted.directory.n_extensions():
        fitted = fit(
            test,
            priors,
            out=longer,
            options=replace(LONGER, seed=seed),
            more_draws=MORE_DRAWS,
        )
    return fitted if fitted.sampled_well is Outcome.YES else None


def constant_rate_template() -> ConstantRateExperiment:
    """Return a short test with a step of the rate; its stresses do not matter."""
    strain = np.concatenate([np.geomspace(5e-4, 0.02, 10), np.linspace(0.021, 0.03, 6)])
    return replace(
        TWIN,
        segments=(RateSegment(0.0, 1e-4), RateSegment(0.02, 2e-5)),
        strain=strain,
        stress=np.full_like(strain, 5e6),
        final_strain=0.03,
    )


def mostly_known() -> PriorSet:
    """Return the priors of ice with all but a few parameters known."""
    assert TWIN.true_parameters is not None
    fixed = (
        fixed_prior(PARAMETER_BY_NAME[name], value, "truth of PIL40")
        for name, value in TWIN.true_parameters.items()
        if name not in FREE
    )
    return default_priors("ice").exchanging(*fixed)


def draw_truth(priors: PriorSet, rng: np.random.Generator) -> dict[str, float]:
    """Draw the free parameters; the noise is a share of the largest stress without noise."""
    values = priors.resolved(1e7).sample(rng)
    clean = simulate(constant_rate_template(), values)
    return {**values, "stress_noise": NOISE * float(clean["stress_Pa"].max())}


def creep_of(test: ConstantRateExperiment) -> HistoryExperiment:
    """Return the creep test, without readings, of the sample of another one."""
    stages = [
        {
            "control": "stress",
            "start_time": k * STAGE_TIME,
            "end_time": (k + 1) * STAGE_TIME,
            "stress": share * test.largest_stress,
        }
        for k, share in enumerate((STRESS_SHARE, LOWER_SHARE))
    ]
    return LoadingHistory(
        stages=stages,
        time_unit="s",
        stress_unit="Pa",
        temperature_K=test.temperature,
        grain_size_um=1e6 * test.initial_grain_size,
        material=test.material,
        name="creep",
    )


def hits(fitted: Fit, truth: dict[str, float]) -> list[dict[str, object]]:
    """Return whether the true strains of the creep test lie in the bands, a row for each."""
    assert isinstance(fitted.experiment, ConstantRateExperiment)
    creep = creep_of(fitted.experiment)
    prediction = fitted.predict(creep)
    solved = prediction.posterior["predictions"].to_dataset()
    time = solved["time"].to_numpy()
    true = as_kept(simulate(creep, truth, at=time)["strain"].to_numpy())
    rows: list[dict[str, object]] = []
    for place in places(prediction):
        draws = solved["strain"].to_numpy()[0, :, place]
        row: dict[str, object] = {"time": f"{time[place] / 3600:.3g} h"}
        for band in BANDS:
            tail = (1 - band / 100) / 2
            low, high = np.quantile(draws, [tail, 1 - tail])
            row[f"{band} %"] = bool(low <= true[place] <= high)
        rows.append(row)
    return rows


def as_kept(values: FloatArray) -> npt.NDArray[np.float32]:
    """Round as predictions are: the strain of what hardly flows is the end of their band."""
    return np.array([f"{value:.{KEPT_DIGITS}g}" for value in values], dtype=np.float32)


def places(prediction: Prediction) -> list[int]:
    """Return where on the grid of a prediction the strain is looked at."""
    time = prediction.posterior["predictions"]["time"].to_numpy()
    wanted = [STAGE_TIME * (stage + share) for stage in (0, 1) for share in SHARES]
    return [int(np.argmin(np.abs(time - one))) for one in wanted]


def coverage(rows: pd.DataFrame) -> pd.DataFrame:
    """Count hits by time and band, with the range that holds 95 % of such counts."""
    found = []
    for time, group in rows.groupby("time", sort=False):
        for band in BANDS:
            low, high = stats.binom.interval(0.95, len(group), band / 100)
            found.append(
                {
                    "time": time,
                    "band": f"{band} %",
                    "inside": int(group[f"{band} %"].sum()),
                    "twins": len(group),
                    "expected": f"{low:.0f} to {high:.0f}",
                }
            )
    return pd.DataFrame(found)


if __name__ == "__main__":
    main()

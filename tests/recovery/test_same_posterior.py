"""Valley coordinates sample the posterior that the priors and the data define."""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import arviz as az
import numpy as np
import pytest
import xarray as xr
from conftest import ICE, resolved_priors, with_priors

from pyburgers.calibration import (
    Replication,
    counts_at_most,
    replicate,
    simultaneous_band,
)
from pyburgers.constant_rate import ConstantRateExperiment, load_constant_rate
from pyburgers.fitting import Fit, fit
from pyburgers.posterior import convergence_table, free_parameters, grain_size_share
from pyburgers.priors import PriorSet, default_priors
from pyburgers.sampling import SamplerOptions

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("programs")]

N_DATA_SETS = 100
N_RANKED_DRAWS = 100


def laboratory_priors(experiment: ConstantRateExperiment) -> PriorSet:
    """Priors whose draws look like laboratory tests.

    Table 1 allows reference stresses from 0.3 to 1000 MPa, most of them far from any test.
    """
    priors = resolved_priors(experiment)
    narrower = {
        "stress_exponent": replace(
            priors["stress_exponent"], location=3.95, scale=0.5, lower=3.7, upper=4.2
        ),
        "activation_enthalpy": replace(priors["activation_enthalpy"], scale=500.0),
        "stress_noise": replace(
            priors["stress_noise"],
            family="lognormal",
            location=1e5,
            scale=0.5,
            lower=0.0,
            upper=np.inf,
        ),
    }
    return with_priors(priors, narrower)


def moments(result: Fit) -> tuple[xr.Dataset, xr.Dataset, xr.Dataset, xr.Dataset]:
    """Means, standard deviations, and the Monte Carlo errors of both."""
    draws = result.posterior["posterior"].to_dataset()[free_parameters(result.posterior)]
    over = ("chain", "draw")
    spread = draws.std(over)
    # Effective sizes above the number of draws, of antithetic chains, are too good to build on.
    independent = spread / np.sqrt(draws.sizes["chain"] * draws.sizes["draw"])
    return (
        draws.mean(over),
        spread,
        np.maximum(az.mcse(draws, method="mean"), independent),
        np.maximum(az.mcse(draws, method="sd"), independent / np.sqrt(2)),
    )


def test_plain_and_valley_coordinates_give_the_same_moments(tmp_path: Path) -> None:
    experiment = load_constant_rate(ICE / "PIL40.toml")
    # Plain coordinates converge where the noise is large and the valley wide.
    rng = np.random.default_rng(5)
    noisy = replace(experiment, stress=experiment.stress + 8e5 * rng.standard_normal(61))
    priors = resolved_priors(experiment)
    wider = replace(
        priors["stress_noise"], family="lognormal", location=8e5, scale=0.5, upper=np.inf
    )
    priors = with_priors(priors, {"stress_noise": wider})
    results = {}
    for system in ("plain", "valley"):
        options = SamplerOptions(chains=4, warmup=500, draws=2500, coordinates=system)
        results[system] = fit(noisy, priors, out=tmp_path / system, options=options, report=print)
        table = convergence_table(results[system].posterior)
        assert table["rhat"].max() < 1.01, system
        assert table["ess_bulk"].min() > 400, system
    plain, valley = (moments(results[system]) for system in ("plain", "valley"))
    for what, k in (("mean", 0), ("sd", 1)):
        for name in plain[k].data_vars:
            difference = float(plain[k][name] - valley[k][name])
            error = float(np.hypot(plain[k + 2][name], valley[k + 2][name]))
            # 26 comparisons: 4 errors are passed by chance once in 600 runs.
            assert abs(difference) < 4 * error, (what, name, difference / error)


def test_both_arms_of_the_valley_are_visited(tmp_path: Path) -> None:
    experiment = load_constant_rate(ICE / "PIL40.toml")
    options = {
        "usual": SamplerOptions(seed=3),
        "long": SamplerOptions(seed=4, warmup=600, draws=4000),
    }
    fractions, errors = {}, {}
    for name, option in options.items():
        result = fit(
            experiment, default_priors("ice"), out=tmp_path / name, options=option, report=print
        )
        by_grain_size = (grain_size_share(result.posterior) > 0.5).astype(float)
        effective = float(az.ess(by_grain_size.rename("arm").to_dataset())["arm"])
        share = float(by_grain_size.mean())
        assert 0.02 < share < 0.98
        fractions[name], errors[name] = share, np.sqrt(share * (1 - share) / effective)
        chains = by_grain_size.mean("draw").to_numpy()
        print(f"{name}: {share:.3f} +- {errors[name]:.3f} on the grain-size arm, chains {chains}")
        # An error of one chain is that of all, times the root of their number.
        assert np.all(np.abs(chains - share) < 4 * errors[name] * np.sqrt(chains.size))
    difference = fractions["usual"] - fractions["long"]
    assert abs(difference) < 4 * np.hypot(errors["usual"], errors["long"])


def replication(
    seed: int, experiment: ConstantRateExperiment, priors: PriorSet, folder: Path
) -> Replication:
    return replicate(
        experiment,
        priors,
        folder / str(seed),
        seed=seed,
        options=SamplerOptions(chains=2, warmup=300, draws=300, adapt_delta=0.95),
        n_thinned=N_RANKED_DRAWS,
    )


def test_ranks_of_simulated_truths_are_uniform(tmp_path: Path) -> None:
    experiment = load_constant_rate(ICE / "PIL40.toml")
    run = partial(
        replication,
        experiment=experiment,
        priors=laboratory_priors(experiment),
        folder=tmp_path,
    )
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        done = list(pool.map(run, range(1, N_DATA_SETS + 1)))
    print(
        f"{sum(r.divergences for r in done)} divergences, largest R-hat "
        f"{max(r.rhat for r in done):.3f}, {sum(r.n_unsolvable for r in done)} draws from the "
        f"prior without solution, {sum(r.coordinates == 'plain' for r in done)} fits in plain ones"
    )
    names = sorted(done[0].ranks)
    # The bands hold jointly for all parameters in 95 of 100 calibrations of a right program.
    lower, upper = simultaneous_band(
        N_DATA_SETS, N_RANKED_DRAWS, probability=0.95 ** (1 / len(names))
    )
    outside = {}
    for name in names:
        counts = counts_at_most([r.ranks[name] for r in done], N_RANKED_DRAWS)
        outside[name] = int(np.sum((counts < lower) | (counts > upper)))
    assert outside == dict.fromkeys(names, 0)

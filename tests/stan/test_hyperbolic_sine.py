"""The hyperbolic-sine dashpot: stress cycles, extreme parameters, a fit (`test_laws`: the rest)."""

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import oracle
import pytest
from conftest import ICE, write_problem
from imposed_stress import simulate_imposed_stress
from scipy.integrate import quad

from pyburgers.cli.main import main
from pyburgers.common.errors import InputError, SamplingError
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.forward import simulate
from pyburgers.model.priors import load_priors
from pyburgers.predictions.attenuation import attenuation_spectrum, predict_attenuation
from pyburgers.predictions.stress_cycles import Regime

pytestmark = pytest.mark.usefixtures("programs")


def truth(**changes: float) -> dict[str, float]:
    return {**(load_constant_rate(ICE / "PIL40.toml").true_parameters or {}), **changes}


REGIMES = (Regime(2e6, 0.9e6), Regime(0.5e6, 2e6))
CONDITIONS: dict[str, Any] = {"temperature": 263.0, "grain_size": 2e-4, "fabric_factor": 0.7}


def dashpot_rate(parameters: dict[str, float], stress: float) -> float:
    return float(oracle.dashpot_rate(parameters, 263.0, stress, 2e-4, 0.7))


@pytest.mark.parametrize("regime", REGIMES, ids=["median", "changing sign"])
def test_stress_cycles_and_attenuation_agree_with_quadrature(regime: Regime) -> None:
    parameters, frequency, hold = truth(breakdown_stress=0.8e6), 1e-3, 3600.0

    def rate(angle: float) -> float:
        stress = regime.median_stress + regime.amplitude * np.sin(angle)
        return dashpot_rate(parameters, stress)

    def over_a_cycle(integrand: Callable[[float], float]) -> float:
        zero = float(np.arcsin(min(1.0, regime.median_stress / regime.amplitude)))
        corners = [0.0, np.pi + zero, 2 * np.pi - zero, 2 * np.pi]
        parts = [
            float(quad(integrand, low, high, epsabs=0.0, epsrel=1e-11, limit=400)[0])
            for low, high in itertools.pairwise(corners)
            if high > low
        ]
        return sum(parts)

    spectrum = attenuation_spectrum(
        {**parameters, "kelvin_viscosity": 0.0}, [1.0], [regime], **CONDITIONS
    )
    loss = over_a_cycle(lambda angle: rate(angle) * float(np.sin(angle)))
    expected = loss / (np.pi * regime.amplitude * 2 * np.pi)
    assert spectrum["loss_compliance"].item() == pytest.approx(expected, rel=1e-8)

    cycle = simulate_imposed_stress(
        parameters,
        regime,
        frequency,
        np.array([1 / frequency]),
        hold_time=hold,
        **CONDITIONS,
    )
    drift = over_a_cycle(rate) / (2 * np.pi * frequency)
    held, after = cycle["dashpot_strain"]
    assert held == pytest.approx(hold * dashpot_rate(parameters, regime.median_stress), rel=1e-8)
    assert after - held == pytest.approx(drift, rel=1e-7)


def test_a_breakdown_far_below_the_stress_is_solved_or_refused_but_never_nan() -> None:
    for breakdown in (1e5, 1e2, 1e-3):
        try:
            found = simulate(
                load_constant_rate(ICE / "PIL40.toml"), truth(breakdown_stress=breakdown)
            )
        except SamplingError:
            continue
        assert np.isfinite(found["stress_Pa"]).all()
        assert found["stress_Pa"].max() < 40 * breakdown


def test_a_prior_with_mass_at_no_breakdown_stress_at_all_is_refused(tmp_path: Path) -> None:
    text = (ICE.parent / "priors" / "ice.toml").read_text(encoding="utf-8")
    table = '[parameters.breakdown_stress]\nsource = "test"\nfamily = "half_normal"\nscale = 1\n'
    (tmp_path / "priors.toml").write_text(f'{text}\n{table}unit = "MPa"\n', encoding="utf-8")
    with pytest.raises(InputError, match=r"breakdown_stress.*the model breaks down at zero"):
        load_priors(tmp_path / "priors.toml")


@pytest.mark.slow
def test_a_short_test_is_fitted(tmp_path: Path) -> None:
    free = {"maxwell_modulus", "activation_enthalpy", "stress_noise"}
    # Beyond the peak, where the dashpot carries the whole rate.
    problem = write_problem(tmp_path / "inputs", free=free, max_strain=0.05, stride=2)
    code = main(
        [
            *("fit", str(problem.experiment_file), "--out", str(tmp_path / "run")),
            *("--priors", str(problem.priors_file), "--variant", "maxwell=hyperbolic_sine"),
            *("--chains", "1", "--warmup", "100", "--draws", "60", "--seed", "11"),
            *("--adapt-delta", "0.8"),
        ]
    )
    assert code in (0, 3)
    fit = Fit.load(tmp_path / "run")
    assert fit.variant.short_text == "maxwell=hyperbolic_sine"
    assert fit.manifest["coordinates"]["system"] == "plain"
    assert "hyperbolic sine" in fit.manifest["coordinates"]["reason"]
    # The data are those of a power law: a breakdown within their stresses is ruled out.
    breakdown = fit.posterior["posterior"]["breakdown_stress"]
    assert float(breakdown.min()) > 0.5 * fit.experiment.largest_stress
    spectrum = predict_attenuation(fit, [1e-3])
    assert np.isfinite(spectrum["tan_delta"]).all()

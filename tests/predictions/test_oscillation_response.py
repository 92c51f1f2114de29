"""Amplitude and phase lag of the stress: of the record, of solutions and of replicated data."""

from pathlib import Path

import numpy as np
import pytest
from synthetic_olivine_fit import make_olivine_fit, oscillating

from pyburgers.common.draws import central_band
from pyburgers.drawing.views.oscillation_response import (
    observed_response,
    predicted_response,
    replicated_response,
    response_table,
)
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.experiment import of_kind
from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment
from pyburgers.kinds.forced_oscillation.harmonics import choose_degree, fit_harmonics


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    return make_olivine_fit(tmp_path_factory.mktemp("olivine"), chains=2, draws=200)


def test_the_record_has_the_amplitude_and_lag_of_its_two_series(fit: Fit) -> None:
    experiment = of_kind(fit.experiment, OscillationExperiment)
    observed, record = observed_response(experiment), experiment.record
    period = experiment.prepared.period
    strain, stress = (
        fit_harmonics(
            time,
            value,
            period=period,
            degree=choose_degree(time, value, period=period, uncertainty=uncertainty),
            uncertainty=uncertainty,
        )
        for time, value, uncertainty in (
            (record.strain_time, record.strain, record.strain_uncertainty),
            (record.stress_time, record.stress, record.stress_uncertainty),
        )
    )
    (stress_phase, stress_error), (strain_phase, strain_error) = stress.phase(), strain.phase()
    assert observed.lag == pytest.approx(stress_phase - strain_phase, rel=1e-9)
    assert observed.lag_standard_error == pytest.approx(
        np.hypot(stress_error, strain_error), rel=1e-9
    )
    assert observed.amplitude == pytest.approx(stress.amplitude()[0], rel=1e-9)


def test_the_background_changes_neither_amplitude_nor_lag_of_the_record(
    fit: Fit, tmp_path: Path
) -> None:
    kept = make_olivine_fit(tmp_path, "kept", chains=1, draws=5)
    here, there = (
        observed_response(of_kind(one.experiment, OscillationExperiment)) for one in (fit, kept)
    )
    assert here == there


@pytest.mark.parametrize(("factor", "shift"), [(1.0, 0.0), (1.2, 0.3), (0.9, -1.0), (1.0, 2.0)])
def test_solutions_have_the_amplitude_and_lag_that_were_put_in(
    fit: Fit, factor: float, shift: float
) -> None:
    moved = oscillating(
        fit, amplitude_sd=0.0, phase_sd=0.0, amplitude_factor=factor, phase_shift=shift
    )
    observed, predicted = (
        observed_response(of_kind(fit.experiment, OscillationExperiment)),
        predicted_response(moved),
    )
    np.testing.assert_allclose(predicted.amplitude, factor * observed.amplitude, rtol=1e-5)
    np.testing.assert_allclose(predicted.lag, observed.lag + shift, atol=1e-5)


def test_noise_widens_what_replicated_data_show_by_the_standard_error(fit: Fit) -> None:
    experiment = of_kind(fit.experiment, OscillationExperiment)
    noise = float(np.sqrt(np.mean(experiment.prepared.uncertainty**2)))
    replicated = replicated_response(oscillating(fit, amplitude_sd=0.0, phase_sd=0.0, noise=noise))
    observed = observed_response(experiment)
    assert replicated.amplitude.std(ddof=1) == pytest.approx(
        observed.amplitude_standard_error, rel=0.25
    )
    assert replicated.lag.std(ddof=1) == pytest.approx(observed.lag_standard_error, rel=0.25)


def test_draws_without_solution_are_left_out(fit: Fit) -> None:
    broken = oscillating(fit, amplitude_sd=0.01, phase_sd=0.01)
    stress = broken.posterior["predictions"].to_dataset()["stress"].copy(deep=True)
    stress[0, :7, 3] = np.nan
    broken.posterior["predictions"] = broken.posterior["predictions"].assign(stress=stress)
    assert predicted_response(broken).lag.size == 2 * 200 - 7


@pytest.mark.parametrize(
    ("factor", "shift", "inside"),
    [(1.0, 0.0, (True, True)), (1.2, 0.0, (False, True)), (1.0, 0.3, (True, False))],
)
def test_the_table_says_whether_the_record_is_inside_the_replicated_bands(
    fit: Fit, factor: float, shift: float, inside: tuple[bool, bool]
) -> None:
    moved = oscillating(
        fit, amplitude_sd=0.02, phase_sd=0.02, amplitude_factor=factor, phase_shift=shift
    )
    table = response_table(moved)
    assert tuple(table["inside"]) == inside
    replicated = replicated_response(moved)
    for name, draws in (("amplitude", replicated.amplitude), ("lag", replicated.lag)):
        low, median, high = central_band(draws)
        assert [table[column][name] for column in ("q5", "median", "q95")] == [low, median, high]
        assert np.mean((draws >= low) & (draws <= high)) == pytest.approx(0.9, abs=0.01)

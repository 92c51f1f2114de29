"""The synthetic olivine record: its files, its solver against closed forms, its truth."""

from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from data_script import data_script
from truths import truth_of

from pyburgers.drawing.views.oscillation_response import observed_response
from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment, with_background
from pyburgers.kinds.forced_oscillation.files import load_forced_oscillation
from pyburgers.kinds.forced_oscillation.harmonics import fit_harmonics
from pyburgers.kinds.forward import simulate
from pyburgers.model.parameters import PARAMETERS, PIEZOMETER
from pyburgers.model.priors import default_priors

OLIVINE = Path(__file__).parents[2] / "data" / "olivine"


@pytest.fixture(scope="module")
def generator() -> ModuleType:
    return data_script(OLIVINE / "generate_record.py")


@pytest.fixture(scope="module")
def twin() -> OscillationExperiment:
    return load_forced_oscillation(OLIVINE / "olivine_twin.toml")


class TestSolver:
    def test_the_imposed_rate_is_the_derivative_of_the_imposed_strain(
        self, generator: ModuleType
    ) -> None:
        time = np.linspace(1.0, 2450.0, 40)
        truth, step = generator.TRUTH, 1e-2
        numerical = generator.strain_at(truth, time + step) - generator.strain_at(
            truth, time - step
        )
        rate = [generator.strain_rate_at(truth, t) for t in time]
        np.testing.assert_allclose(rate, numerical / (2 * step), rtol=1e-6, atol=1e-12)

    def test_the_linear_limit_is_the_complex_modulus(self, generator: ModuleType) -> None:
        truth, viscosity = generator.TRUTH, 2e12
        gas = generator.GAS_CONSTANT * truth.temperature
        linear = replace(
            truth,
            stress_exponent=1.0,
            grain_size_exponent=0.0,
            activation_enthalpy=np.log(viscosity) / (1 / gas - truth.beta),
            background_start=0.0,
            background_end=0.0,
        )
        time = np.linspace(0.0, 600.0, 50)
        omega = 2 * np.pi / truth.period
        compliance = (
            1 / truth.maxwell_modulus
            + 1 / (truth.kelvin_modulus + 1j * omega * truth.kelvin_viscosity)
            + 1 / (1j * omega * viscosity)
        )
        turning = np.exp(1j * (omega * time + truth.strain_phase))
        expected = np.imag(truth.strain_amplitude / compliance * turning)
        stress = generator.states_at(linear, time)[0]
        np.testing.assert_allclose(stress, expected, atol=1e-6 * np.max(expected))

    def test_strain_and_its_parts_add_up(self, generator: ModuleType) -> None:
        """Strain minus elastic and Kelvin strain grows at the rate of the dashpot."""
        truth = generator.TRUTH
        time = np.linspace(0.0, 300.0, 3001)
        stress, kelvin, grain_size = generator.states_at(truth, time)
        dashpot = generator.strain_at(truth, time) - stress / truth.maxwell_modulus - kelvin
        rate = (
            stress**truth.stress_exponent
            * grain_size**-truth.grain_size_exponent
            * np.exp(
                truth.activation_enthalpy
                * (truth.beta - 1 / (generator.GAS_CONSTANT * truth.temperature))
            )
        )
        grown = np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time))
        np.testing.assert_allclose(dashpot[1:] - dashpot[0], grown, rtol=1e-5, atol=1e-8)

    def test_the_grain_size_is_the_stated_one_where_the_record_starts(
        self, generator: ModuleType
    ) -> None:
        truth = generator.TRUTH
        grain_size = generator.states_at(truth, np.array([0.0, 1860.0]))[2]
        assert grain_size[0] == pytest.approx(truth.initial_grain_size, rel=1e-7)
        assert 1.1 < grain_size[1] / grain_size[0] < 1.4

    def test_no_start_up_transient_is_left(self, generator: ModuleType) -> None:
        time = np.linspace(0.0, 300.0, 61)
        one, other = (
            generator.states_at(replace(generator.TRUTH, bias=bias), time)[0]
            for bias in (108e6, 100e6)
        )
        np.testing.assert_allclose(one, other, atol=0.05e6)

    def test_bias_and_amplitude_are_those_of_a_laboratory_test(self, generator: ModuleType) -> None:
        stress = generator.states_at(generator.TRUTH, np.linspace(0.0, 2400.0, 2400))[0]
        assert np.mean(stress) == pytest.approx(110e6, rel=0.1)
        assert 0.5 * np.ptp(stress[:300]) == pytest.approx(50e6, rel=0.15)
        assert np.min(stress) > 50e6


class TestFiles:
    def test_they_say_that_they_are_synthetic_and_know_their_truth(
        self, generator: ModuleType, twin: OscillationExperiment
    ) -> None:
        assert twin.provenance.kind == "synthetic"
        assert twin.notices == ()
        assert twin.temperature == 1423
        assert twin.initial_grain_size == 10e-6
        names = [*(parameter.name for parameter in PARAMETERS), *PIEZOMETER]
        assert list(truth_of(twin)) == names
        for name, value in truth_of(twin).items():
            assert value == getattr(generator.TRUTH, name)

    def test_the_truth_lies_inside_the_priors(self, twin: OscillationExperiment) -> None:
        priors = default_priors("olivine").resolved(float(np.max(np.abs(twin.record.stress))))
        for parameter, value in truth_of(twin).items():
            prior = priors[parameter]
            if prior.family == "fixed":
                assert value == pytest.approx(prior.location, rel=1e-12)
            else:
                assert 0.05 < prior.distribution().cdf(value) < 0.95, parameter

    def test_noise_has_the_stated_size(
        self, generator: ModuleType, twin: OscillationExperiment
    ) -> None:
        truth, record = generator.TRUTH, twin.record
        strain = record.strain - generator.strain_at(truth, record.strain_time)
        stress = record.stress - generator.states_at(truth, record.stress_time)[0]
        for residual, uncertainty in (
            (strain, record.strain_uncertainty),
            (stress, record.stress_uncertainty),
        ):
            standardised = residual / uncertainty
            count = standardised.size
            assert abs(np.std(standardised) - 1) < 1 / np.sqrt(2 * count)
            assert abs(np.mean(standardised)) < 1 / np.sqrt(count)
        np.testing.assert_array_equal(record.strain_uncertainty, truth.strain_noise)
        assert np.sqrt(np.mean(record.stress_uncertainty**2)) == pytest.approx(4e6, rel=1e-3)
        assert np.ptp(record.stress_uncertainty) > 1e6

    def test_sampling_is_that_of_radiographs_and_diffraction_patterns(
        self, twin: OscillationExperiment
    ) -> None:
        record = twin.record
        assert np.median(np.diff(record.strain_time)) == pytest.approx(9, abs=0.5)
        assert np.median(np.diff(record.stress_time)) == pytest.approx(25, abs=1)
        assert np.std(np.diff(record.stress_time)) > 0.5
        assert record.strain_time[0] < record.stress_time[0]
        assert record.stress_time[-1] < record.strain_time[-1]
        assert 6 <= (record.strain_time[-1] - record.strain_time[0]) / 300 <= 6.5


class TestPreparation:
    def test_the_imposed_strain_is_found_again(
        self, generator: ModuleType, twin: OscillationExperiment
    ) -> None:
        truth, fit = generator.TRUTH, twin.prepared.strain_fit
        assert fit.degree == 2
        for found, error, true in (
            (*fit.amplitude(), truth.strain_amplitude),
            (*fit.phase(), truth.strain_phase),
        ):
            assert abs(found - true) < 2 * error
        time = np.linspace(0.0, 2450.0, 100)
        rate = [generator.strain_rate_at(truth, t) for t in time]
        whole = fit.periodic_rate(time) + fit.trend_rate(time)
        np.testing.assert_allclose(whole, rate, atol=0.02 * np.max(rate))

    def test_the_stress_drifts(self, twin: OscillationExperiment) -> None:
        assert twin.prepared.stress_fit.degree == 1
        trend = twin.prepared.stress_fit.trend(twin.prepared.time)
        assert 5e6 < trend[-1] - trend[0] < 15e6

    def test_the_lag_is_that_of_the_noise_free_record(
        self, generator: ModuleType, twin: OscillationExperiment
    ) -> None:
        time = np.linspace(0.0, 2400.0, 800)
        strain, stress = (
            fit_harmonics(time, clean, period=300.0, degree=2).phase()[0]
            for clean in (
                generator.strain_at(generator.TRUTH, time),
                generator.states_at(generator.TRUTH, time)[0],
            )
        )
        noisy = observed_response(twin)
        assert abs(noisy.lag - (stress - strain)) < 2 * noisy.lag_standard_error
        assert 0.3 < stress - strain < 0.8


@pytest.mark.parametrize("floor", [1e5, 1e6, 1e7])
def test_grain_size_hangs_on_the_stress_floor_where_the_background_is_removed(
    twin: OscillationExperiment, programs: None, floor: float
) -> None:
    """With it kept, grains hardly change, whatever the piezometer would want at zero stress."""
    assert twin.settings.background == "kept"
    assert twin.notices == ()
    values = {**dict(twin.true_parameters or {}), "piezometer_stress_floor": floor}
    kept, removed = (
        simulate(with_background(twin, background), values)["grain_size_m"].iloc[-1]
        for background in ("kept", "removed")
    )
    assert kept == pytest.approx(14.1e-6, rel=0.01)
    assert removed > 3 * kept
    assert removed == pytest.approx({1e5: 298e-6, 1e6: 126e-6, 1e7: 46e-6}[floor], rel=0.02)

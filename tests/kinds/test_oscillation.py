"""From a raw oscillation record to the model's input: what is kept, what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError
from pyburgers.drawing.views.forced_oscillation import preparation
from pyburgers.kinds.forced_oscillation.preparation import (
    Background,
    OscillationRecord,
    OscillationSettings,
    prepare,
    strain_shares,
)

PERIOD = 300.0
OMEGA = 2 * np.pi / PERIOD
AUTOMATIC = OscillationSettings()


def strain_at(time: FloatArray) -> FloatArray:
    """Drifting strain with a second harmonic."""
    return (
        0.01
        + 5e-6 * time
        - 2e-10 * time**2
        + 2e-3 * np.sin(OMEGA * time + 0.7)
        + 1e-4 * np.cos(2 * OMEGA * time)
    )


def strain_rate_at(time: FloatArray) -> FloatArray:
    return 5e-6 - 4e-10 * time + oscillating_rate_at(time)


def oscillating_rate_at(time: FloatArray) -> FloatArray:
    return OMEGA * (2e-3 * np.cos(OMEGA * time + 0.7) - 2e-4 * np.sin(2 * OMEGA * time))


def oscillating_stress_at(time: FloatArray) -> FloatArray:
    return 50e6 * np.sin(OMEGA * time + 1.2)


def make_record(
    *, strain_span: tuple[float, float] = (0, 2400), stress_span: tuple[float, float] = (6, 2380)
) -> OscillationRecord:
    """Noise-free record with readings between given times (s)."""
    strain_time, stress_time = np.arange(*strain_span, 9.0), np.arange(*stress_span, 25.0)
    return OscillationRecord(
        strain_time=strain_time,
        strain=strain_at(strain_time),
        strain_uncertainty=np.full(strain_time.size, 2e-5),
        stress_time=stress_time,
        stress=150e6 - 3e3 * stress_time + oscillating_stress_at(stress_time),
        stress_uncertainty=np.full(stress_time.size, 4e6),
    )


def shifted(record: OscillationRecord, seconds: float) -> OscillationRecord:
    """Return the same readings on a clock that started earlier."""
    return replace(
        record,
        strain_time=record.strain_time + seconds,
        stress_time=record.stress_time + seconds,
    )


class TestBackground:
    DEGREES = OscillationSettings(
        period=PERIOD, strain_trend_degree=2, stress_trend_degree=1, background="removed"
    )

    def test_removed_leaves_the_oscillating_parts_alone(self) -> None:
        record = make_record()
        prepared = prepare(record, self.DEGREES, "test")
        time = np.linspace(0, 2400, 99)
        np.testing.assert_allclose(
            prepared.strain_rate(time), oscillating_rate_at(time), rtol=1e-7, atol=1e-13
        )
        np.testing.assert_allclose(prepared.stress, oscillating_stress_at(prepared.time), atol=1.0)
        np.testing.assert_array_equal(prepared.background_rate, 0)

    def test_kept_drives_with_the_whole_rate_and_leaves_the_stress_as_it_is(self) -> None:
        record = make_record()
        prepared = prepare(record, replace(self.DEGREES, background="kept"), "test")
        time = np.linspace(0, 2400, 99)
        np.testing.assert_allclose(
            prepared.strain_rate(time), strain_rate_at(time), rtol=1e-7, atol=1e-13
        )
        np.testing.assert_array_equal(prepared.stress, record.stress)

    @pytest.mark.parametrize("background", ["removed", "kept"])
    def test_a_constant_strain_trend_has_no_rate(self, background: Background) -> None:
        record = make_record()
        flat = replace(record, strain=2e-3 * np.sin(OMEGA * record.strain_time) + 0.3)
        settings = OscillationSettings(period=PERIOD, strain_trend_degree=0, background=background)
        prepared = prepare(flat, settings, "test")
        np.testing.assert_allclose(prepared.background_rate, 0, atol=1e-20)


class TestChoices:
    def test_period_and_degrees_are_found(self) -> None:
        settings = prepare(make_record(), AUTOMATIC, "test").settings
        assert settings.period == pytest.approx(PERIOD, rel=1e-6)
        assert settings.strain_trend_degree == 2

    def test_resolved_settings_give_the_same_again(self) -> None:
        record = make_record()
        first = prepare(record, AUTOMATIC, "test")
        second = prepare(record, first.settings, "test")
        assert second.settings == first.settings
        np.testing.assert_array_equal(second.stress, first.stress)
        np.testing.assert_array_equal(second.strain_fit.sine, first.strain_fit.sine)

    def test_the_origin_of_the_clock_does_not_matter(self) -> None:
        settings = OscillationSettings(period=PERIOD, background="kept")
        here = prepare(make_record(), settings, "test")
        there = prepare(shifted(make_record(), 1000.0), settings, "test")
        time = np.linspace(0, 2400, 50)
        np.testing.assert_allclose(
            there.strain_rate(time + 1000), here.strain_rate(time), rtol=1e-8, atol=1e-14
        )
        np.testing.assert_allclose(there.stress, here.stress)
        assert there.start == here.start + 1000


def noisy(strain_sd: float, n_stress: int, seed: int) -> OscillationRecord:
    """A record with noise as large as stated, 4 MPa in the stress."""
    rng, record = np.random.default_rng(seed), make_record()
    time = np.linspace(6.0, 2380.0, n_stress)
    stress = 150e6 - 3e3 * time + oscillating_stress_at(time)
    return replace(
        record,
        strain=record.strain + strain_sd * rng.standard_normal(record.strain.size),
        strain_uncertainty=np.full(record.strain.size, strain_sd),
        stress_time=time,
        stress=stress + 4e6 * rng.standard_normal(n_stress),
        stress_uncertainty=np.full(n_stress, 4e6),
    )


class TestErrorsOfTheStrain:
    @pytest.mark.parametrize("background", ["removed", "kept"])
    def test_they_have_the_covariance_of_repeated_records(self, background: Background) -> None:
        """What drives the model in 400 records with other noise; no formula of the fit is used."""
        settings = replace(TestBackground.DEGREES, background=background)
        found = [prepare(noisy(1e-4, 30, seed), settings, "test") for seed in range(400)]
        driving = np.array(
            [[*one.strain_fit.sine, *one.strain_fit.cosine, *one.background_rate] for one in found]
        )
        error = found[0].strain_error
        assert len(error) == (6 if background == "removed" else 8)
        expected = np.sqrt(np.diag(error.T @ error))
        np.testing.assert_allclose(driving.std(axis=0), expected, rtol=0.15)
        np.testing.assert_allclose(
            np.corrcoef(driving[:, :6].T),
            (error.T @ error)[:6, :6] / np.outer(expected[:6], expected[:6]),
            atol=0.2,
        )

    def test_their_share_is_that_of_the_variances(self) -> None:
        """1e-4 with 30 stresses: about as uncertain as the stress itself."""
        prepared = prepare(noisy(1e-4, 30, 1), TestBackground.DEGREES, "test")
        oscillation, _ = strain_shares(prepared.strain_fit, prepared.stress_fit)
        strain = 1e-4 / 2e-3 / np.sqrt(prepared.strain_fit.n_points / 2)
        stress = 4e6 / 50e6 / np.sqrt(30 / 2)
        assert oscillation == pytest.approx((strain / stress) ** 2, rel=0.4)

    def test_those_that_count_for_next_to_nothing_are_left_out(self) -> None:
        kept = replace(TestBackground.DEGREES, background="kept")
        sizes = {
            (sd, settings.background): len(prepare(noisy(sd, 30, 1), settings, "t").strain_error)
            for sd in (1e-4, 1e-5, 1e-7)
            for settings in (TestBackground.DEGREES, kept)
        }
        assert sizes[1e-4, "removed"] == 6
        assert sizes[1e-4, "kept"] == 8
        assert sizes[1e-5, "removed"] == 0
        assert sizes[1e-7, "kept"] == 0


class TestClocks:
    def test_the_record_starts_with_the_first_reading(self) -> None:
        assert prepare(make_record(), AUTOMATIC, "test").start == 0.0
        early = prepare(make_record(stress_span=(-3, 2380)), AUTOMATIC, "test")
        assert early.start == -3.0
        assert early.notices == ()

    def test_stress_outside_the_strain_record_is_left_out(self) -> None:
        record = make_record(strain_span=(0, 2000))
        prepared = prepare(record, AUTOMATIC, "test")
        # The last strain reading is at 1998 s; half a reading more is allowed.
        np.testing.assert_array_equal(
            prepared.time, record.stress_time[record.stress_time <= 1998 + 4.5]
        )
        assert prepared.stress.shape == prepared.uncertainty.shape == prepared.time.shape
        assert prepared.notices == ("15 points of the stress outside the strain record left out.",)

    def test_the_stress_is_detrended_over_the_points_that_are_used(self) -> None:
        record = make_record(strain_span=(0, 2000))
        late = record.stress_time > 2010
        wild = replace(record, stress=np.where(late, 1e12, record.stress))
        settings = OscillationSettings(period=PERIOD, stress_trend_degree=1)
        np.testing.assert_array_equal(
            prepare(wild, settings, "test").stress, prepare(record, settings, "test").stress
        )

    @pytest.mark.parametrize("step", [1.0, 10.0])
    def test_readings_of_a_coarse_clock_are_all_kept(self, step: float) -> None:
        """Both clocks are late alike: the lag, and the ratio of the amplitudes, stay."""
        time = np.arange(0.0, 2400.0, step / 4)
        true = OscillationRecord(
            strain_time=time,
            strain=strain_at(time),
            strain_uncertainty=np.full_like(time, 2e-5),
            stress_time=time,
            stress=150e6 + oscillating_stress_at(time),
            stress_uncertainty=np.full_like(time, 4e6),
        )
        clock = step * np.floor(time / step)
        coarse = replace(true, strain_time=clock, stress_time=clock)
        settings = OscillationSettings(max_readings=time.size)
        expected, found = (prepare(record, settings, "test") for record in (true, coarse))
        assert expected.notices == ()
        shared = "the same time as the point before: each counts as a reading."
        steps = f"The clock steps by {step:g} s, {1.2 * step:g} degrees of a cycle."
        assert found.notices[:2] == tuple(
            f"{3 * time.size // 4} points of the {name} at {shared} {steps}"
            for name in ("strain", "stress")
        )
        # 10 s round the strain by more than its stated error.
        assert ["scatters" in one for one in found.notices[2:]] == [True] * (step > 1)
        np.testing.assert_array_equal(found.time, clock)
        assert found.period == pytest.approx(PERIOD, rel=1e-3)
        lags = [one.stress_fit.phase()[0] - one.strain_fit.phase()[0] for one in (expected, found)]
        assert lags[1] == pytest.approx(lags[0], abs=1e-3)
        stiffness = [
            one.stress_fit.amplitude()[0] / one.strain_fit.amplitude()[0]
            for one in (expected, found)
        ]
        assert stiffness[1] == pytest.approx(stiffness[0], rel=1e-3)

    def test_readings_of_one_time_are_no_record(self) -> None:
        record = make_record()
        still = replace(record, stress_time=np.full_like(record.stress_time, 600.0))
        assert "the stress has readings at 1 time, expected at least two cycles" in refusal(still)


def refusal(record: OscillationRecord, settings: OscillationSettings = AUTOMATIC) -> str:
    """Message of the InputError that preparing raises: one sentence."""
    with pytest.raises(InputError) as caught:
        prepare(record, settings, "some test")
    text = str(caught.value)
    assert text.startswith("some test: ")
    assert text.endswith(".")
    assert ". " not in text
    assert "\n" not in text
    return text


class TestBadInput:
    @pytest.mark.parametrize("value", [0.0, -1.0, np.nan])
    @pytest.mark.parametrize("name", ["strain", "stress"])
    def test_an_uncertainty_that_is_none(self, name: str, value: float) -> None:
        record = make_record()
        uncertainty = getattr(record, f"{name}_uncertainty").copy()
        uncertainty[2] = value
        text = refusal(replace(record, **{f"{name}_uncertainty": uncertainty}))
        assert f"the {name}'s uncertainty, reading 3: found {value:g}, expected a positive" in text

    def test_missing_uncertainties(self) -> None:
        text = refusal(replace(make_record(), stress_uncertainty=np.empty(0)))
        assert "the stress has 95 times, 95 readings and 0 uncertainties" in text


class TestFigure:
    @pytest.mark.parametrize("background", ["removed", "kept"])
    def test_every_panel_has_units_and_a_legend(self, background: Background) -> None:
        record = make_record()
        prepared = prepare(record, OscillationSettings(background=background), "test")
        panels = preparation(prepared, record, "a test").axes
        assert len(panels) == 5
        units = ["(%)", "(%)", "s$^{-1}$)", "(MPa)", "(MPa)"]
        assert [unit in panel.get_ylabel() for panel, unit in zip(panels, units, strict=True)] == [
            True
        ] * 5
        assert panels[-1].get_xlabel().endswith("(s)")
        assert all(panel.get_legend() is not None for panel in panels)
        assert background in panels[2].get_title(loc="left")


@pytest.mark.parametrize(
    ("degrees", "told"),
    [
        (0, []),
        (20, []),
        (50, ["degrees behind the strain"]),
        (-90, ["degrees ahead of the strain"]),
    ],
)
def test_a_stress_that_is_behind_the_strain_is_told(degrees: float, told: list[str]) -> None:
    record = make_record()
    late = replace(record, stress_time=record.stress_time + PERIOD * degrees / 360)
    found = [one for one in prepare(late, AUTOMATIC, "test").notices if "degrees" in one]
    assert len(found) == len(told)
    assert all(words in one for words, one in zip(told, found, strict=True))


@pytest.mark.parametrize(
    ("sign", "period", "words"),
    [
        (1, None, []),
        (1, PERIOD, []),
        (-1, PERIOD, ["apart, as if one of them had the opposite sign"]),
        (1, 330.0, ["taken as 330 s, but the strain oscillates most with one of about 3"]),
    ],
)
def test_another_period_and_an_opposite_sign_are_told(
    sign: int, period: float | None, words: list[str]
) -> None:
    record = make_record()
    turned = replace(record, stress=sign * record.stress)
    notices = prepare(turned, OscillationSettings(period=period), "test").notices
    assert len(notices) == len(words)
    assert all(told in notice for told, notice in zip(words, notices, strict=True))


@pytest.mark.parametrize(("stated", "times"), [(1.0, None), (0.5, None), (0.01, "91")])
def test_an_error_of_the_strain_that_is_too_small_is_told(stated: float, times: str | None) -> None:
    record = make_record()
    noise = np.random.default_rng(1).standard_normal(record.strain.size)
    scattered = record.strain + record.strain_uncertainty * noise
    small = replace(record, strain=scattered, strain_uncertainty=stated * record.strain_uncertainty)
    found = [one for one in prepare(small, AUTOMATIC, "test").notices if "scatters" in one]
    if times is None:
        assert found == []
    else:
        assert found == [
            f"The strain scatters about its fit by {times} times its stated uncertainty: "
            "check that and its unit, the period and the trend."
        ]

"""Loading histories: signs, first lengths, compliance of the apparatus, thermal expansion."""

import numpy as np
import pytest
from history_files import history, stage

TIME = np.geomspace(1.0, 3000.0, 40)
MODULUS = 9.0 * np.exp(-TIME / 1000.0)

LOADING = stage(0.5, "strain_rate", strain_rate_per_s=2e-3)
HELD = {"control": "hold_strain", "start_time": 0.5, "end_time": 3000.0}


class TestARelaxationModulus:
    @pytest.mark.parametrize("compression", ["positive", "negative"])
    @pytest.mark.parametrize("is_compressed", [True, False])
    @pytest.mark.parametrize("control", ["strain_rate", "strain_series"])
    def test_gives_stresses_of_the_sign_of_the_strain(
        self, compression: str, is_compressed: bool, control: str
    ) -> None:
        sign = 1 if is_compressed else -1
        in_file = sign if compression == "positive" else -sign
        loading = {**LOADING, "strain_rate_per_s": in_file * 2e-3}
        if control == "strain_series":
            knots = [[0.0, 0.0], [0.5, in_file * 1e-3]]
            loading = stage(0.5, control, knots=knots)
        test = history(
            [loading, HELD],
            {"time": TIME, "stress": MODULUS},
            {"stress_unit": "GPa", "relaxation_strain": 1e-3},
            compression=compression,
        )
        np.testing.assert_allclose(test.reading, sign * 1e6 * MODULUS)
        assert not any("strain" in notice for notice in test.notices)

    def test_over_another_strain_than_the_imposed_one_is_doubted(self) -> None:
        test = history(
            [LOADING, HELD],
            {"time": TIME, "stress": MODULUS},
            {"stress_unit": "GPa", "relaxation_strain": 3e-3},
        )
        (notice,) = test.notices
        assert "'relaxation_strain' is 0.003" in notice
        assert "a strain of 0.001" in notice

    def test_after_a_load_tells_no_imposed_strain(self) -> None:
        loaded = {"control": "stress", "start_time": 0.5, "end_time": 0.6, "stress": 1e6}
        columns = {"time": TIME, "stress": MODULUS}
        data = {"stress_unit": "GPa", "relaxation_strain": 3e-3}
        test = history([LOADING, loaded, {**HELD, "start_time": 0.6}], columns, data)
        assert test.notices == ()
        np.testing.assert_allclose(test.reading, 3e6 * MODULUS)


OPPOSED = {
    -1: "Most stresses are negative, but compression",
    1: "Most stresses are positive, but ext",
}


class TestStressesThatOpposeTheLoading:
    def test_are_told(self) -> None:
        for sign in (1, -1):
            loading = {**LOADING, "end_time": 3000.0, "strain_rate_per_s": sign * 1e-6}
            stress = sign * (1.0 - np.exp(-TIME / 300.0))
            back = {**loading, "start_time": 3000.0, "end_time": 6000.0}
            back["strain_rate_per_s"] = -sign * 1e-6
            times, stresses = np.append(TIME, TIME + 3000.0), np.append(stress, -3 * stress)
            for stages in ([loading], [loading, back]):
                rows = slice(40 * len(stages))
                columns = {"time": times[rows], "stress": stresses[rows]}
                assert history(stages, columns, {"stress_unit": "MPa"}).notices == ()
                columns["stress"] = -columns["stress"]
                (notice,) = history(stages, columns, {"stress_unit": "MPa"}).notices
                assert notice.startswith(OPPOSED[-sign])

    def test_are_not_found_in_cycles(self) -> None:
        time = np.linspace(1.0, 3000.0, 300)
        angle = 2 * np.pi * time / 700.0
        series = stage(3000.0, "strain_series")
        for lag in (0.0, 0.7, 1.5):
            columns = {"time": time, "strain": 1e-4 * np.sin(angle), "stress": np.sin(angle + lag)}
            test = history([series], columns, {"stress_unit": "MPa", "strain_unit": "fraction"})
            assert not any("Most" in notice for notice in test.notices)


CREEP = stage(3000.0, "stress", stress=2.0)


def test_engineering_measures_say_to_which_length_the_sample_goes() -> None:
    columns = {"time": TIME, "strain": 0.25 * TIME / TIME[-1]}
    data = {"strain_unit": "fraction"}
    keys = {"stage_stress_unit": "MPa", "strain_measure": "engineering"}
    test = history([CREEP], columns, data, **keys)
    assert "positive numbers are shortening, and the length goes to 75 %" in test.notices[0]
    pulled = history([{**CREEP, "stress": 2.0}], columns, data, **keys, compression="negative")
    assert "negative numbers are shortening, and the length goes to 125 %" in pulled.notices[1]


def test_a_step_of_the_temperature_asks_for_thermal_expansion() -> None:
    warmer = {**CREEP, "start_time": 3000.0, "end_time": 6000.0, "temperature_K": 266.5}
    columns = {"time": TIME, "strain": 0.02 * TIME / TIME[-1]}
    same, stepped = (
        history([CREEP, after], columns, {"strain_unit": "fraction"}, stage_stress_unit="MPa")
        for after in ({**warmer, "temperature_K": 263.0}, warmer)
    )
    assert same.notices == ()
    (notice,) = stepped.notices
    assert "differ by up to 3.5 K: thermal expansion is not in the model" in notice


@pytest.mark.parametrize(("error", "is_doubted"), [(1e-2, False), (1e-3, True)])
def test_a_compliance_at_large_strain_is_doubted_beyond_the_error_of_strains(
    error: float, is_doubted: bool
) -> None:
    strain = 0.3 * TIME / TIME[-1]
    test = history(
        [CREEP],
        {"time": TIME, "strain": strain},
        {"strain_unit": "fraction", "strain_uncertainty": error},
        stage_stress_unit="MPa",
        apparatus={"compliance_per_Pa": 1e-9},
    )
    assert (
        any("as length and area are not the first ones" in one for one in test.doubts) == is_doubted
    )


def test_the_compliance_that_is_missed_follows_from_first_length_and_area() -> None:
    # Displacement of the apparatus over the first length: compliance times force over first area.
    strain, stress, compliance = 0.3, 2e6, 1e-9
    of_apparatus = compliance * stress * np.exp(strain)
    true = -np.log1p(-(1 - np.exp(-strain) + of_apparatus)) - strain
    assert true == pytest.approx(compliance * stress * np.exp(2 * strain), rel=2e-3)


def test_stated_errors_of_engineering_readings_become_those_of_true_ones() -> None:
    step, shortening, force = 1e-5, 0.2, 2.0  # of the readings, but for one beside and one on it
    columns = {
        "time": TIME,
        "strain": np.full(TIME.size, shortening),
        "stress": np.full(TIME.size, force),
    }
    columns["strain"][-1] += step
    columns["stress"][-2] += step
    data = {"strain_unit": "fraction", "stress_unit": "MPa", "strain_uncertainty": step}
    keys = {"strain_measure": "engineering", "stage_stress_unit": "MPa"}
    strain = history([CREEP], columns, data, **keys)
    assert strain.strain_uncertainty == pytest.approx(
        strain.reading[-1] - strain.reading[0], rel=1e-4
    )
    data["stress_uncertainty"] = step
    loading = {**LOADING, "strain_rate_per_s": 2 * shortening}
    stress = history([loading, HELD], columns, data, **keys, stress_measure="engineering")
    assert stress.stress_uncertainty == pytest.approx(
        stress.reading[-2] - stress.reading[0], rel=1e-4
    )

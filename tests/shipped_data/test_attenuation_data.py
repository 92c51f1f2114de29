"""The synthetic table and curve of ice with their generator; the measured tables of olivine."""

from pathlib import Path

import numpy as np
from conftest import ICE
from data_script import data_script

from pyburgers.kinds.attenuation.files import load_attenuation
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.model.arrhenius import GAS_CONSTANT
from pyburgers.model.laws_in_priors import kelvin_law
from pyburgers.model.priors import default_priors, load_priors, shipped_prior_file
from pyburgers.model.variants import with_variant

OLIVINE = ICE.parent / "olivine"


def test_the_synthetic_table_and_curve_are_what_their_generator_writes() -> None:
    module = data_script(ICE / "generate_attenuation_twin.py")
    written: str = module.table_text()
    assert written == (ICE / "attenuation_twin.csv").read_text(encoding="utf-8")
    assert "SYNTHETIC" in written
    twin = load_attenuation(ICE / "attenuation_twin.toml")
    assert twin.true_parameters == module.TRUTH
    assert twin.initial_grain_size == module.GRAIN_SIZE
    assert twin.provenance.kind == "synthetic"
    curve = load_constant_rate(ICE / "curve_beside_attenuation_twin.toml")
    assert module.curve_text() == (ICE / "curve_beside_attenuation_twin.csv").read_text(
        encoding="utf-8"
    )
    assert curve.true_parameters == module.CURVE_TRUTH
    assert curve.initial_grain_size == module.CURVE_GRAIN_SIZE
    assert curve.provenance.kind == "synthetic"


def test_the_measured_tables_are_those_of_the_source() -> None:
    for name, n_spectra, hottest, grain_size in (
        ("A1802", 7, 1473.15, 3.7e-6),
        ("A1906", 9, 1573.15, 6.5e-6),
    ):
        table = load_attenuation(OLIVINE / f"attenuation_{name}.toml")
        assert table.provenance.kind == "measured"
        assert table.provenance.doi == "10.1016/j.pepi.2024.107160"
        assert table.initial_grain_size == grain_size
        assert table.conditions.n_spectra == n_spectra
        assert table.conditions.n_rows == 10 * n_spectra
        np.testing.assert_allclose(table.conditions.temperature[[0, -1]], [hottest, 1173.15])
        np.testing.assert_allclose(
            np.log10(table.conditions.period[[0, 9]]), [0.10721, 2.9999], atol=2e-5
        )
    # Values at -4 are floors.
    table = load_attenuation(OLIVINE / "attenuation_A1802.toml")
    assert (
        Path(OLIVINE / "attenuation_qu_2024.csv").read_text(encoding="utf-8").count("A1802,900,")
        == 10
    )
    assert np.all(table.readings.is_limit[table.readings.tan_delta <= 1e-4])


def test_a_viscosity_that_is_seen_leaves_the_enthalpy_of_the_dashpot_its_prior() -> None:
    priors = default_priors("olivine", "attenuation")
    enthalpy, beta = priors["activation_enthalpy"], priors["beta"]
    # Of beta by Q_M at one viscosity.
    slope = (1 / (GAS_CONSTANT * 1473.15) - beta.location) / enthalpy.location
    assert 1 / np.hypot(1 / enthalpy.scale, slope / beta.scale) > 0.95 * enthalpy.scale


# Jackson and Faul (2010): several specimens together, and 6585; times (s) at 900 degrees Celsius.
FITS_OF_THE_LITERATURE = (
    {
        "grain_size": 13.4e-6,
        "enthalpy": 360e3,
        "exponent": 1.31,
        "band": 1.13,
        "longest": 1e7,
        "shortest": 1e-3,
        "peak": 0.057,
        "at_peak": 10**-3.4,
        "maxwell": 10**7.48,
    },
    {
        "grain_size": 3.1e-6,
        "enthalpy": 327e3,
        "exponent": 1.19,
        "band": 1.4,
        "longest": 1e6,
        "shortest": 1e-2,
        "peak": 0.07,
        "at_peak": 10**-2.9,
        "maxwell": 10**5.4,
    },
)


def test_the_priors_of_a_peak_are_those_of_the_literature() -> None:
    priors = load_priors(shipped_prior_file("olivine", "dissipation_peak")).priors
    temperature = priors["kelvin_reference_temperature"].location
    grain_size = priors["kelvin_reference_grain_size"].location
    young, shear = 195e9, 66.5e9  # at room temperature; at 900 degrees
    rows = []
    for own in FITS_OF_THE_LITERATURE:
        faster = np.exp(own["enthalpy"] / GAS_CONSTANT * (1 / temperature - 1 / 1173.15))
        finer = grain_size / own["grain_size"]
        # The shear modulus falls by 13.6 MPa/K.
        viscosity = own["maxwell"] * faster * finer**3 * 3 * (shear - 300 * 13.6e6)
        rows.append(
            (
                np.log(3 * shear / own["band"]),
                np.log(own["longest"] * faster * finer ** own["exponent"]),
                np.log10(own["longest"] / own["shortest"]),
                np.log10(own["longest"] / own["at_peak"]),
                np.log(own["peak"] * young / (3 * shear)),
                np.log(viscosity),
                own["exponent"],
            )
        )
    modulus, time, decades, peak_decades, strength, viscosity, exponent = np.mean(rows, axis=0)
    found = {
        "kelvin_modulus": np.exp(modulus),
        "kelvin_viscosity": np.exp(modulus + time),
        "relaxation_time_decades": decades,
        "peak_time_decades": peak_decades,
        "peak_strength": np.exp(strength),
        "kelvin_grain_size_exponent": exponent,
    }
    for name, expected in found.items():
        np.testing.assert_allclose(priors[name].location, expected, rtol=0.04, err_msg=name)
    spread = np.std(rows, axis=0, ddof=1)
    np.testing.assert_allclose(priors["relaxation_time_decades"].scale, spread[2], rtol=0.04)
    np.testing.assert_allclose(priors["peak_time_decades"].scale, spread[3], rtol=0.04)

    enthalpy = priors["activation_enthalpy"].location
    arrhenius = priors["beta"].location - 1 / (GAS_CONSTANT * temperature)
    flowing = priors["grain_size_exponent"].location * np.log(grain_size) - enthalpy * arrhenius
    np.testing.assert_allclose(flowing, viscosity, atol=0.04)
    np.testing.assert_allclose(enthalpy * priors["beta"].scale, 1.0, rtol=0.01)


def test_the_priors_of_a_peak_are_no_default_and_those_of_a_band_too() -> None:
    table = load_attenuation(OLIVINE / "attenuation_A1802.toml")
    usual = default_priors("olivine", "attenuation")
    peak = load_priors(shipped_prior_file("olivine", "dissipation_peak"))
    assert kelvin_law(usual.priors, "") == "linear"
    assert kelvin_law(peak.priors, "") == "extended_peak"
    band = with_variant(peak, table, {"kelvin": "extended"})
    assert kelvin_law(band.priors, "") == "extended"
    assert set(peak.free) - set(band.free) == {"peak_strength", "peak_time_decades"}
    same = ("maxwell_modulus", "kelvin_activation_enthalpy", "attenuation_scatter")
    for name in same:
        assert peak[name] == usual[name] == band[name]

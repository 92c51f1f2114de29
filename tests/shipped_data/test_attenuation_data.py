"""The synthetic table and curve of ice with their generator; the measured tables of olivine."""

import importlib.util
from pathlib import Path

import numpy as np
from conftest import ICE

from pyburgers.protocols.attenuation.files import load_attenuation
from pyburgers.protocols.constant_rate.experiment import load_constant_rate

OLIVINE = ICE.parent / "olivine"


def test_the_synthetic_table_and_curve_are_what_their_generator_writes() -> None:
    spec = importlib.util.spec_from_file_location(
        "generate_attenuation_twin", ICE / "generate_attenuation_twin.py"
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
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
    for name, n_spectra, hottest in (("A1802", 7, 1473.15), ("A1906", 9, 1573.15)):
        table = load_attenuation(OLIVINE / f"attenuation_{name}.toml")
        assert table.provenance.kind == "measured"
        assert table.provenance.doi == "10.1016/j.pepi.2024.107160"
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

"""A table of attenuation of ice without readings, at three periods."""

from pathlib import Path

from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.attenuation.files import load_attenuation

PERIODS = (30.0, 300.0, 3000.0)
"""Seconds."""

SPECTRUM = f"""
id = "spectrum"
material = "ice"
protocol = "attenuation"
temperature_K = 260.0
initial_grain_size_m = 230e-6
attenuation.deformation = "axial"
spectra = [{{ periods_s = {list(PERIODS)} }}]
provenance = {{ kind = "synthetic", source = "imagined" }}
"""


def ice_spectrum(folder: Path) -> AttenuationExperiment:
    """Return the table, from a file in a folder."""
    (folder / "spectrum.toml").write_text(SPECTRUM, encoding="utf-8")
    return load_attenuation(folder / "spectrum.toml")

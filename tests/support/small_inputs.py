"""Texts of input files: a test of four points, and priors of ice."""

from pathlib import Path

DATA = Path(__file__).parents[2] / "data"

EXPERIMENT = """\
id = "sample-1"
material = "ice"
protocol = "constant_rate"
temperature_K = 263.0
initial_grain_size_m = 230e-6

[[segments]]
start_strain = 0.0
strain_rate_per_s = 1e-4

[data]
file = "curve.csv"
strain_column = "strain"
strain_unit = "fraction"
stress_column = "stress"
stress_unit = "MPa"

[provenance]
kind = "measured"
source = "Somebody (2020)"
"""
CURVE = "strain,stress\n0.01,2.0\n0.02,3.0\n0.03,4.0\n0.04,5.0\n"
PRIORS = (DATA / "priors" / "ice.toml").read_text(encoding="utf-8")

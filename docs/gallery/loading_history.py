"""A loading history of ice: creep, a drop of the stress, unloading, relaxation."""

from pathlib import Path

import matplotlib.pyplot as plt

import pyburgers

Path("history.toml").write_text(
    """
id = "history"
material = "ice"
protocol = "loading_history"
temperature_K = 263.0
initial_grain_size_m = 1e-3
stage_time_unit = "h"
stage_stress_unit = "MPa"
stages = [
  { control = "stress", start_time = 0.0, end_time = 20.0, stress = 1.0 },
  { control = "stress", start_time = 20.0, end_time = 30.0, stress = 0.6 },
  { control = "stress", start_time = 30.0, end_time = 40.0, stress = 0.0 },
  { control = "strain_rate", start_time = 40.0, end_time = 42.0, strain_rate_per_s = 2e-7 },
  { control = "hold_strain", start_time = 42.0, end_time = 60.0 },
]
provenance = { kind = "synthetic", source = "a plan" }
"""
)
test = pyburgers.load_experiment("history.toml")
solution = pyburgers.simulate(
    test,
    {
        "maxwell_modulus": 9.0e9,
        "kelvin_modulus": 2.0e9,
        "kelvin_viscosity": 2.0e13,
        "stress_exponent": 4.0,
        "grain_size_exponent": 0.45,
        "activation_enthalpy": 64e3,
        "beta": -7.29e-4,
        "steady_state_grain_size": 1.0e-3,
        "steady_state_fabric_factor": 0.8,
        "critical_strain_grain_size": 0.05,
        "critical_strain_fabric": 0.05,
    },
)
hours = solution["time_s"] / 3600
figure, (above, below) = plt.subplots(2, sharex=True, figsize=(6, 5), layout="constrained")
above.plot(hours, solution["strain"] * 100)
above.plot(hours, solution["kelvin_strain"] * 100, label="of the Kelvin element")
above.set_ylabel("strain (%)")
above.legend()
below.plot(hours, solution["stress_Pa"] / 1e6, color="C3")
below.set(xlabel="time (h)", ylabel="stress (MPa)")
figure.savefig("loading_history.png", dpi=120)

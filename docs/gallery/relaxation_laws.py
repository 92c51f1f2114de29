"""Attenuation of Kelvin parts with one relaxation time, with two, with a band, and of Andrade."""

import matplotlib.pyplot as plt
import numpy as np

import pyburgers

common = {
    "maxwell_modulus": 60e9,
    "kelvin_modulus": 30e9,
    "kelvin_viscosity": 3e12,  # the longest time is 100 s
    "stress_exponent": 1.0,
    "grain_size_exponent": 2.0,
    "activation_enthalpy": 375e3,
    "beta": -1.0e-4,
}
laws = {
    "linear": {},
    "two_elements": {"peak_strength": 0.5, "peak_time_decades": 2.0},
    "extended": {"relaxation_time_decades": 6.0, "relaxation_exponent": 0.3},
    "andrade": {"andrade_exponent": 0.33},
}
period = np.geomspace(0.1, 1e4, 120)
figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
for name, own in laws.items():
    spectrum = pyburgers.attenuation_spectrum(
        common | own,
        1 / period,
        [pyburgers.Regime(0.0, 1e5)],
        temperature=1373.0,
        grain_size=1e-5,
    )
    axes.loglog(period, spectrum["tan_delta"].isel(regime=0), label=f"kelvin={name}")
axes.set(xlabel="period (s)", ylabel="tan δ")
axes.legend()
figure.savefig("relaxation_laws.png", dpi=120)

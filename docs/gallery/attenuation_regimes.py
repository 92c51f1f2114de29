"""Attenuation of ice in the paper's four stress regimes, in closed form."""

import matplotlib.pyplot as plt
import numpy as np

import pyburgers

test = pyburgers.load_experiment(pyburgers.shipped_folder("data") / "ice" / "PIL40.toml")
truth = dict(test.true_parameters or {}) | {"maxwell_modulus": 9.3e9}  # that of ice itself
regimes = [
    pyburgers.Regime(median_stress=median * 1e6, amplitude=amplitude * 1e6)
    for median, amplitude in ((1.0, 0.17), (1.5, 0.5), (2.0, 0.9), (4.0, 1.5))
]
spectrum = pyburgers.attenuation_spectrum(
    truth,
    np.geomspace(1e-4, 1.0, 100),
    regimes,
    temperature=test.temperature,
    grain_size=test.initial_grain_size,
)
figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
for label in spectrum["regime"].to_numpy():
    axes.loglog(spectrum["frequency"], spectrum["tan_delta"].sel(regime=label), label=label)
axes.set(xlabel="frequency (Hz)", ylabel="tan δ")
axes.legend(title="median stress ± amplitude")
figure.savefig("attenuation_regimes.png", dpi=120)

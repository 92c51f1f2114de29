"""What the stress exponent does to a stress-strain curve, the reference stress being held."""

import matplotlib.pyplot as plt
import numpy as np

import pyburgers

test = pyburgers.load_experiment(pyburgers.shipped_folder("data") / "ice" / "PIL40.toml")
truth = dict(test.true_parameters or {})
strain = np.linspace(0.001, 0.2, 120)
held = pyburgers.simulate(test, truth, at=strain).attrs["reference_stress"]

figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
for exponent in (1.5, 2.5, 4.0, 6.0):
    # The reference stress stays if beta takes up what n changes.
    change = (truth["stress_exponent"] - exponent) * np.log(held) / truth["activation_enthalpy"]
    changed = truth | {"stress_exponent": exponent, "beta": truth["beta"] + change}
    solution = pyburgers.simulate(test, changed, at=strain)
    axes.plot(solution["strain"] * 100, solution["stress_Pa"] / 1e6, label=f"n = {exponent:g}")
axes.axhline(held / 1e6, color="0.6", linestyle="--", label="reference stress")
axes.set(xlabel="strain (%)", ylabel="stress (MPa)")
axes.legend()
figure.savefig("stress_exponent.png", dpi=120)
print(f"reference stress {held / 1e6:.2f} MPa at {test.temperature:g} K")

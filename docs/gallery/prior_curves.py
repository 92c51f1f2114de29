"""Stress-strain curves of draws of the shipped priors of ice."""

import matplotlib.pyplot as plt
import numpy as np

import pyburgers

test = pyburgers.load_experiment(pyburgers.shipped_folder("data") / "ice" / "PIL40.toml")
priors = pyburgers.priors("ice").resolved(float(test.largest_stress))
rng = np.random.default_rng(8)
strain = np.linspace(0.001, 0.2, 80)

figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
unsolved = 0
for _ in range(40):
    try:
        solution = pyburgers.simulate(test, priors.sample(rng), at=strain)
    except pyburgers.SamplingError:
        unsolved += 1
        continue
    axes.plot(solution["strain"] * 100, solution["stress_Pa"] / 1e6, color="C0", alpha=0.4)
axes.set(xlabel="strain (%)", ylabel="stress (MPa)", yscale="log")
figure.savefig("prior_curves.png", dpi=120)
print(f"{unsolved} of 40 draws have no solution")

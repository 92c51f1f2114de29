"""From a table of pandas to a page, a block for ASPECT and draws for ArviZ; about a minute."""

from pathlib import Path

import pandas as pd

import pyburgers

table = pd.read_csv(Path(__file__).parents[1] / "data" / "ice" / "PIL40.csv")
test = pyburgers.ConstantRateTest(
    strain=table["strain"],
    strain_unit="fraction",
    stress=table["stress_MPa"],
    stress_unit="MPa",
    strain_rate=1.69e-4,
    temperature_K=260,
    grain_size_um=230,
    material="ice",
    name="PIL40",
    kind="synthetic",
    source="a simulation with the published numbers of PIL40",
)
fit = pyburgers.fit(test)
print(fit.summary()[["unit", "mean", "sd", "decided_by"]].to_string())
print(fit.report("page.html"))
pyburgers.export(fit, "aspect", microstructure="initial", out="aspect.prm")
fit.to_arviz().to_netcdf("draws.nc")

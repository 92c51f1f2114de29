"""From a laboratory's table to Europa: measured rates of ice, and the tides of an ice shell.

    python reports/europa.py --out europa

fits a composite flow law to the tables of measured rates, carries every draw of it to the shell,
and solves the shell's tide with TidalPy. ``europa/index.html`` shows the fit and what follows.
"""

import argparse
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr
from common import BLUE, DATA, GREY, VERMILION, BoolArray, FloatArray, draw_band
from matplotlib.figure import Figure
from scipy.constants import gas_constant

import pyburgers
from pyburgers import PageFigure, PageSection, PageTable, RateFit, Regime, SamplerOptions, style

ComplexArray = npt.NDArray[np.complex128]

TABLES = DATA / "ice" / "rates"

DRAWS = 200
"""Draws of the law that are carried to the shell."""

PERIOD = 3.551181 * 86400.0
"""Orbital period of Europa, s: that of its diurnal tide."""

GRAIN_SIZE = 1e-3
"""Grains of the shell, m: a choice, since nobody has seen any."""

TIDAL_STRESS = (1e4, 3e4, 1e5)
"""Amplitudes of the axial equivalent stress of the tide, Pa. The middle one is a strain of 1e-5."""

SHEAR_MODULUS, POISSON_RATIO = 3.52e9, 0.325
"""Of isotropic ice at 257 K: Gammon, Kiefte, Clouter and Denner (1983), J. Glaciol. 29, 433."""

RADIUS, MASS = 1560.8e3, 4.7998e22
"""Of Europa, m and kg."""

SHELL, OCEAN = 20e3, 100e3
"""Thicknesses of the ice shell and of the ocean below it, m: choices."""

ICE_DENSITY, WATER_DENSITY = 920.0, 1000.0
"""kg/m3."""

ROCK_SHEAR_MODULUS, ROCK_BULK_MODULUS = 50e9, 100e9
ICE_BULK_MODULUS, WATER_BULK_MODULUS = 9e9, 2.2e9
"""Pa; the tide of a shell above an ocean hardly depends on them."""

SURFACE_TEMPERATURE, BASE_TEMPERATURE = 100.0, 270.0
"""K; between them temperature is that of conduction with a conductivity of 1/T."""

COLDEST_SHOWN = 170.0
"""K; colder ice loses nothing that a figure could show."""

N_LEVELS = 40
"""Levels of the shell."""

QUANTILES = (0.05, 0.5, 0.95)


@dataclass(frozen=True, eq=False)
class Shell:
    """What draws of a law say of the shell.

    `temperature` (n,): K, from the base up. `is_supported` (n,): whether a test lies nearby.
    `viscosity` (n_draws, n): Pa s, of shear, at the middle tidal stress. `modulus`
    (n_stresses, n_draws, n): complex shear modulus, Pa. `love` (n_stresses, n_draws): k2.
    """

    temperature: FloatArray
    is_supported: BoolArray
    viscosity: FloatArray
    modulus: ComplexArray
    love: ComplexArray


def shell_temperature() -> FloatArray:
    """Temperature (K) at levels from the base of the shell to its surface, (N_LEVELS,)."""
    height = np.linspace(0.0, 1.0, N_LEVELS)
    found: FloatArray = BASE_TEMPERATURE * (SURFACE_TEMPERATURE / BASE_TEMPERATURE) ** height
    return found


def complex_moduli(rates: xr.Dataset, temperature: FloatArray, stress: float) -> ComplexArray:
    """Complex shear modulus (Pa) of spring and dashpot at the tide's period, (n_draws, n).

    At a level the composite law is a power law near the tide's stress, of which `pyburgers` has the
    loss of a cycle in closed form.
    """
    log_rate, exponent = (
        rates[name].transpose("draw", "condition").to_numpy()
        for name in ("log_strain_rate", "stress_exponent")
    )
    found = np.empty(log_rate.shape, dtype=complex)
    for k, kelvins in enumerate(temperature):
        # With Q = 1 J/mol the flow law has the draw's rate at the tide's stress if beta is this.
        beta = log_rate[:, k] - exponent[:, k] * np.log(stress) + 1.0 / (gas_constant * kelvins)
        spectrum = pyburgers.attenuation_spectrum(
            {
                "maxwell_modulus": np.full(len(beta), 2.0 * (1.0 + POISSON_RATIO) * SHEAR_MODULUS),
                # A Kelvin element that is too stiff to matter: no table of rates knows of one.
                "kelvin_modulus": np.full(len(beta), 1e20),
                "kelvin_viscosity": np.full(len(beta), 1e20),
                "stress_exponent": exponent[:, k],
                "grain_size_exponent": np.zeros(len(beta)),
                "activation_enthalpy": np.ones(len(beta)),
                "beta": beta,
            },
            [1.0 / PERIOD],
            [Regime(0.0, stress)],
            temperature=float(kelvins),
            grain_size=GRAIN_SIZE,
            with_strains=False,
        )
        loss = spectrum["loss_compliance"].to_numpy().reshape(-1)
        # Flow keeps the volume, so that its shear compliance is three times the axial one.
        found[:, k] = 1.0 / (1.0 / SHEAR_MODULUS - 3.0j * loss)
    return found


def love_number(modulus: ComplexArray) -> complex:
    """Tidal Love number k2 of Europa with a shell of complex shear moduli (n,) from its base up."""
    from TidalPy.RadialSolver import radial_solver

    tops = np.array([RADIUS - SHELL - OCEAN, RADIUS - SHELL, RADIUS])
    volume = 4.0 / 3.0 * np.pi * np.diff(np.r_[0.0, tops**3])
    rock = (MASS - ICE_DENSITY * volume[2] - WATER_DENSITY * volume[1]) / volume[0]
    levels = [
        np.linspace(bottom, top, n)
        for bottom, top, n in zip(np.r_[0.0, tops[:-1]], tops, (30, 20, N_LEVELS), strict=True)
    ]
    sizes = [one.size for one in levels]
    shear = [np.full(sizes[0], ROCK_SHEAR_MODULUS), np.zeros(sizes[1]), modulus]
    solution = radial_solver(
        np.concatenate(levels),
        np.repeat([rock, WATER_DENSITY, ICE_DENSITY], sizes),
        np.repeat([ROCK_BULK_MODULUS, WATER_BULK_MODULUS, ICE_BULK_MODULUS], sizes).astype(complex),
        np.concatenate(shear).astype(complex),
        2.0 * np.pi / PERIOD,
        MASS / volume.sum(),
        ("solid", "liquid", "solid"),
        (True, True, True),
        (False, False, False),
        tops,
        degree_l=2,
        love_only=True,
    )
    return complex(np.atleast_1d(solution.k)[0])


def shell_of(fit: RateFit) -> Shell:
    """Carry draws of a law to the shell and solve its tide."""
    temperature = shell_temperature()
    middle = TIDAL_STRESS[1]
    moduli, viscosity = [], np.empty(0)
    for stress in TIDAL_STRESS:
        rates = fit.rates_at(temperature, stress, GRAIN_SIZE)
        n_draws = rates.sizes["draw"]
        kept = rates.isel(draw=np.linspace(0, n_draws - 1, min(DRAWS, n_draws)).astype(int))
        moduli.append(complex_moduli(kept, temperature, stress))
        if stress == middle:
            viscosity = stress / (3.0 * np.exp(kept["log_strain_rate"].to_numpy()))
    supported = fit.mechanism_map(
        temperature=temperature, stress=np.array([middle]), grain_size=GRAIN_SIZE
    ).is_supported[0]
    love = [[love_number(one) for one in of_stress] for of_stress in moduli]
    return Shell(temperature, supported, viscosity, np.array(moduli), np.array(love))


def love_table(shell: Shell) -> pd.DataFrame:
    """Intervals of k2 by the stress of the tide."""
    rows = []
    for stress, love in zip(TIDAL_STRESS, shell.love, strict=True):
        low, middle, high = np.quantile(-love.imag, QUANTILES)
        rows.append(
            {
                "tidal stress (MPa)": f"{stress * 1e-6:g}",
                "Re k2": f"{np.median(love.real):.4f}",
                "-Im k2, median and 90 %": f"{middle:.2e} [{low:.2e}, {high:.2e}]",
            }
        )
    return pd.DataFrame(rows)


def shell_figure(shell: Shell) -> Figure:
    """Draw viscosity and dissipation over temperature, and k2's imaginary part."""
    with style():
        figure = Figure(figsize=(10.5, 3.9), layout="constrained")
        left, middle, right = figure.subplots(1, 3)
        shown = shell.temperature >= COLDEST_SHOWN
        draw_band(left, shell.temperature[shown], shell.viscosity[:, shown], BLUE, "")
        left.set_ylabel("shear viscosity (Pa s)")
        heat = shell.modulus[1].imag / np.abs(shell.modulus[1])
        draw_band(middle, shell.temperature[shown], heat[:, shown], VERMILION, "")
        middle.set_ylabel("loss of the modulus, Im G/|G|")
        for axes in (left, middle):
            axes.set_yscale("log")
            axes.set_xlim(COLDEST_SHOWN, BASE_TEMPERATURE)
            axes.set_xlabel("temperature (K)")
            beyond = ~shell.is_supported
            axes.fill_between(
                shell.temperature,
                *axes.get_ylim(),
                where=beyond,
                facecolor="none",
                edgecolor=GREY,
                hatch="///",
                linewidth=0,
            )
        for stress, love in zip(TIDAL_STRESS, shell.love, strict=True):
            values = np.sort(-love.imag)
            share = (np.arange(values.size) + 0.5) / values.size
            right.plot(values, share, label=f"{stress * 1e-6:g} MPa")
        right.ticklabel_format(axis="x", style="sci", scilimits=(0, 0))
        right.set_xlabel("-Im k2")
        right.set_ylabel("share of the draws below")
        right.legend(title="tidal stress")
    return figure


CAPTION = (
    "Left: viscosity of the shell by temperature, median and 90 % of the draws, at a tidal stress "
    "of {stress:g} MPa and grains of {grains:g} mm. Middle: the share of the modulus that is lost. "
    "Hatched: no test of the tables lies within 10 K and within a factor of 3 of stress and grain "
    "size. Right: the imaginary part of k2, to which the heat of the tide is proportional."
)


def europa_section(fit: RateFit, shell: Shell) -> PageSection:
    """Return the part of the page about the shell."""
    share = 100.0 * np.mean(~shell.is_supported)
    return PageSection(
        key="europa",
        title="The tide of Europa's ice shell",
        paragraphs=(
            f"Beyond the tests: {share:.0f} % of the levels of the shell have no test within 10 K "
            "and within a factor of 3 of stress and grain size. There the law is extrapolated.",
            f"A shell of {SHELL * 1e-3:g} km over an ocean of {OCEAN * 1e-3:g} km, "
            f"{SURFACE_TEMPERATURE:g} K at the surface and {BASE_TEMPERATURE:g} K at its base, "
            f"grains of {GRAIN_SIZE * 1e3:g} mm. Spring and dashpot alone: tables of rates know of "
            "no transient creep, which adds to the dissipation.",
        ),
        details=(
            "Every draw of the composite law is a power law near the stress of the tide. TidalPy "
            "solves rock, ocean and shell for each draw.",
            f"The law is that of the tables {', '.join(fit.used.sources)}.",
        ),
        tables=(
            PageTable("love", "Love number k2", love_table(shell), love_table(shell), words=()),
        ),
        figures=(
            PageFigure(
                "shell",
                "Shell",
                CAPTION.format(stress=TIDAL_STRESS[1] * 1e-6, grains=GRAIN_SIZE * 1e3),
                partial(shell_figure, shell),
            ),
        ),
        after_fits=True,
    )


def main() -> int:
    """Fit the tables, solve the shell, write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("europa"))
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    tables = [pyburgers.load_rate_table(path) for path in sorted(TABLES.glob("*.toml"))]
    command = f"python reports/europa.py --seed {options.seed}"
    fit = pyburgers.fit_rates(
        tables,
        pyburgers.rate_law("ice_composite"),
        out=options.out / "runs" / "ice_composite",
        options=SamplerOptions(seed=options.seed),
        command=command,
    )
    shell = shell_of(fit)
    sections = [pyburgers.rate_section(fit), europa_section(fit, shell)]
    page = pyburgers.write_report(
        [],
        options.out,
        title="From measured ice to Europa",
        command=command,
        extras=sections,
        told={sections[0].key: [fit]},
    )
    print(love_table(shell).to_string(index=False))
    print(page)
    return 0


if __name__ == "__main__":
    sys.exit(main())

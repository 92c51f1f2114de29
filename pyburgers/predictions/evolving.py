"""Attenuation while the microstructure evolves, solved in time, beside the frozen closed form.

The median stress is put on a material at rest and held, then a sinusoid is added
(`stan/imposed_stress.stan`), while grain size and fabric follow the path strain. Spring and Kelvin
element do not feel them, and have the compliance of the closed form; that of the dashpot is read
off its strain over the cycles, as off a record: a cubic trend and harmonics are fitted. The time
that a Kelvin element takes to settle into the cycles is left out that way, and with a frozen
microstructure the two agree.

A fluidity that grows within the record also leaves a strain in phase with the stress. Where that
outweighs the elastic strain, strain lags by more than a quarter of a cycle, and tan(delta) is given
as infinite.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
import xarray as xr

from pyburgers.cmdstan.program import load_program
from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.common.draws import FloatArray
from pyburgers.common.errors import InputError, SamplingError
from pyburgers.common.units import UNITS, rounded_to
from pyburgers.drawing.page_parts import text_table
from pyburgers.kinds.forced_oscillation.harmonics import CUBIC, fit_harmonics
from pyburgers.kinds.forward import check_given_together
from pyburgers.kinds.stan_data import SolverOptions, solver_block
from pyburgers.model.closed_forms import closed_forms, parameter_columns, require_standard
from pyburgers.model.laws import SPECTRUM_SWITCHES
from pyburgers.predictions.attenuation import (
    BAND_PERCENTAGES,
    attenuation_spectrum,
    condition_columns,
    evolving_quantiles,
)
from pyburgers.predictions.material import Material
from pyburgers.predictions.stress_cycles import (
    EVOLUTION,
    HOLD_TIME,
    OTHER_PARAMETERS,
    PAPER_REGIMES,
    Regime,
    checked_frequencies,
    checked_number,
    cycles_data,
)

EVOLVING_FREQUENCIES = (1e-4, 1e-3, 1e-2)
"""Hz; what is solved where no frequencies are chosen."""

CYCLES = 3
"""Length of the record."""

MAX_DRAWS = 100
"""Draws that are solved, at most."""

READINGS_PER_CYCLE = 64
N_HARMONICS = 6
"""Harmonics of the dashpot's strain: those beyond the fourth are small for n up to 5."""

SOLVER = SolverOptions(tolerance=1e-9, max_num_steps=1_000_000)


def evolving_attenuation(
    material: Material,
    frequencies: Sequence[float] | FloatArray = EVOLVING_FREQUENCIES,
    regimes: Sequence[Regime] = PAPER_REGIMES,
    *,
    hold_time: float = HOLD_TIME,
    cycles: int = CYCLES,
    max_draws: int = MAX_DRAWS,
) -> xr.Dataset:
    """Solve hold and cycles (at least 2) with evolving microstructure, beside the closed form.

    At most `max_draws` evenly spaced draws are solved, from the microstructure of the material at
    the start of the hold. ``fluidity_ratio`` is the loss of the dashpot, evolving over frozen; path
    strain, grain size and fabric factor are those at the end of the cycles. Raises `InputError` if
    a number is out of range, or the Kelvin part not one linear element, and `SamplingError` if the
    solver finds no solution.
    """
    frequency, hold = (
        checked_frequencies(frequencies),
        checked_number("hold_time", hold_time, " of s"),
    )
    for name, given, least in (("cycles", cycles, 2), ("max_draws", max_draws, 1)):
        if given < least:
            raise InputError(f"{name}: found {given}, expected at least {least}.")
    material = material.thinned(max_draws)
    parameters, state = material.parameters, material.state
    frozen = attenuation_spectrum(parameters, frequency, regimes, **state, hold_time=hold)
    asked = cycles_data((), frequency, hold, with_strains=False)
    elements = closed_forms(
        parameters, material.grain_size, temperature=material.temperature, asked=asked
    )
    elastic_loss = elements["kelvin_loss"][:, np.newaxis]
    frozen_loss = frozen["loss_compliance"].to_numpy()
    found = {
        name: np.empty(frozen_loss.shape)
        for name in ("storage", "loss", "path_strain", "grain_size", "fabric_factor")
    }
    for k, regime in enumerate(regimes):
        for j, one in enumerate(frequency):
            readings = np.arange(cycles * READINGS_PER_CYCLE + 1) / (READINGS_PER_CYCLE * one)
            solution = solve_imposed_stress(
                parameters,
                regime,
                float(one),
                readings,
                **state,
                hold_time=hold,
                evolving=True,
                solver=SOLVER,
            )
            for draw, strain in enumerate(solution["dashpot_strain"]):
                fit = fit_harmonics(
                    readings, strain, period=1 / one, degree=CUBIC, n_harmonics=N_HARMONICS
                )
                found["storage"][draw, k, j] = fit.sine[0] / regime.amplitude
                found["loss"][draw, k, j] = -fit.cosine[0] / regime.amplitude
            for name in ("path_strain", "grain_size", "fabric_factor"):
                found[name][:, k, j] = solution[name][:, -1]
    storage = frozen["storage_compliance"].to_numpy() + found.pop("storage")
    loss = elastic_loss + found["loss"]
    evolving = np.divide(loss, storage, out=np.full(loss.shape, np.inf), where=storage > 0)
    values = {
        "tan_delta_frozen": frozen["tan_delta"].to_numpy(),
        "tan_delta_evolving": evolving,
        "fluidity_ratio": found.pop("loss") / (frozen_loss - elastic_loss),
        **found,
    }
    coordinates = ("frequency", "regime", "median_stress", "amplitude", "temperature", "hold_time")
    return xr.Dataset(
        {name: (("draw", "regime", "frequency"), value) for name, value in values.items()},
        coords={name: frozen[name] for name in coordinates} | {"cycles": cycles},
        attrs=dict(material.attributes),
    )


def solve_imposed_stress(
    parameters: Mapping[str, FloatArray],
    regime: Regime,
    frequency: float,
    time: FloatArray,
    *,
    temperature: float,
    grain_size: FloatArray,
    fabric_factor: FloatArray,
    hold_time: float,
    evolving: bool,
    solver: SolverOptions,
) -> dict[str, FloatArray]:
    """Solve materials under a hold at the median stress and the cycles after it.

    Parameters, grain size (m) and fabric have the shape (n_materials,). Times (s) count from the
    start of the cycles, increase, are greater than ``-hold_time`` and hold 0. ``stress`` (Pa) has
    the shape (n_times,), all else (n_materials, n_times). Wrong frequencies and a backstress are
    refused by the spectrum that is made before.
    """
    require_standard(
        parameters,
        SPECTRUM_SWITCHES,
        "a Kelvin part of one relaxation time because a solution in time needs it; the closed form "
        "takes any",
    )
    check_given_together(
        {name: float(np.max(parameters[name])) for name in OTHER_PARAMETERS if name in parameters},
        "parameters",
    )
    missing = [name for name in EVOLUTION if evolving and name not in parameters]
    if missing:
        raise InputError(
            f"parameters: {missing[0]!r} is missing, expected it where the microstructure evolves; "
            "a fit of tables of attenuation alone has none."
        )
    data = {
        **solver_block(solver),
        "n_materials": grain_size.size,
        "parameter": np.stack(parameter_columns(parameters, grain_size.shape), axis=-1).tolist(),
        "initial": np.stack([grain_size, fabric_factor], axis=-1).tolist(),
        "evolves": int(evolving),
        "temperature": temperature,
        "median_stress": regime.median_stress,
        "amplitude": regime.amplitude,
        "frequency": frequency,
        "hold_time": hold_time,
        "n_times": time.size,
        "time": time.tolist(),
        "n_in_hold": int(np.count_nonzero(time <= 0)),
    }
    solution = load_program(stan_directory() / "imposed_stress.stan").evaluate(data)
    if not np.isfinite(solution["strain"]).all():
        raise SamplingError(
            "The solver found no finite strain at these parameters; check their units (SI) and "
            "the sign of beta."
        )
    return solution


def evolving_table(comparison: xr.Dataset) -> pd.DataFrame:
    """Return quantiles of tan(delta), frozen and evolving, and medians at the end of the cycles."""
    table = condition_columns(comparison)
    for name in ("tan_delta_frozen", "tan_delta_evolving", "fluidity_ratio"):
        column = name.removeprefix("tan_delta_")
        for percent, values in zip(
            BAND_PERCENTAGES, evolving_quantiles(comparison[name]), strict=True
        ):
            table[f"{column}_q{percent}"] = values.ravel()
    for name in ("path_strain", "grain_size", "fabric_factor"):
        column = "grain_size_m" if name == "grain_size" else name
        table[column] = evolving_quantiles(comparison[name])[1].ravel()
    return pd.DataFrame(table).assign(
        cycles=int(comparison["cycles"]), draws=comparison.sizes["draw"]
    )


def evolving_overview(comparison: xr.Dataset) -> pd.DataFrame:
    """Return `evolving_table` for people: text, median with 5 and 95 % of the draws."""
    table = evolving_table(comparison)
    strain = [rounded_to(100 * value) for value in table["path_strain"]]
    return text_table(
        table.assign(
            regime=np.repeat(comparison["regime"].to_numpy(), comparison.sizes["frequency"]),
            strain=strain,
        ),
        {
            "regime": "{regime}",
            "frequency (Hz)": "{frequency_Hz:.3g}",
            "tan δ, frozen": "{frozen_q50:.3g} [{frozen_q5:.3g}, {frozen_q95:.3g}]",
            "tan δ, evolving": "{evolving_q50:.3g} [{evolving_q5:.3g}, {evolving_q95:.3g}]",
            "dashpot faster, times": "{fluidity_ratio_q50:.3g} [{fluidity_ratio_q5:.3g}, "
            "{fluidity_ratio_q95:.3g}]",
            "strain at the end (%)": "{strain}",
        },
    )


def evolving_sentence(comparison: xr.Dataset) -> str:
    """Say how the two were compared."""
    hours = float(comparison["hold_time"]) / UNITS["time"]["h"]
    return (
        f"Evolving: the hold of {hours:g} h and {int(comparison['cycles'])} cycles after it are "
        f"solved in time for {comparison.sizes['draw']} draws, grain size and fabric following the "
        "strain; tan δ is read off the strain of these cycles, less a cubic trend. Frozen: the "
        "closed form, of the same draws. inf: strain lags by more than a quarter of a cycle."
    )

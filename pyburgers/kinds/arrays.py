"""Tests whose readings are arrays in memory: lists, NumPy arrays, columns of pandas.

Arguments are the keys of experiment files, and are checked as the tables of files are.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import factor_to_si
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.attenuation.files import AttenuationFile, load_attenuation
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.constant_rate.files import ConstantRateFile, load_constant_rate
from pyburgers.kinds.experiment_file import test_of
from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment
from pyburgers.kinds.forced_oscillation.files import OscillationFile, load_forced_oscillation
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.files import LoadingHistoryFile, load_loading_history


def ConstantRateTest(  # noqa: N802 - it stands for the class of its result
    *,
    stress: ArrayLike,
    stress_unit: str,
    strain_rate: float | Sequence[float],
    strain: ArrayLike | None = None,
    strain_unit: str | None = None,
    time: ArrayLike | None = None,
    time_unit: str | None = None,
    start_strain: float | Sequence[float] = 0.0,
    temperature_K: float,  # noqa: N803 - K for kelvin, as in files
    grain_size_um: float,
    material: str,
    name: str = "test",
    **keys: Any,
) -> ConstantRateExperiment:
    """Return a test at constant strain rate, or at rates that change in steps.

    Parameters
    ----------
    stress, strain, time : array, shape (n,)
        Readings, compression positive. At least one of strain and time is needed.
    stress_unit, strain_unit, time_unit : str
        Units, such as ``"MPa"``, ``"percent"`` and ``"s"``.
    strain_rate, start_strain : float or sequence of float
        Each imposed rate (1/s), and the strain (fraction) from which it holds.
    temperature_K, grain_size_um : float
        Temperature (K) and mean grain size at the start (micrometres).
    material, name : str
        The material names the default priors; the name becomes part of names of files.
    **keys
        Further keys of an experiment file, such as ``source="..."`` or
        ``stress_uncertainty=0.1``.

    Raises
    ------
    InputError
        If an argument is not what the file of such a test may hold.
    """
    rates, starts = np.atleast_1d(strain_rate), np.atleast_1d(start_strain)
    if rates.shape != starts.shape:
        raise InputError(
            f"ConstantRateTest: found {rates.size} values of 'strain_rate' and {starts.size} of "
            "'start_strain', expected as many of both."
        )
    segments = [
        {"strain_rate_per_s": rate, "start_strain": start}
        for rate, start in zip(rates.tolist(), starts.tolist(), strict=True)
    ]
    readings = {"strain": strain, "time": time, "stress": stress}
    units = {"strain_unit": strain_unit, "time_unit": time_unit, "stress_unit": stress_unit}
    arguments = {"segments": segments, **readings, **units, **keys}
    common = _common(name, material, temperature_K, grain_size_um)
    return test_of(
        "ConstantRateTest", load_constant_rate, ConstantRateFile, {**common, **arguments}
    )


def LoadingHistory(  # noqa: N802
    *,
    stages: Sequence[Mapping[str, Any]],
    time: ArrayLike | None = None,
    time_unit: str | None = None,
    strain: ArrayLike | None = None,
    strain_unit: str | None = None,
    stress: ArrayLike | None = None,
    stress_unit: str | None = None,
    temperature_K: float,  # noqa: N803
    grain_size_um: float,
    material: str,
    name: str = "test",
    **keys: Any,
) -> HistoryExperiment:
    """Return a test under a history of imposed strain and stress.

    Parameters
    ----------
    stages : sequence of mapping
        Tables ``[[stages]]`` of an experiment file. Their times and stresses are in the units of
        the readings, unless `stage_time_unit` and `stage_stress_unit` say others.
    time, strain, stress : array, shape (n,)
        Readings, compression positive, NaN for no reading; none for a test to be simulated.
    time_unit, strain_unit, stress_unit : str
        Units, such as ``"h"``, ``"percent"`` and ``"MPa"``.
    temperature_K, grain_size_um, material, name, **keys
        As for `pyburgers.ConstantRateTest`.

    Raises
    ------
    InputError
        If an argument is not what the file of such a test may hold.
    """
    return _history(
        "LoadingHistory",
        stages=list(map(dict, stages)),
        **_common(name, material, temperature_K, grain_size_um),
        time=time,
        strain=strain,
        stress=stress,
        time_unit=time_unit,
        strain_unit=strain_unit,
        stress_unit=stress_unit,
        **keys,
    )


def CreepTest(  # noqa: N802
    *,
    time: ArrayLike,
    time_unit: str,
    strain: ArrayLike,
    strain_unit: str,
    stress: float,
    stress_unit: str,
    temperature_K: float,  # noqa: N803
    grain_size_um: float,
    material: str,
    name: str = "test",
    **keys: Any,
) -> HistoryExperiment:
    """Return a test under one constant stress, which is applied at time zero.

    Parameters
    ----------
    time, strain : array, shape (n,)
        Readings; the test ends with the last one.
    time_unit, strain_unit, stress_unit : str
        Units, such as ``"h"``, ``"percent"`` and ``"MPa"``.
    stress : float
        The imposed stress, compression positive.
    temperature_K, grain_size_um, material, name, **keys
        As for `pyburgers.ConstantRateTest`.

    Raises
    ------
    InputError
        If an argument is not what the file of such a test may hold.
    """
    stage = {"control": "stress", "start_time": 0, "stress": stress}
    return _history(
        "CreepTest",
        stages=[{**stage, "end_time": _last("CreepTest", time)}],
        stage_stress_unit=stress_unit,
        **_common(name, material, temperature_K, grain_size_um),
        time=time,
        time_unit=time_unit,
        strain=strain,
        strain_unit=strain_unit,
        **keys,
    )


def RelaxationTest(  # noqa: N802
    *,
    time: ArrayLike,
    time_unit: str,
    stress: ArrayLike,
    stress_unit: str,
    strain: float,
    strain_unit: str,
    loading_time: float,
    temperature_K: float,  # noqa: N803
    grain_size_um: float,
    material: str,
    name: str = "test",
    **keys: Any,
) -> HistoryExperiment:
    """Return a test whose strain is imposed at a constant rate and then held.

    Parameters
    ----------
    time, stress : array, shape (n,)
        Readings, from the start of the loading; the test ends with the last one.
    time_unit, stress_unit, strain_unit : str
        Units, such as ``"s"``, ``"MPa"`` and ``"percent"``.
    strain, loading_time : float
        The strain that is held, and the time in which it was imposed.
    temperature_K, grain_size_um, material, name, **keys
        As for `pyburgers.ConstantRateTest`.

    Raises
    ------
    InputError
        If an argument is not what the file of such a test may hold.
    """
    called, end = "RelaxationTest", _last("RelaxationTest", time)
    if not 0 < loading_time < end:
        raise InputError(
            f"{called}: argument 'loading_time': found {loading_time:g}, expected more than 0 and "
            f"less than {end:g}, the last time."
        )
    total = strain * factor_to_si(strain_unit, "strain", f"{called}: argument 'strain_unit'")
    seconds = loading_time * factor_to_si(time_unit, "time", f"{called}: argument 'time_unit'")
    loading = {"control": "strain_rate", "start_time": 0, "end_time": loading_time}
    return _history(
        called,
        stages=[
            {**loading, "strain_rate_per_s": total / seconds},
            {"control": "hold_strain", "start_time": loading_time, "end_time": end},
        ],
        **_common(name, material, temperature_K, grain_size_um),
        time=time,
        time_unit=time_unit,
        stress=stress,
        stress_unit=stress_unit,
        **keys,
    )


def ForcedOscillation(  # noqa: N802
    *,
    strain: ArrayLike,
    strain_unit: str,
    strain_uncertainty: float | ArrayLike,
    stress: ArrayLike,
    stress_unit: str,
    stress_uncertainty: float | ArrayLike,
    time: ArrayLike,
    time_unit: str,
    stress_time: ArrayLike | None = None,
    temperature_K: float,  # noqa: N803
    grain_size_um: float,
    material: str,
    name: str = "test",
    **keys: Any,
) -> OscillationExperiment:
    """Return a test in which strain and stress oscillate.

    Parameters
    ----------
    strain, stress : array, shapes (n_strain,) and (n_stress,)
        Readings, compression positive.
    strain_unit, stress_unit, time_unit : str
        Units, such as ``"fraction"``, ``"MPa"`` and ``"s"``.
    strain_uncertainty, stress_uncertainty : float or array
        Standard deviations of readings, in the unit of the readings.
    time, stress_time : array
        Times of the strains, and of the stresses if they were read at other times.
    temperature_K, grain_size_um, material, name, **keys
        As for `pyburgers.ConstantRateTest`; keys such as ``period_s=100.0``.

    Raises
    ------
    InputError
        If an argument is not what the file of such a test may hold, or the record cannot be
        prepared.
    """
    stress_clock = time if stress_time is None else stress_time
    series = {
        "strain": (time, strain, strain_uncertainty, strain_unit),
        "stress": (stress_clock, stress, stress_uncertainty, stress_unit),
    }
    data: dict[str, Any] = {}
    columns: dict[str, dict[str, Any]] = {"strain": {}, "stress": {}}
    if stress_time is None:
        columns["stress"] = columns["strain"]
    for quantity, (times, readings, uncertainty, unit) in series.items():
        clock = "time" if times is time else "stress_time"
        columns[quantity] |= {clock: times, quantity: readings}
        key = f"{quantity}_uncertainty"
        if np.ndim(uncertainty):
            columns[quantity][key] = uncertainty
        data |= {
            f"{quantity}_file": columns[quantity],
            f"{quantity}_column": quantity,
            f"{quantity}_unit": unit,
            f"{quantity}_time_column": clock,
            f"{quantity}_time_unit": time_unit,
            **({f"{key}_column": key} if np.ndim(uncertainty) else {key: uncertainty}),
        }
    arguments = {**_common(name, material, temperature_K, grain_size_um), **data, **keys}
    return test_of("ForcedOscillation", load_forced_oscillation, OscillationFile, arguments)


def AttenuationTable(  # noqa: N802
    *,
    attenuation: ArrayLike | None = None,
    attenuation_form: str | None = None,
    period: ArrayLike | None = None,
    period_unit: str | None = None,
    frequency: ArrayLike | None = None,
    frequency_unit: str | None = None,
    temperature: ArrayLike | None = None,
    modulus: ArrayLike | None = None,
    modulus_unit: str | None = None,
    deformation: str,
    temperature_K: float,  # noqa: N803
    grain_size_um: float,
    material: str,
    name: str = "test",
    **keys: Any,
) -> AttenuationExperiment:
    """Return a table of attenuation, and of the modulus if it was read.

    Parameters
    ----------
    attenuation, modulus : array, shape (n,)
        Readings; a storage and a loss modulus may stand for them (``storage_modulus``,
        ``loss_modulus``).
    attenuation_form : {"tan_delta", "log10_tan_delta", "loss_angle"}
        Form of the attenuation.
    period, frequency : array, shape (n,)
        One of them.
    temperature : array, shape (n,), optional
        Temperature of each row, in `temperature_unit` (default K); else all have `temperature_K`.
    period_unit, frequency_unit, modulus_unit : str
        Units, such as ``"s"``, ``"Hz"`` and ``"GPa"``.
    deformation : {"axial", "shear"}
        Deformation of the cycles.
    temperature_K, grain_size_um, material, name, **keys
        As for `pyburgers.ConstantRateTest`. Keys such as ``poisson_ratio``, ``amplitude_Pa``,
        ``attenuation_uncertainty``; columns are arrays, as ``amplitude=[...]`` in `stress_unit`.

    Raises
    ------
    InputError
        If an argument is not what the file of such a table may hold.
    """
    arguments = {
        **_common(name, material, temperature_K, grain_size_um),
        "attenuation": attenuation,
        "attenuation_form": attenuation_form,
        "period": period,
        "period_unit": period_unit,
        "frequency": frequency,
        "frequency_unit": frequency_unit,
        "modulus": modulus,
        "modulus_unit": modulus_unit,
        "temperature": temperature,
        "deformation": deformation,
        **keys,
    }
    return test_of("AttenuationTable", load_attenuation, AttenuationFile, arguments)


def _common(name: str, material: str, temperature: float, grain_size: float) -> dict[str, Any]:
    """Return the arguments that all tests have, a grain size in micrometres, under their keys."""
    return {
        "id": name,
        "material": material,
        "temperature_K": temperature,
        # Anything but a number is refused where the key is checked.
        "initial_grain_size_m": grain_size / 1e6
        if isinstance(grain_size, (int, float, np.number))
        else grain_size,
    }


def _history(called: str, **arguments: Any) -> HistoryExperiment:
    """Return a loading history; stages have the units of the readings unless others are given."""
    units = {
        f"stage_{quantity}_unit": arguments.get(f"{quantity}_unit")
        for quantity in ("time", "stress")
    }
    # A unit of what was not read is one of the stages alone.
    for quantity in ("time", "stress", "strain"):
        if arguments.get(quantity) is None:
            arguments.pop(f"{quantity}_unit", None)
    return test_of(called, load_loading_history, LoadingHistoryFile, {**units, **arguments})


def _last(called: str, time: ArrayLike) -> float:
    """Return the largest of some times."""
    try:
        return float(np.nanmax(np.asarray(time, dtype=np.float64)))
    except (TypeError, ValueError):
        raise InputError(f"{called}: argument 'time': expected a list of numbers.") from None

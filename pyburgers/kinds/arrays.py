"""Tests whose readings are arrays in memory: lists, NumPy arrays, columns of pandas.

Arguments are the keys of experiment files, and are checked as the tables of files are.
"""

from collections.abc import Mapping, Sequence
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pyburgers.common.errors import InputError, require_type
from pyburgers.common.text_tables import table_of_columns
from pyburgers.common.toml_files import factor_to_si
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.attenuation.files import KIND as ATTENUATION
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.constant_rate.files import KIND as CONSTANT_RATE
from pyburgers.kinds.contradicted_names import contradicted_units
from pyburgers.kinds.experiment_file import test_of
from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment
from pyburgers.kinds.forced_oscillation.files import KIND as FORCED_OSCILLATION
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.files import KIND as LOADING_HISTORY
from pyburgers.kinds.loading_history.stages import DRIVEN


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

    Examples
    --------
    >>> test = pyburgers.ConstantRateTest(
    ...     strain=[0.1, 0.2, 0.4], strain_unit="percent", stress=[0.8, 1.5, 2.4],
    ...     stress_unit="MPa", strain_rate=1e-5, temperature_K=260, grain_size_um=230,
    ...     material="ice", name="mine"
    ... )
    """
    given = _named("ConstantRateTest", locals(), "strain_rate", "start_strain")
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
    arguments = {"segments": segments, "strain": strain, "time": time, **given}
    return test_of("ConstantRateTest", CONSTANT_RATE, arguments)


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

    Examples
    --------
    >>> hold = {"control": "stress", "start_time": 0, "end_time": 2, "stress": 0.8}
    >>> plan = pyburgers.LoadingHistory(
    ...     stages=[hold], time_unit="h", stress_unit="MPa", temperature_K=263,
    ...     grain_size_um=1000, material="ice", name="plan"
    ... )
    """
    given = _named("LoadingHistory", locals(), "stages")
    expected = "a list of tables [[stages]] of an experiment file"
    require_type("LoadingHistory: argument 'stages'", stages, (list, tuple), expected)
    for stage in stages:
        require_type("LoadingHistory: argument 'stages'", stage, Mapping, expected)
    return _history("LoadingHistory", {"stages": list(map(dict, stages)), **given})


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

    Examples
    --------
    >>> test = pyburgers.CreepTest(
    ...     time=[1, 2, 4], time_unit="h", strain=[0.1, 0.15, 0.2], strain_unit="percent",
    ...     stress=0.8, stress_unit="MPa", temperature_K=263, grain_size_um=1000,
    ...     material="ice", name="mine"
    ... )
    """
    given = _named("CreepTest", locals(), "stress", "stress_unit")
    stage = {"control": "stress", "start_time": 0, "stress": stress}
    stages = [{**stage, "end_time": _last("CreepTest", time)}]
    return _history("CreepTest", {"stages": stages, "stage_stress_unit": stress_unit, **given})


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

    Examples
    --------
    >>> test = pyburgers.RelaxationTest(
    ...     time=[10, 100, 1000], time_unit="s", stress=[2.0, 1.5, 1.0], stress_unit="MPa",
    ...     strain=0.06, strain_unit="percent", loading_time=10, temperature_K=263,
    ...     grain_size_um=1000, material="ice", name="mine"
    ... )
    """
    given = _named("RelaxationTest", locals(), "strain", "strain_unit", "loading_time")
    called, end = "RelaxationTest", _last("RelaxationTest", time)
    for key, value in (("strain", strain), ("loading_time", loading_time)):
        require_type(f"{called}: argument {key!r}", value, Real, "a number")
    if not 0 < loading_time < end:
        raise InputError(
            f"{called}: argument 'loading_time': found {loading_time:g}, expected more than 0 and "
            f"less than {end:g}, the last time."
        )
    total = strain * factor_to_si(strain_unit, "strain", f"{called}: argument 'strain_unit'")
    seconds = loading_time * factor_to_si(time_unit, "time", f"{called}: argument 'time_unit'")
    loading = {"control": "strain_rate", "start_time": 0, "end_time": loading_time}
    stages = [
        {**loading, "strain_rate_per_s": total / seconds},
        {"control": "hold_strain", "start_time": loading_time, "end_time": end},
    ]
    return _history(called, {"stages": stages, **given})


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

    Examples
    --------
    >>> time = np.linspace(0, 900, 181)
    >>> test = pyburgers.ForcedOscillation(
    ...     time=time, time_unit="s", strain=1e-4 * np.sin(2 * np.pi * time / 300 - 0.1),
    ...     strain_unit="fraction", strain_uncertainty=1e-6, stress=np.sin(2 * np.pi * time / 300),
    ...     stress_unit="MPa", stress_uncertainty=0.01, period_s=300.0, background="removed",
    ...     temperature_K=1423, grain_size_um=10, material="olivine", name="mine"
    ... )
    """
    given = _named("ForcedOscillation", locals(), *OSCILLATION_SERIES)
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
    return test_of("ForcedOscillation", FORCED_OSCILLATION, {**given, **data})


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

    Examples
    --------
    >>> table = pyburgers.AttenuationTable(
    ...     period=[1, 10, 100], period_unit="s", attenuation=[0.02, 0.04, 0.08],
    ...     attenuation_form="tan_delta", deformation="axial", temperature_K=1373,
    ...     grain_size_um=5, material="olivine", name="mine"
    ... )
    >>> table.n_points
    3
    """
    given = _named("AttenuationTable", locals())
    return test_of("AttenuationTable", ATTENUATION, given)


OSCILLATION_SERIES = (
    *("strain", "strain_unit", "strain_uncertainty", "stress", "stress_unit", "stress_uncertainty"),
    *("time", "time_unit", "stress_time"),
)
"""Arguments of oscillations that stand in columns under other keys."""


INSTEAD: Mapping[str, str] = {
    "id": "'name'",
    "initial_grain_size_m": "'grain_size_um'",
    "segments": "'strain_rate' and 'start_strain', or 'stages'",
    "file": "arrays",
    "data": "arrays",
}
"""Arguments that stand for keys of files."""

INSTEAD_OF_STAGES: Mapping[str, str] = {
    "stages": "pyburgers.LoadingHistory",
    "stage_time_unit": "'time_unit'",
    "stage_stress_unit": "'stress_unit'",
}
"""What stands for keys of stages where a function makes them, or where there are none."""


def _named(called: str, arguments: Mapping[str, Any], *others: str) -> dict[str, Any]:
    """Return the arguments of a function, without some others, under the keys of files."""
    given = {key: arguments[key] for key in arguments if key not in (*others, "keys")}
    size = given.pop("grain_size_um")
    are_made = "stages" not in arguments and "time_unit" in arguments
    for key, instead in {**INSTEAD, **(INSTEAD_OF_STAGES if are_made else {})}.items():
        if key in arguments["keys"]:
            raise InputError(f"{called}: argument {key!r}: expected {instead} in its place.")
    # Anything but a number is refused where the key is checked.
    is_number = np.ndim(size) == 0 and np.asarray(size).dtype.kind in "iuf"
    given["initial_grain_size_m"] = float(size) / 1e6 if is_number else size
    given = {"id": given.pop("name"), **given, **arguments["keys"]}
    notices = [*contradicted_units(called, {**arguments, **arguments["keys"]})]
    return {**given, "notices": [*given.get("notices", ()), *notices]} if notices else given


def _history(called: str, arguments: dict[str, Any]) -> HistoryExperiment:
    """Return a loading history; stages have the units of the readings unless others are given."""
    units = {
        f"stage_{quantity}_unit": arguments.get(f"{quantity}_unit")
        for quantity in ("time", "stress")
    }
    # Without them files have s and Pa.
    for quantity, driven in {"time": ("strain", "stress"), "stress": ("stress",)}.items():
        has_one = any(DRIVEN.get(stage.get("control")) in driven for stage in arguments["stages"])
        if has_one and {**units, **arguments}[f"stage_{quantity}_unit"] is None:
            raise InputError(
                f"{called}: argument '{quantity}_unit' is missing, expected it because a stage has "
                f"a {quantity}."
            )
    # A unit of what was not read is one of the stages alone.
    unread = {f"{q}_unit" for q in ("time", "stress", "strain") if arguments.get(q) is None}
    given = {key: value for key, value in arguments.items() if key not in unread}
    return test_of(called, LOADING_HISTORY, {**units, **given})


def _last(called: str, time: ArrayLike) -> float:
    """Return the largest of some times, as they will be read."""
    read = table_of_columns(Path(called), {"time": time}).numbers("time")
    if not read:
        raise InputError(f"{called}: argument 'time': expected a list of numbers.")
    return max(read)

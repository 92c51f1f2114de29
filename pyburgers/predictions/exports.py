"""Results of a fit as files of other codes: the mean of the posterior, and ensembles of draws."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from numbers import Integral
from pathlib import Path
from types import MappingProxyType

import numpy as np

from pyburgers.common.array_types import IntArray
from pyburgers.common.atomic_files import write_text
from pyburgers.common.draws import value_text
from pyburgers.common.errors import InputError, nearest, require_type
from pyburgers.common.paths import given_path
from pyburgers.common.units import rounded
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.sampled_fit import A_FIT, PRIOR_ALONE, SampledFit
from pyburgers.flow_law_tables.fit import RateFit
from pyburgers.flow_law_tables.laws import ENHANCEMENTS
from pyburgers.kinds.conditions import (
    ENVIRONMENT_WORDS,
    Ranges,
    doubtful_conditions,
    longer_than_tests,
)
from pyburgers.model.display import shown_quantity
from pyburgers.model.priors import FLOW_LAW
from pyburgers.predictions.code_formats import (
    COMPLIANCE_FORMATS,
    CREEP_FORMATS,
    ComplianceFormat,
    CreepFormat,
    shear_compliances,
)
from pyburgers.predictions.exported import (
    ASCII_SIGNS,
    LOG_FACTOR,
    Exported,
    as_csv,
    as_json,
    as_latex,
    exported,
    fitted_ranges,
)
from pyburgers.predictions.stated_laws import Stated, creep_laws, is_logarithm, rate_factors
from pyburgers.predictions.stress_cycles import Regime, asked_conditions

AnyFit = Fit | RateFit

STATE = ("microstructure", "grain_size", "fabric_factor")
CYCLES = ("frequencies", "regime", "poisson_ratio", "elastic_modulus")
"""Choices of flow codes, and those of stress cycles beside them."""


@dataclass(frozen=True)
class Format:
    """A format: `texts` of the mean and kept draws, and choices that it `uses`."""

    texts: Callable[[AnyFit, Stated, IntArray], tuple[str, ...]]
    uses: tuple[str, ...] = ()


def _record(fit: AnyFit, _: Stated, kept: IntArray) -> tuple[str, ...]:
    return (as_json(exported(fit), kept.tolist()),)


def _table(write: Callable[[Exported], str], fit: AnyFit, *_: object) -> tuple[str, ...]:
    return (write(exported(fit)),)


def _creep_texts(form: CreepFormat, fit: AnyFit, stated: Stated, kept: IntArray) -> tuple[str, ...]:
    laws, one = creep_laws(fit, stated, form.code), exported(fit)
    decide = [name for name in (*FLOW_LAW, LOG_FACTOR, *ENHANCEMENTS) if name in one.names]
    if LOG_FACTOR not in decide:
        decide = [*one.names]
    elif stated.microstructure == "steady_state":
        steady = ("steady_state_grain_size", "steady_state_fabric_factor")
        decide += [name for name in steady if name in one.names]
    given = tuple(map(float, stated.temperatures))
    if form.by_temperature and not given:
        if isinstance(fit, RateFit):
            raise InputError(f"{form.code}: found no temperature, expected --temperature-K.")
        given = (fit.experiment.temperature,)
    notes = [
        *_caution_lines(one, decide, fit, asked_conditions(given, stated.grain_size)),
        f"State of the material: {laws.state}. It does not change here.",
        "Left out: elastic and transient strain; evolution of grain size and fabric.",
    ]
    mean = "Mean of the posterior: ln(rate) of this law is the mean of ln(rate) of all draws."
    chosen = [laws.mean, *map(laws.draw, kept)]
    factors = rate_factors(chosen, given).tolist() if given else [[] for _ in chosen]
    name = f"{one.test} {one.material}"
    return tuple(
        form.text(law, name, [*head, *notes], dict(zip(given, at_temperatures, strict=True)))
        for law, head, at_temperatures in zip(
            chosen, _heads(one, form.code, mean, kept), factors, strict=True
        )
    )


def _compliance_texts(
    form: ComplianceFormat, fit: AnyFit, stated: Stated, kept: IntArray
) -> tuple[str, ...]:
    if len(stated.temperatures) > 1:
        raise InputError(
            f"{form.code}: found {len(stated.temperatures)} temperatures, expected one in a table."
        )
    found, one = shear_compliances(fit, stated, form.code), exported(fit)
    assert isinstance(fit, Fit)
    given = asked_conditions(
        stated.temperatures,
        stated.grain_size,
        frequencies=found.frequency,
        regimes=() if stated.regime is None else [stated.regime],
    )
    asked = {**given, **found.rates}
    names = [name for name in one.names if name != LOG_FACTOR]
    longer = longer_than_tests(asked, (fit.whole or fit).problem.experiments)
    notes = [*_caution_lines(one, names, fit, asked), *longer, *found.notes]
    mean = "Mean of the posterior: means of J1 and of J2 over all draws."
    storage, loss = (
        np.vstack([values.mean(axis=0), values[kept]]) for values in (found.storage, found.loss)
    )
    return tuple(
        form.text(found.frequency, j1, j2, [*head, *notes])
        for j1, j2, head in zip(storage, loss, _heads(one, form.code, mean, kept), strict=True)
    )


def _heads(one: Exported, code: str, mean: str, kept: IntArray) -> Iterator[tuple[str, str]]:
    """Yield the first two notes of the mean and of each kept draw."""
    title = f"pyburgers export for {code}: {one.test}, {one.material}, run {one.run}"
    if one.draws_of == PRIOR_ALONE:
        mean = mean.replace("posterior", "prior")
    for kind in (mean, *(f"Draw {k + 1} of {one.n_draws}." for k in kept)):
        yield f"{title}, model {one.variant}", kind


def _caution_lines(one: Exported, names: Sequence[str], fit: AnyFit, asked: Ranges) -> list[str]:
    """Return verdicts, who decides those parameters, and conditions: fitted ones, asked ones."""
    decided, ranges = [], fitted_ranges(fit)
    for name in names:
        k = one.names.index(name)
        unit = "1" if is_logarithm(name) else shown_quantity(name).si_unit
        beside = "" if unit in {"1", "fraction"} else f" {unit}"
        value = value_text(one.draws[k]) if one.sd[k] else rounded(one.mean[k], 0.0)
        by = f"{one.decided_by[k]} {one.by_prior_of[k]}".strip() or "unknown"
        decided.append(f"{name} {value.translate(ASCII_SIGNS)}{beside} ({by})")
    tested = f"Conditions of the fitted tests: {one.conditions}. The law extrapolates elsewhere."
    if one.draws_of == PRIOR_ALONE:
        tested = f"Conditions of the test, which was not fitted: {one.conditions}."
    of_specimens = {name: ends for name, ends in ranges.items() if name in ENVIRONMENT_WORDS}
    doubtful = doubtful_conditions(one.material, {**of_specimens, **asked}, [ranges])
    return [
        f"Sampled well: {one.sampled_well}. Describes the data: {one.describes_data}.",
        f"Decided by: {'; '.join(decided)}.",
        *one.notes,
        tested,
        *(said.translate(ASCII_SIGNS) for said in doubtful),
    ]


FORMATS: Mapping[str, Format] = MappingProxyType(
    {
        "json": Format(_record, ("draws",)),
        "csv": Format(partial(_table, as_csv)),
        "latex": Format(partial(_table, as_latex)),
        **{
            name: Format(
                partial(_creep_texts, form),
                ("draws", *STATE, *["temperatures"] * form.by_temperature),
            )
            for name, form in CREEP_FORMATS.items()
        },
        **{
            name: Format(
                partial(_compliance_texts, form), ("draws", "temperatures", *STATE, *CYCLES)
            )
            for name, form in COMPLIANCE_FORMATS.items()
        },
    }
)
"""All formats by name."""


def export(
    fit: AnyFit,
    file_format: str,
    *,
    out: str | Path | None = None,
    draws: int = 0,
    seed: int = 1,
    microstructure: str | None = None,
    grain_size: float | None = None,
    fabric_factor: float | None = None,
    temperatures: Sequence[float] = (),
    frequencies: Sequence[float] = (),
    regime: Regime | None = None,
    poisson_ratio: float | None = None,
    elastic_modulus: float | None = None,
) -> tuple[str, ...]:
    """Return a fit in the syntax of another code: the mean, then an ensemble of draws.

    Parameters
    ----------
    fit : Fit or RateFit
        A fit of one test (of a joint fit: ``fit["ID"]``), or of tables of rates.
    file_format : str
        For the creep law aspect, elmer, geoparams, icepack, lamem, pism or underworld. For
        compliances in shear specfem or tidalpy. For all parameters json, csv or latex.
    out : path, optional
        File of the mean. Draws go to files beside it, with ``_1`` and so on behind its name.
    draws : int
        Number of draws, without replacement. With json they stand in the file, as ``sample``.
    seed : int
        Of the choice of draws.
    microstructure : {"initial", "steady_state"}, optional
        State of a material whose microstructure evolves; required for it by flow codes.
    grain_size, fabric_factor : float, optional
        m and 1; take the place of those of `microstructure`.
    temperatures : sequence of float
        K, for icepack; one for specfem and tidalpy. Default that of the test.
    frequencies : sequence of float
        Hz; default those of `pyburgers.predict_attenuation`.
    regime : Regime, optional
        Axial stress of the cycles; required unless the dashpot is linear.
    poisson_ratio : float, optional
        Required for compliances in shear.
    elastic_modulus : float, optional
        Young's modulus in Pa, in place of E_M.

    Returns
    -------
    tuple of str
        Text of the mean, then of each draw.

    Raises
    ------
    InputError
        If the format cannot express the law of the fit, or a choice is missing, wrong or unused.
    ToolchainError
        If CmdStan or a compiler is missing (icepack, specfem, tidalpy).

    Examples
    --------
    >>> block = pyburgers.export(fit, "aspect", microstructure="initial", out="ice.prm")
    """
    require_type("fit", fit, SampledFit, A_FIT)
    if file_format not in FORMATS:
        raise InputError(
            f"file_format: unknown format {file_format!r}, {nearest(file_format, FORMATS)}"
        )
    chosen = FORMATS[file_format]
    stated = Stated(
        microstructure,
        grain_size,
        fabric_factor,
        tuple(np.atleast_1d(temperatures).tolist()),
        tuple(np.atleast_1d(frequencies).tolist()),
        regime,
        poisson_ratio,
        elastic_modulus,
    )
    given = {**vars(stated), "draws": draws or None}
    for name, value in given.items():
        is_given = value is not None and not (isinstance(value, tuple) and not value)
        if is_given and name not in chosen.uses:
            found = ", ".join(map(str, value)) if isinstance(value, tuple) else value
            raise InputError(
                f"{name}: found {found}, expected none: {file_format} does not use it."
            )
    texts = chosen.texts(fit, stated, _kept(fit, draws, seed))
    if out is not None:
        files = export_files(given_path(out), len(texts))
        if not files[0].parent.is_dir():
            raise InputError(f"{files[0]}: the folder {files[0].parent} does not exist.")
        for path, text in zip(files, texts, strict=True):
            write_text(path, text)
    return texts


def export_files(out: Path, n_texts: int) -> list[Path]:
    """Return the files of so many texts: that of the mean, and those of the draws beside it."""
    return [out, *(out.with_name(f"{out.stem}_{k}{out.suffix}") for k in range(1, n_texts))]


def _kept(fit: AnyFit, draws: int, seed: int) -> IntArray:
    """Return the numbers of chosen draws, counted from 0 along all chains."""
    sizes = fit.posterior["posterior"].sizes
    there = sizes["chain"] * sizes["draw"]
    require_type("draws", draws, Integral, "a whole number")
    if not 0 <= draws <= there:
        raise InputError(f"draws: found {draws}, expected at most {there}, the draws of the fit.")
    return np.sort(np.random.default_rng(seed).choice(there, draws, replace=False))

"""How far a material has softened at the peak of a test, as priors of its curves have it.

At its peak stress a test is weaker than undeformed material, and more so where more strain comes
before the peak: the stress exponent seen across peaks is not that of the flow law. A table cannot
tell the two apart, but the priors of the other parameters of a curve say how large the softening
can be and how it changes with the conditions. That is simulated here, through Stan.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from pyburgers.cmdstan.program import load_program
from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.common.atomic_files import write_json
from pyburgers.common.draws import FloatArray
from pyburgers.common.errors import InputError, SamplingError
from pyburgers.common.toml_files import Table, read_json_table
from pyburgers.flow_law_tables.tables import PeakStrain, RateTable
from pyburgers.kinds.program_data import given_parameters
from pyburgers.kinds.stan_data import SolverOptions, StanData, solver_block
from pyburgers.model.parameters import PROGRAM_PARAMETERS
from pyburgers.model.priors import FLOW_LAW, PriorSet

SOLVER = SolverOptions(tolerance=1e-6)

N_SOFTENING = 4
"""Numbers that describe the softening about the mean conditions."""

STRAINS = np.geomspace(2e-4, 0.2, 80)
"""Where stress is looked at for its peak; one that rises beyond 20 % strain has its peak there."""

N_MATERIALS = 300
"""Draws from the priors whose softening is simulated at all conditions."""

N_CANDIDATES, MOST_CANDIDATES = 3000, 30_000
"""Draws of which those with a stated strain of the peak are taken, as many at a time as the first
number says: more follow until `N_MATERIALS` of them are independent."""

LEAST_MATERIALS = 50
"""Independent ones among the first `N_CANDIDATES` below which a stated strain contradicts the
priors."""

STEP = 1.5
"""From the mean conditions of a table to those where softening is simulated as well, in standard
deviations of the table's conditions along their principal axes."""

LEAST_STEP = 0.05
"""The same where a table has hardly any spread, in logarithms."""

EXPONENT_ERRORS, EXPONENT_SPREAD = 3.0, (0.15, 0.5)
"""Of ln n and ln p of simulated materials: the standard deviation is this multiple of the standard
error across peaks, but not outside this range."""

LEAST_SLOPE = 1e-3
"""Of ln(softening) by ln(peak stress): it is positive, but for errors of the solver."""


class _SofteningTable(Table):
    """A `SofteningPrior` in a file."""

    coefficients: list[list[float]]
    centre: list[float]
    factor: list[list[float]]
    peak_strain: list[float]
    n_effective: float


@dataclass(frozen=True, eq=False)
class SofteningPrior:
    """Softening s = ln(S_0/peak stress) about the mean conditions of a table.

    With h_1 the softening at the mean conditions, and x the distance in ln(strain rate), ln(peak
    stress) and ln(grain size), s = h_1 + h_2 x_rate + h_3 x_stress + h_4 x_grain_size. The vector w
    = [ln h_1, h_2/h_1, ln(h_3/h_1), h_4/h_1] is normal: `coefficients` (4, 3) give its mean by 1,
    ln n and ln p less `centre` (2,), `factor` (4, 4) is the lower Cholesky factor of its
    covariance. `peak_strain` (3,): its 5, 50 and 95 % quantiles.
    """

    coefficients: FloatArray
    centre: FloatArray
    factor: FloatArray
    peak_strain: FloatArray
    n_effective: float

    def save(self, path: Path) -> None:
        """Write a JSON file that `load` reads."""
        numbers = {name: np.asarray(value).tolist() for name, value in vars(self).items()}
        write_json(path, numbers)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a saved prior; raise `InputError` if the file was damaged."""
        numbers = read_json_table(path, _SofteningTable).model_dump()
        n_effective = numbers.pop("n_effective")
        arrays = {name: np.array(value) for name, value in numbers.items()}
        return cls(**arrays, n_effective=n_effective)

    @property
    def block(self) -> StanData:
        """Data of `stan/rates.stan`."""
        return {
            "softening_coefficients": self.coefficients.tolist(),
            "softening_centre": self.centre.tolist(),
            "softening_factor": self.factor.tolist(),
        }


NO_SOFTENING = SofteningPrior(
    np.zeros((N_SOFTENING, 3)), np.zeros(2), np.eye(N_SOFTENING), np.zeros(3), 0.0
)
"""Of tables whose tests are not softened, in the data of the program."""


@dataclass(frozen=True, eq=False)
class Peaks:
    """Peaks of materials: ln(stress/Pa), strain, ln(S_0/stress); (n_materials, n_conditions)."""

    log_stress: FloatArray
    strain: FloatArray
    softening: FloatArray


def least_squares(data: RateTable) -> dict[str, tuple[float, float]]:
    """Return exponents and errors from ln(stress) by ln(rate), ln(grain size), if rows tell."""
    columns = [np.ones(data.n_rows), np.log(data.strain_rate)]
    if np.ptp(data.grain_size) > 0:
        columns.append(np.log(data.grain_size))
    design = np.column_stack(columns)
    if data.n_rows <= len(columns) or np.linalg.matrix_rank(design) < len(columns):
        return {}
    log_stress = np.log(data.stress)
    slopes, *_ = np.linalg.lstsq(design, log_stress, rcond=None)
    residual = log_stress - design @ slopes
    variance = float(residual @ residual) / (data.n_rows - design.shape[1])
    covariance = variance * np.linalg.inv(design.T @ design)
    n = 1 / slopes[1]
    found = {"stress_exponent": (float(n), float(n**2 * np.sqrt(covariance[1, 1])))}
    if len(columns) > 2:
        p = slopes[2] * n
        by_slopes = np.array([0.0, -p * n, n])
        error = float(np.sqrt(by_slopes @ covariance @ by_slopes))
        found["grain_size_exponent"] = (float(p), error)
    return found


def simulate_peaks(
    material: str,
    values: Sequence[Mapping[str, float]],
    *,
    strain_rate: FloatArray,
    grain_size: FloatArray,
    temperature: FloatArray,
    peak_stress: FloatArray | None = None,
) -> Peaks:
    """Find peaks of materials under conditions (n,), SI; given peak stresses (Pa) set their Q_M."""
    given = [given_parameters(material, one) for one in values]
    wanted = np.zeros(strain_rate.size) if peak_stress is None else peak_stress
    found = load_program(stan_directory() / "peaks.stan").evaluate(
        {
            "n_materials": len(given),
            "parameter": [[one[p.name].location for p in PROGRAM_PARAMETERS] for one in given],
            "n_conditions": strain_rate.size,
            "strain_rate": strain_rate.tolist(),
            "grain_size": grain_size.tolist(),
            "temperature": temperature.tolist(),
            "wanted_peak_stress": wanted.tolist(),
            "n_strains": STRAINS.size,
            "strain": STRAINS.tolist(),
            **solver_block(SOLVER),
        }
    )
    peaks = Peaks(found["log_peak_stress"], found["peak_strain"], found["softening"])
    if not np.isfinite(peaks.log_stress).all():
        raise SamplingError(
            f"{material}: a test has no solution to {STRAINS[-1]:.0%} strain at some of the "
            f"parameters; rates are {strain_rate.min():.2g} to {strain_rate.max():.2g} 1/s, check "
            "the units of the table and the priors."
        )
    return peaks


def softening_prior(data: RateTable, curve: PriorSet, *, seed: int) -> SofteningPrior:
    """Simulate softening with a curve's priors, at a table's mean peak stress and stated strain."""
    rng = np.random.default_rng(seed)
    curve = curve.resolved(float(data.stress.max()))
    if data.peak_strain is None:
        materials, n_effective = _draw(data, curve, N_MATERIALS, rng), float(N_MATERIALS)
    else:
        materials, n_effective = _with_peaks_at(data, data.peak_strain, curve, rng)
    axes, steps = _principal_axes(data)
    shifts = np.vstack([np.zeros((1, 3)), *(side * steps[:, None] * axes for side in (1, -1))])
    peaks = _peaks_about(data, materials, shifts)
    softening = peaks.softening[:, :1]
    above, below = np.split(peaks.softening[:, 1:], 2, axis=1)
    slope = (above - below) / (2 * steps) @ axes / softening
    w = np.column_stack(
        [np.log(softening), slope[:, 0], np.log(np.maximum(slope[:, 1], LEAST_SLOPE)), slope[:, 2]]
    )
    exponents = np.log([[one[name] for name in FLOW_LAW[:2]] for one in materials])
    centre = exponents.mean(axis=0)
    design = np.column_stack([np.ones(len(materials)), exponents - centre])
    fitted, *_ = np.linalg.lstsq(design, w, rcond=None)
    return SofteningPrior(
        coefficients=fitted.T,
        centre=centre,
        factor=np.linalg.cholesky(np.cov((w - design @ fitted).T)),
        peak_strain=np.quantile(peaks.strain[:, 0], [0.05, 0.5, 0.95]),
        n_effective=n_effective,
    )


def _draw(
    data: RateTable, priors: PriorSet, n_materials: int, rng: np.random.Generator
) -> list[dict[str, float]]:
    """Draw parameters (SI) of materials, n and p about the exponents that a table has itself."""
    drawn = {name: np.full(n_materials, prior.location) for name, prior in priors.priors.items()}
    for name in priors.free:
        drawn[name] = priors[name].distribution().rvs(size=n_materials, random_state=rng)
    for name, (value, error) in least_squares(data).items():
        if value > 0:
            spread = np.clip(EXPONENT_ERRORS * error / value, *EXPONENT_SPREAD)
            drawn[name] = value * np.exp(spread * rng.standard_normal(n_materials))
    return [
        dict(zip(drawn, map(float, row), strict=True)) for row in zip(*drawn.values(), strict=True)
    ]


def _with_peaks_at(
    data: RateTable, peak_strain: PeakStrain, curve: PriorSet, rng: np.random.Generator
) -> tuple[list[dict[str, float]], float]:
    """Draw materials whose peaks are where the table states, and count the independent ones."""
    candidates: list[dict[str, float]] = []
    strain = weight = np.empty(0)
    n_effective = 0.0
    while n_effective < N_MATERIALS and len(candidates) < MOST_CANDIDATES:
        more = _draw(data, curve, N_CANDIDATES, rng)
        candidates += more
        strain = np.append(strain, _peaks_about(data, more, np.zeros((1, 3))).strain[:, 0])
        distance = np.log(strain / peak_strain.mean) / (peak_strain.sd / peak_strain.mean)
        weight = np.exp(-0.5 * distance**2)
        squares = max(float(weight @ weight), np.finfo(float).tiny)
        n_effective = float(weight.sum()) ** 2 / squares
        if len(candidates) == N_CANDIDATES and n_effective < LEAST_MATERIALS:
            low, high = np.quantile(strain, [0.05, 0.95])
            raise InputError(
                f"{data.id}: key 'peak_strain': found {peak_strain.mean:g}, but nine in ten peaks "
                f"of {curve.title!r} are at {low:.2g} to {high:.2g}, expected priors under which "
                "such a peak is not next to impossible."
            )
    places = (rng.random() + np.arange(N_MATERIALS)) / N_MATERIALS * weight.sum()
    chosen = np.minimum(np.searchsorted(np.cumsum(weight), places), len(candidates) - 1)
    return [candidates[k] for k in chosen], min(n_effective, N_MATERIALS)


def _principal_axes(data: RateTable) -> tuple[FloatArray, FloatArray]:
    """Directions, a row each, in which a table's conditions vary, and how far along each to go."""
    conditions = np.log([data.strain_rate, data.stress, data.grain_size])
    variance, directions = np.linalg.eigh(np.cov(conditions))
    spread = np.sqrt(np.maximum(variance, 0.0))
    return directions.T, np.maximum(STEP * spread, LEAST_STEP)


def _peaks_about(
    data: RateTable, materials: Sequence[Mapping[str, float]], shifts: FloatArray
) -> Peaks:
    """Find peaks at shifts (n, 3) of ln(rate), ln(peak stress), ln(grain size) from the mean."""
    at, factors = data.mean_conditions, np.exp(shifts.T)
    return simulate_peaks(
        data.material,
        materials,
        strain_rate=data.mean_strain_rate * factors[0],
        peak_stress=at.stress * factors[1],
        grain_size=at.grain_size * factors[2],
        temperature=np.full(len(shifts), at.temperature),
    )

"""How the numbers of the file of a loading history are meant: units, signs and measures."""

from dataclasses import dataclass
from pathlib import Path

from pyburgers.common.toml_files import factor_to_si
from pyburgers.protocols.loading_history.true_measures import Measure
from pyburgers.protocols.signs import Compression, sign_of


@dataclass(frozen=True)
class Conventions:
    """How the numbers of a file are meant.

    `time`, `stress`: factors to SI of times and stresses in [[stages]].
    `time_unit`: of times in [[stages]].
    `sign`: of a compression.
    `stress_measure`, `strain_measure`: their measures.
    """

    time: float
    stress: float
    time_unit: str
    sign: int
    stress_measure: Measure
    strain_measure: Measure

    @classmethod
    def of(
        cls,
        path: Path,
        *,
        time_unit: str,
        stress_unit: str,
        compression: Compression,
        measures: tuple[Measure, Measure],
    ) -> "Conventions":
        """Check the units of a file."""
        return cls(
            factor_to_si(time_unit, "time", f"{path}: key 'stage_time_unit'"),
            factor_to_si(stress_unit, "stress", f"{path}: key 'stage_stress_unit'"),
            time_unit,
            sign_of(compression),
            *measures,
        )

    def time_text(self, time: float) -> str:
        """Return a time on the clock of the file (s) in the unit of its stages."""
        return f"{time / self.time:g} {self.time_unit}"

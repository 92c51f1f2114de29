"""What `pyburgers new` writes for a table of attenuation."""

from collections.abc import Collection, Mapping
from typing import Any

from pyburgers.common.text_tables import TextTable
from pyburgers.protocols.attenuation.experiment import AttenuationExperiment
from pyburgers.protocols.guessed_columns import GuessedColumn, numbers_of
from pyburgers.protocols.new_file import (
    Description,
    NewFile,
    Question,
    column_lines,
    layout_lines,
    line,
    optional,
)

DEFORMATION = Question("deformation", "deformation", choices=("axial", "shear"))
POISSON_RATIO = Question("poisson_ratio", "Poisson's ratio", float, default=0.25)


class AttenuationFile(NewFile):
    """A table against period or frequency."""

    experiment = AttenuationExperiment
    needed = (("period", "frequency"), ("attenuation",))
    quantities = frozenset(
        {"period", "frequency", "temperature", "median_stress", "amplitude", "attenuation"}
        | {"attenuation_uncertainty", "limit", "modulus", "modulus_uncertainty"}
    )
    questions = (DEFORMATION, POISSON_RATIO)

    def suits(self, table: TextTable, columns: Mapping[str, GuessedColumn]) -> str | None:
        """Return that attenuation is read."""
        return "there is a column of attenuation" if "attenuation" in columns else None

    def read(self, columns: Mapping[str, GuessedColumn]) -> Mapping[str, GuessedColumn]:
        """Return what there is of a table, with the period rather than the frequency."""
        found = super().read(columns)
        needless = {"frequency"} if "period" in found else set()
        needless |= set() if "modulus" in found else {"modulus_uncertainty"}
        return {name: one for name, one in found.items() if name not in needless}

    def taken(self, columns: Collection[str], given: Mapping[str, Any]) -> Collection[str]:
        """Return Poisson's ratio only where the deformation may be shear."""
        axial = given[DEFORMATION.name] == "axial"
        return {DEFORMATION.name} if axial else {DEFORMATION.name, POISSON_RATIO.name}

    def lines(self, test: Description) -> list[str]:
        """Return the kind of deformation and the columns."""
        values, columns = test.values, test.columns
        readings = numbers_of(test.table, columns, "attenuation")
        lines = [
            "[attenuation]",
            line("deformation", values["deformation"], "axial or shear: of modulus and stresses"),
        ]
        if values["deformation"] == "shear":
            lines.append(line("poisson_ratio", values["poisson_ratio"], "or bulk_modulus_Pa"))
        lines += [
            optional(f"{name}_Pa = 1e6", "of every row")
            for name in ("median_stress", "amplitude")
            if name not in columns
        ]
        lines += ["", "[data]", line("file", test.file), *layout_lines(test)]
        lines += column_lines(test, "period" if "period" in columns else "frequency")
        lines += column_lines(test, "temperature")
        for name in ("median_stress", "amplitude"):
            if name in columns:
                lines.append(line(f"{name}_column", columns[name].column))
                stress_unit = columns[name].unit
        if "median_stress" in columns or "amplitude" in columns:
            lines.append(line("stress_unit", stress_unit))
        logarithms = bool((readings < 0).any())
        form = "log10_tan_delta" if logarithms else "tan_delta"
        lines += [
            line("attenuation_column", columns["attenuation"].column),
            line("attenuation_form", form, "tan_delta (1/Q is the same) or log10_tan_delta"),
        ]
        if "attenuation_uncertainty" in columns:
            lines += column_lines(test, "attenuation_uncertainty")
        else:
            lines.append(optional("attenuation_uncertainty = 1e-3", "of tan delta itself"))
        lines += column_lines(test, "limit")
        if "modulus" in columns:
            lines += [
                *column_lines(test, "modulus"),
                *column_lines(test, "modulus_uncertainty"),
            ]
        return lines


NEW_FILE = AttenuationFile()

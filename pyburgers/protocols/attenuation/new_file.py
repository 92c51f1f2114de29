"""What `pyburgers new` writes for a table of attenuation."""

from collections.abc import Collection, Mapping
from typing import Any

from pyburgers.common.units import units_text
from pyburgers.protocols.attenuation.experiment import AttenuationExperiment
from pyburgers.protocols.new_file import (
    Columns,
    Description,
    NewFile,
    Question,
    column_lines,
    layout_lines,
    line,
    optional,
)
from pyburgers.protocols.quantities import LOGARITHM

DEFORMATION = Question("deformation", "deformation", choices=("axial", "shear"), example="shear")
POISSON_RATIO = Question("poisson_ratio", "Poisson's ratio", float, default=0.25)


class AttenuationFile(NewFile):
    """A table against period or frequency."""

    experiment = AttenuationExperiment
    needed = (("period", "frequency"), ("attenuation", "loss_modulus"))
    quantities = frozenset(
        {"period", "frequency", "temperature", "median_stress", "amplitude", "attenuation"}
        | {"attenuation_uncertainty", "limit", "modulus", "modulus_uncertainty"}
        | {"storage_modulus", "loss_modulus"}
    )
    questions = (DEFORMATION, POISSON_RATIO)

    def suits(self, columns: Columns) -> str | None:
        """Return that attenuation is read, of a table that is no stress or strain."""
        is_table = {"period", "frequency"} & columns.keys() or not {
            "strain",
            "stress",
        } & columns.keys()
        if is_table and "attenuation" in columns:
            return "there is a column of attenuation"
        both = {"storage_modulus", "loss_modulus"} <= columns.keys()
        return "there are a storage and a loss modulus" if is_table and both else None

    def read(self, columns: Columns) -> Columns:
        """Return what there is of a table, each quantity once.

        The period goes before the frequency, tan delta before two moduli, |M| before M'.
        """
        found = super().read(columns)
        attenuation = found.get("attenuation")
        needless = {"frequency"} if "period" in found else set()
        if {"storage_modulus", "loss_modulus"} <= found.keys() and (
            attenuation is None or attenuation.is_foreign
        ):
            needless |= {"attenuation", "attenuation_uncertainty", "modulus", "modulus_uncertainty"}
        else:
            needless |= {"loss_modulus"} | ({"storage_modulus"} if "modulus" in found else set())
        if attenuation is not None and attenuation.unit is not None:
            needless.add("attenuation_uncertainty")  # of an angle, not of tan delta
        if not {"modulus", "storage_modulus"} & found.keys() - needless:
            needless.add("modulus_uncertainty")
        return {name: one for name, one in found.items() if name not in needless}

    def taken(self, columns: Columns, given: Mapping[str, Any]) -> Collection[str]:
        """Return Poisson's ratio only where the deformation may be shear."""
        axial = given[DEFORMATION.name] == "axial"
        return {DEFORMATION.name} if axial else {DEFORMATION.name, POISSON_RATIO.name}

    def lines(self, test: Description) -> list[str]:
        """Return the kind of deformation and the columns."""
        values, columns = test.values, test.columns
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
        lines += _attenuation_lines(test)
        lines += column_lines(test, "limit")
        lines += column_lines(test, "modulus")
        if "storage_modulus" in columns:
            comment = "|M| follows with tan delta"
            lines.append(line("storage_modulus_column", columns["storage_modulus"].column, comment))
            lines.append(line("modulus_unit", columns["storage_modulus"].unit))
        lines += column_lines(test, "modulus_uncertainty")
        return lines


def _attenuation_lines(test: Description) -> list[str]:
    """Return the columns of the attenuation and of its error, or of the loss modulus."""
    attenuation = test.columns.get("attenuation")
    no_error = optional("attenuation_uncertainty = 1e-3", "of tan delta itself")
    if attenuation is None:
        loss = line("loss_modulus_column", test.columns["loss_modulus"].column, "in modulus_unit")
        return [loss, no_error]
    is_logarithm = bool((attenuation.numbers < 0).any()) or LOGARITHM.search(
        attenuation.name.lower()
    )
    form = "log10_tan_delta" if is_logarithm else "tan_delta"
    if attenuation.unit is not None:
        form = "loss_angle"
    lines = [
        line("attenuation_column", attenuation.column),
        line("attenuation_form", form, "tan_delta (1/Q is the same), log10_tan_delta, loss_angle"),
    ]
    if attenuation.unit is not None:
        lines.append(line("attenuation_unit", attenuation.unit, f"of {units_text('angle')}"))
    return [*lines, *(column_lines(test, "attenuation_uncertainty") or [no_error])]


NEW_FILE = AttenuationFile()

"""What `pyburgers new` writes for a table of attenuation."""

from collections.abc import Collection, Mapping
from typing import Any

from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.attenuation.table import Form
from pyburgers.kinds.column_names import deformation_in, plain
from pyburgers.kinds.guessed_columns import GuessedColumn
from pyburgers.kinds.new_file import LAYOUT, Columns, Description, NewFile, Question

DEFORMATION = Question("deformation", "deformation", choices=("axial", "shear"), example="shear")
POISSON_RATIO = Question("poisson_ratio", "Poisson's ratio", float, default=0.25)


TEMPLATE = f"""
[attenuation]
deformation = {{deformation}}  # axial or shear: of modulus and stresses
poisson_ratio = {{poisson_ratio}}  # or bulk_modulus_Pa
#? median_stress_Pa = 1e6  # of every row
#? amplitude_Pa = 1e6  # of every row

[data]
file = {{file}}
{LAYOUT}\
period_column = {{period_column}}
period_unit = {{period_unit}}
frequency_column = {{frequency_column}}
frequency_unit = {{frequency_unit}}
temperature_column = {{temperature_column}}
temperature_unit = {{temperature_unit}}
median_stress_column = {{median_stress_column}}
amplitude_column = {{amplitude_column}}
stress_unit = {{stress_unit}}
loss_modulus_column = {{loss_modulus_column}}  # in modulus_unit
attenuation_column = {{attenuation_column}}
attenuation_form = {{attenuation_form}}  # tan_delta (1/Q is the same), log10_tan_delta, loss_angle
attenuation_unit = {{attenuation_unit}}
attenuation_uncertainty_column = {{attenuation_uncertainty_column}}
#? attenuation_uncertainty = 1e-3  # of tan delta, or of the angle
limit_column = {{limit_column}}
modulus_column = {{modulus_column}}
storage_modulus_column = {{storage_modulus_column}}  # |M| follows with tan delta
modulus_unit = {{modulus_unit}}
modulus_uncertainty_column = {{modulus_uncertainty_column}}
"""


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
    template = TEMPLATE

    def recognise(self, columns: Columns) -> str | None:
        """Return that attenuation is read, or periods of no stress or strain."""
        has_periods = not {"period", "frequency"}.isdisjoint(columns)
        is_no_curve = {"strain", "stress"}.isdisjoint(columns)
        if "attenuation" in columns and (has_periods or is_no_curve):
            return "there is a column of attenuation"
        if {"storage_modulus", "loss_modulus"} <= columns.keys() and (has_periods or is_no_curve):
            return "there are a storage and a loss modulus"
        return "there are periods or frequencies alone" if has_periods and is_no_curve else None

    def select_columns(self, columns: Columns) -> Columns:
        """Return quantities once: the period goes first, tan delta before moduli, |M| before M'."""
        found = super().select_columns(columns)
        attenuation = found.get("attenuation")
        needless = {"frequency"} if "period" in found else set()
        is_unread = attenuation is None or attenuation.is_foreign
        if is_unread and {"storage_modulus", "loss_modulus"} <= found.keys():
            needless |= {"attenuation", "attenuation_uncertainty", "modulus", "modulus_uncertainty"}
        else:
            needless |= {"loss_modulus"} | ({"storage_modulus"} if "modulus" in found else set())
        if attenuation is not None and attenuation.unit is not None:
            error = found.get("attenuation_uncertainty", attenuation)
            if error.unit != attenuation.unit:
                needless.add("attenuation_uncertainty")
        if not {"modulus", "storage_modulus"} & found.keys() - needless:
            needless.add("modulus_uncertainty")
        return {name: one for name, one in found.items() if name not in needless}

    def propose_answers(self, columns: Columns, given: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the deformation that the name of a modulus states."""
        moduli = (plain(one.name) for name, one in columns.items() if name.endswith("modulus"))
        stated = next(filter(None, map(deformation_in, moduli)), None)
        return {} if stated is None else {DEFORMATION.name: stated}

    def allowed_answers(self, columns: Columns, given: Mapping[str, Any]) -> Collection[str]:
        """Return Poisson's ratio only where the deformation may be shear."""
        axial = given[DEFORMATION.name] == "axial"
        return {DEFORMATION.name} if axial else {DEFORMATION.name, POISSON_RATIO.name}

    def filling(self, test: Description) -> Mapping[str, object]:
        """Return the units that columns share, and in which form attenuation is read."""
        columns = test.columns
        attenuation = columns.get("attenuation")
        units = {name: one.unit for name, one in columns.items()}
        return {
            "stress_unit": units.get("amplitude", units.get("median_stress")),
            "modulus_unit": units.get("modulus", units.get("storage_modulus")),
            "attenuation_form": None if attenuation is None else _form_of(attenuation),
        }


def _form_of(attenuation: GuessedColumn) -> Form:
    if attenuation.unit is not None:
        return "loss_angle"
    return "log10_tan_delta" if attenuation.is_logarithm else "tan_delta"


NEW_FILE = AttenuationFile()

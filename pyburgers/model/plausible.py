"""Numbers that tests of a material are likely to have, as its shipped prior file states them."""

from functools import cache
from typing import Self

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from pyburgers.common.paths import shipped_folder
from pyburgers.common.toml_files import Table, checked, read_tables


class PlausibleRanges(Table):
    """The table [plausible] of a material: beyond it numbers of tests are doubted, not refused."""

    least_temperature_K: float | None = Field(  # noqa: N815 - a key with its unit
        None, gt=0, description="the temperature in kelvin below which tests are unlikely"
    )
    melting_temperature_K: float | None = Field(  # noqa: N815
        None, gt=0, description="the temperature in kelvin from which the material is molten"
    )
    largest_stress_MPa: float = Field(  # noqa: N815
        2e4, gt=0, description="the stress in MPa beyond which tests are unlikely"
    )

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        least, melting = self.least_temperature_K, self.melting_temperature_K
        if least is not None and melting is not None and least >= melting:
            raise PydanticCustomError(
                "order",
                f"least_temperature_K ({least:g}) below melting_temperature_K ({melting:g})",
            )
        return self


@cache
def plausible_ranges(material: str) -> PlausibleRanges | None:
    """Return what the shipped priors of a material say of its tests; None where there are none."""
    files = {one.stem: one for one in (shipped_folder("data") / "priors").glob("*.toml")}
    path = files.get(material)
    if path is None:
        return None
    return checked(path, read_tables(path).get("plausible", {}), PlausibleRanges)

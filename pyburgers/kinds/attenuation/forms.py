"""Forms in which tables state tan(delta) and the modulus: logarithms, angles, storage and loss."""

from typing import Literal

import numpy as np

from pyburgers.common.errors import InputError
from pyburgers.kinds.attenuation.table import FloatArray, check_sign

Form = Literal["tan_delta", "log10_tan_delta", "loss_angle"]


def tan_delta_of(form: Form, values: FloatArray, radian: float, where: str) -> FloatArray:
    """Return tan(delta) of readings in a form.

    `values` (n_rows,): the readings. `radian`: unit of a loss angle in rad. Raise InputError if an
    angle reaches 90 degrees, or a logarithm is too large.
    """
    if form == "tan_delta":
        return values
    if form == "log10_tan_delta":
        with np.errstate(over="ignore"):
            tan_delta: FloatArray = 10**values
        if np.isinf(tan_delta).any():
            raise InputError(
                f"{where}: found logarithms beyond 308, expected those of tan delta to the base 10."
            )
        return tan_delta
    angle = radian * values
    if np.any(np.abs(angle) >= np.pi / 2):
        raise InputError(
            f"{where}: found an angle of {np.degrees(np.abs(angle).max()):g} degrees, expected "
            "less than 90; check 'attenuation_unit'."
        )
    return np.asarray(np.tan(angle))


def loss_of(storage: FloatArray, loss: FloatArray, source: str) -> FloatArray:
    """Return tan(delta) of a storage and a loss modulus in one unit, shape (n_rows,).

    Raise InputError if a storage modulus is not positive.
    """
    check_sign(storage > 0, storage, source, "storage modulus", "a positive number")
    return loss / storage

"""Changes with temperature, against numbers worked out by hand."""

import numpy as np

from pyburgers.model.arrhenius import log_slowdown


def test_a_colder_material_is_slower_by_its_enthalpy() -> None:
    # 60 kJ/mol from 263 to 253 K: 7216.2 K (1/253 - 1/263)/K = 1.0845.
    np.testing.assert_allclose(log_slowdown(60e3, 253.0, 263.0), 1.0845, rtol=1e-4)


def test_the_way_back_is_as_far() -> None:
    enthalpy, temperature = np.array([0.0, 60e3, 530e3]), np.array([[250.0], [1573.0]])
    there = log_slowdown(enthalpy, temperature, 273.0)
    assert there.shape == (2, 3)
    np.testing.assert_allclose(there, -log_slowdown(enthalpy, 273.0, temperature), rtol=1e-12)
    assert (there[:, 0] == 0.0).all()

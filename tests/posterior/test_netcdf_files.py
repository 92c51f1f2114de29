"""Our netCDF files hold what xarray reads from them, and what xarray writes is read."""

from pathlib import Path

import h5netcdf
import numpy as np
import pytest
import xarray as xr

from pyburgers.fitting.fit import Fit
from pyburgers.posterior.netcdf_files import NO_VARIABLE, read_netcdf, to_netcdf


def made_up() -> xr.DataTree:
    """All that trees of draws have: groups in groups, every type, coordinates of all kinds."""
    draws = xr.Dataset(
        {
            "stress": (("chain", "draw"), np.array([[1.5, np.nan], [2.5, -np.inf]])),
            "diverging": (("chain", "draw"), np.array([[True, False], [False, False]])),
            "single": (("chain",), np.array([0.1, 0.2], dtype=np.float32)),
            "nothing": (("none",), np.empty(0)),
            "density": ((), np.float64(3.0)),
        },
        {
            "chain": [1, 2],
            "label": ("chain", np.array(["σ one", "two"])),
            "position": ("draw", np.array([0.1, 0.7])),
        },
        {"units": "Pa s", "extensions": 3, "factor": 0.5},
    )
    draws["stress"].attrs = {"symbol": "η_K", "fixed": 1}
    points = xr.Dataset({"quantity": ("section", np.array(["size", "factor"]))})
    return xr.DataTree.from_dict(
        {"/": xr.Dataset(attrs={"id": "PIL40"}), "posterior": draws, "tests/A/data": points}
    )


def by_xarray(file: Path) -> xr.DataTree:
    with xr.open_datatree(file, engine="h5netcdf") as opened:
        return opened.load()


@pytest.fixture(params=["made up", "fit"])
def tree(request: pytest.FixtureRequest) -> xr.DataTree:
    if request.param == "made up":
        return made_up()
    fit: Fit = request.getfixturevalue("small_fit")
    return fit.posterior


def test_xarray_reads_the_same_and_so_do_we(tree: xr.DataTree, tmp_path: Path) -> None:
    file = tmp_path / "draws.nc"
    file.write_bytes(to_netcdf(tree))
    for found in (by_xarray(file), read_netcdf(file)):
        xr.testing.assert_identical(found, tree)
        for node in tree.subtree:
            types = {name: one.dtype.kind for name, one in node.variables.items()}
            same = found[node.path].variables
            assert {name: one.dtype.kind for name, one in same.items()} == types


def test_what_xarray_writes_is_read(tree: xr.DataTree, tmp_path: Path) -> None:
    file = tmp_path / "draws.nc"
    tree.to_netcdf(file, engine="h5netcdf")
    xr.testing.assert_identical(read_netcdf(file), by_xarray(file))


def test_dimensions_are_those_of_the_format(tmp_path: Path) -> None:
    """Each once in its group, with its size, whether or not a coordinate goes with it."""
    file = tmp_path / "draws.nc"
    file.write_bytes(to_netcdf(made_up()))
    with h5netcdf.File(file, "r") as opened:
        group = opened["posterior"]
        sizes = {name: one.size for name, one in group.dimensions.items()}
        assert sizes == {"chain": 2, "draw": 2, "none": 0}
        assert group["stress"].dimensions == ("chain", "draw")
        assert group["chain"].attrs.get("NAME") != NO_VARIABLE
        assert set(group.variables) == set(made_up()["posterior"].variables)


def test_another_file_is_no_tree(tmp_path: Path) -> None:
    (tmp_path / "draws.nc").write_text("chain,draw\n", encoding="utf-8")
    with pytest.raises(OSError, match="file signature"):
        read_netcdf(tmp_path / "draws.nc")

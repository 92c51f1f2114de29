"""netCDF files: what is written is read again, in threads and where disks are full."""

import errno
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from pyburgers.common import atomic_files
from pyburgers.common.netcdf_files import read_netcdf, write_netcdf

DRAWS = xr.Dataset(
    {
        "modulus": (("chain", "draw"), np.arange(6.0).reshape(2, 3), {"units": "Pa"}),
        "diverging": (("chain", "draw"), np.zeros((2, 3), bool)),
    },
    coords={"draw": [0, 1, 2], "point": ["first", "an η"]},
)
TREE = xr.DataTree.from_dict({"/": xr.Dataset(attrs={"id": "α"}), "posterior": DRAWS})


def test_a_tree_comes_back_as_it_was(tmp_path: Path) -> None:
    write_netcdf(tmp_path / "draws.nc", TREE)
    xr.testing.assert_identical(read_netcdf(tmp_path / "draws.nc"), TREE)


def test_other_libraries_read_it(tmp_path: Path) -> None:
    write_netcdf(tmp_path / "draws.nc", xr.DataTree(DRAWS))
    with xr.open_dataset(tmp_path / "draws.nc", engine="h5netcdf") as opened:
        xr.testing.assert_identical(opened.load(), DRAWS)


def test_threads_do_not_meet_in_the_library(tmp_path: Path) -> None:
    """Without a lock the process ends with a segmentation fault."""

    def back_and_forth(number: int) -> bool:
        file = tmp_path / f"{number}.nc"
        for _ in range(20):
            write_netcdf(file, TREE)
            if not read_netcdf(file).identical(TREE):
                return False
        return True

    with ThreadPoolExecutor(6) as threads:
        assert all(threads.map(back_and_forth, range(6)))


def test_a_full_disk_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setattr(atomic_files, "flush_to_disk", full)
    with pytest.raises(OSError, match="No space left"):
        write_netcdf(tmp_path / "draws.nc", TREE)
    assert list(tmp_path.iterdir()) == []

"""netCDF files of labelled arrays: written whole or not at all, one at a time."""

from collections.abc import Mapping
from pathlib import Path
from threading import Lock
from typing import Any, Final

import xarray as xr

from pyburgers.common.atomic_files import write_bytes

_ENGINE: Final = "netcdf4"
"""Files of draws have many small variables, which h5netcdf takes five times as long for."""

_ONE_AT_A_TIME = Lock()
"""netCDF's library brings the process down where two threads are in it, even in different files."""


def write_netcdf(
    path: Path, tree: xr.DataTree, encoding: Mapping[str, Mapping[Any, Any]] | None = None
) -> None:
    """Write labelled arrays to `path` in one step; `encoding` of variables is by group and name."""
    # In memory first: where the disk is full, HDF5 brings the process down.
    with _ONE_AT_A_TIME:
        written = bytes(tree.to_netcdf(engine=_ENGINE, encoding=encoding))
    write_bytes(path, written)


def read_netcdf(source: Path | bytes) -> xr.DataTree:
    """Read all groups of a file, or of what it holds, into memory."""
    # A path is opened here: xarray has rules of its own for names that begin with "~".
    content = source if isinstance(source, bytes) else source.read_bytes()
    with _ONE_AT_A_TIME, xr.open_datatree(content, engine=_ENGINE) as opened:
        return opened.load()

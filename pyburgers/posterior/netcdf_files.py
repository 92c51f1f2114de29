"""Trees of labelled draws <-> netCDF-4 files.

h5netcdf takes 0.3 s to write or read the 60 small variables of a fit, h5py a small part of that.
What is written is what the netCDF-4 format asks of HDF5: dimensions are scales, attached to the
variables that have them. Missing numbers and times are not known here.
"""

import io
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr

NO_VARIABLE = "This is a netCDF dimension but not a netCDF variable."
"""What the format calls the scale of a dimension without coordinate."""

STORED_AS = "dtype"
"""Attribute of booleans, stored as bytes, as xarray has it."""

COORDINATES = "coordinates"
"""Attribute of a group: names of the coordinates that are no dimensions, as CF has it."""

OF_FORMAT = frozenset(
    {
        *("CLASS", "NAME", "REFERENCE_LIST", "DIMENSION_LIST", "DIMENSION_LABELS"),
        *("_Netcdf4Dimid", "_Netcdf4Coordinates", "_NCProperties", "_FillValue"),
        *(STORED_AS, COORDINATES),
    }
)
"""Attributes that are not those of the user."""


def to_netcdf(tree: xr.DataTree) -> bytes:
    """Return the content of a netCDF-4 file.

    Parameters
    ----------
    tree : DataTree
        Of numbers, booleans and strings; attributes are numbers and strings.
    """
    content = io.BytesIO()
    with h5py.File(content, "w", track_order=True) as file:
        for node in tree.subtree:
            group = file if node.path == "/" else file.create_group(node.path, track_order=True)
            _write(group, node.to_dataset(inherit=False))
    return content.getvalue()


def _write(group: h5py.Group, dataset: xr.Dataset) -> None:
    """Write variables and attributes of one group."""
    scales = {}
    for dimension, size in dataset.sizes.items():
        name = str(dimension)
        if name in dataset.variables:
            scales[name] = _write_variable(group, name, dataset.variables[name])
            scales[name].make_scale(name)
        else:
            scales[name] = group.create_dataset(name, shape=(size,), dtype=">f4")
            scales[name].make_scale(f"{NO_VARIABLE}{size:10}")
    for key, variable in dataset.variables.items():
        if key not in scales:
            written = _write_variable(group, str(key), variable)
            for axis, dimension in enumerate(variable.dims):
                written.dims[axis].attach_scale(scales[str(dimension)])
    _write_attributes(group, dataset.attrs)
    others = [str(name) for name in dataset.coords if name not in dataset.sizes]
    if others:
        group.attrs[COORDINATES] = " ".join(others)


def _write_variable(group: h5py.Group, name: str, variable: xr.Variable) -> h5py.Dataset:
    values = variable.to_numpy()
    if values.dtype.kind in "OUT":
        text = values.astype(object)
        written = group.create_dataset(name, data=text, dtype=h5py.string_dtype())
    elif values.dtype.kind == "b":
        written = group.create_dataset(name, data=values.astype(np.int8))
        written.attrs[STORED_AS] = "bool"
    else:
        written = group.create_dataset(name, data=values)
    _write_attributes(written, variable.attrs)
    return written


def _write_attributes(item: h5py.Group | h5py.Dataset, attributes: Mapping[Any, Any]) -> None:
    for name, value in attributes.items():
        item.attrs[name] = value if isinstance(value, str) else np.atleast_1d(value)


def read_netcdf(path: Path) -> xr.DataTree:
    """Read what `to_netcdf` wrote, or xarray of such a tree.

    Raises
    ------
    OSError
        If it is no such file, or was damaged.
    """
    with h5py.File(path, "r") as file:
        return xr.DataTree.from_dict({group.name: _read(group) for group in _groups(file)})


def _groups(group: h5py.Group) -> Iterator[h5py.Group]:
    """Yield a group and those in it."""
    yield group
    for item in group.values():
        if isinstance(item, h5py.Group):
            yield from _groups(item)


def _read(group: h5py.Group) -> xr.Dataset:
    """Read variables and attributes of one group."""
    variables = {}
    coordinates = set(_text(group.attrs.get(COORDINATES, "")).split())
    for name, item in group.items():
        if isinstance(item, h5py.Group) or _text(item.attrs.get("NAME", "")).startswith(
            NO_VARIABLE
        ):
            continue
        if item.is_scale:
            dimensions = (name,)
        else:
            dimensions = tuple(axis[0].name.rpartition("/")[2] for axis in item.dims)
        coordinates |= set(_text(item.attrs.get(COORDINATES, "")).split())
        variables[name] = xr.Variable(dimensions, _values(item), _attributes(item))
    return xr.Dataset(variables, attrs=_attributes(group)).set_coords(coordinates)


def _values(item: h5py.Dataset) -> np.ndarray[Any, Any]:
    if h5py.check_string_dtype(item.dtype):
        return np.asarray(item.asstr()[...]).astype(str)
    values = np.asarray(item[...])
    return values.astype(bool) if item.attrs.get(STORED_AS) == "bool" else values


def _attributes(item: h5py.Group | h5py.Dataset) -> dict[str, Any]:
    """Return the user's attributes; one of a single number is an array in the file."""
    found = {name: item.attrs[name] for name in item.attrs if name not in OF_FORMAT}
    return {
        name: value[0] if isinstance(value, np.ndarray) and value.size == 1 else value
        for name, value in found.items()
    }


def _text(value: str | bytes) -> str:
    """Names of scales may be bytes."""
    return value.decode() if isinstance(value, bytes) else value

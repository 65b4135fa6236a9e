"""MATLAB's variables, as `read_mat` has them -> the fields of a shape, as arrays."""

from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from jfsf.apps.mapfiles import MapFileError

Fields = dict[str, Any]


def shape_fields(path: Path, variables: Fields, key: str | None) -> tuple[str, Fields]:
    """What messages call the shape of a file, and its fields by name.

    Args:
        path: the file.
        variables: what is in it.
        key: the struct to take; None takes the variables themselves, or the only struct
            that holds a surface.

    Raises:
        MapFileError: there is no such struct, or there are several.
    """
    structs = {name: struct(value) for name, value in variables.items()}
    shapes = {
        name: s for name, s in structs.items() if s and {"surface", "TRIV"} & {*s}
    }
    if key is None:
        if "TRIV" in variables or "surface" in shapes:
            return str(path), variables
        if len(shapes) == 1:
            ((name, fields),) = shapes.items()
            return f"{path}[{name}]", fields
    elif key in shapes:
        return f"{path}[{key}]", shapes[key]
    wanted = "one surface" if key is None else f"a shape {key!r}"
    several = f"; pass one of {', '.join(sorted(shapes))} as `key`" if shapes else ""
    names = ", ".join(sorted(variables)) or "no variable"
    raise MapFileError(f"{path}: does not hold {wanted}, but {names}{several}")


def struct(value: Any) -> Fields | None:
    """The fields of a struct, by name; None if the value is something else."""
    return value if isinstance(value, dict) else None


def matrix(where: str, fields: Fields, name: str) -> np.ndarray:
    """A field as a matrix, float64.

    Raises:
        MapFileError: there is none, or it is no full matrix of real numbers.
    """
    value = _field(where, fields, name)
    if sp.issparse(value):
        raise MapFileError(f"{where}: {name} is sparse; save full({name})")
    return np.array(value, np.float64, order="C")


def diagonal(where: str, fields: Fields, name: str) -> np.ndarray:
    """A field that is a vector or a diagonal matrix, as a vector, float64.

    Raises:
        MapFileError: there is none, it does not hold real numbers, or it has some
            beside its diagonal.
    """
    value = _field(where, fields, name)
    if not sp.issparse(value) and 1 in value.shape:
        return matrix(where, fields, name).ravel()
    entries = value.diagonal()
    square = value.shape[0] == value.shape[1]
    if not square or abs(value - sp.diags_array(entries)).max() > 0:
        raise MapFileError(
            f"{where}: {name} {value.shape} is not diagonal; save a diagonal matrix "
            "or a full vector (lumped areas)"
        )
    return entries.astype(np.float64)


def _field(where, fields, name) -> Any:
    """A field that is a matrix of numbers, full or sparse."""
    if name not in fields:
        names = ", ".join(sorted(fields))
        raise MapFileError(f"{where}: lacks {name}; it holds {names}")
    value = fields[name]
    kind = getattr(getattr(value, "dtype", None), "kind", "O")
    if kind not in "fiu" or value.ndim != 2:
        raise MapFileError(f"{where}: {name} is no matrix of real numbers")
    return value

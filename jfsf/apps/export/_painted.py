"""What a file has beside the shape: colours, texture coordinates, other values."""

import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from jfsf.mesh._values import checked_mesh
from jfsf.types import ArrayLike, Mesh


class Painted(NamedTuple):
    """A mesh with what there is a vertex, checked.

    vertices: (n, 3) float64.
    faces: (m, 3) int32.
    colours: (n, 3) sRGB in [0, 1], or None.
    uv: (n, 2), u to the right and v up, the texture repeats at whole numbers; or None.
    values: (n,) each, by name, such as the confidence.
    """

    vertices: np.ndarray
    faces: np.ndarray
    colours: np.ndarray | None
    uv: np.ndarray | None
    values: Mapping[str, np.ndarray]


NAME = re.compile("[a-z][a-z_]*")
# Those of a vertex that mean something else.
TAKEN = set("x y z nx ny nz xyz red green blue alpha rgb".split())


def painted(
    mesh: Mesh,
    colours: ArrayLike | None,
    uv: ArrayLike | None,
    values: Mapping[str, ArrayLike] | None,
) -> Painted:
    """Check a mesh and what is painted on it.

    Raises:
        ValueError: these are not one row for each vertex, or not finite, or colours are
            outside [0, 1]; texture coordinates without faces; a value of another name
            than `NAME`, or of a `TAKEN` one.
        MeshError: no mesh.
    """
    vertices, faces = checked_mesh(mesh, "export_mesh")
    n = len(vertices)
    if colours is not None:
        colours = _rows("colours", colours, (n, 3))
        if colours.min() < 0 or colours.max() > 1:
            raise ValueError(
                f"export_mesh: colours run from {colours.min():g} to "
                f"{colours.max():g}; pass sRGB in [0, 1]"
            )
    if uv is not None:
        uv = _rows("uv", uv, (n, 2))
        if not len(faces):
            raise ValueError("export_mesh: a point cloud has no texture; leave out uv")
    values = dict(values or {})
    for name in values:
        if not NAME.fullmatch(name) or name in TAKEN:
            raise ValueError(
                f"export_mesh: a value is named {name!r}; take another name, of the "
                "letters a to z and _"
            )
    rows = {name: _rows(name, row, (n,)) for name, row in values.items()}
    faces = faces.astype(np.int32)
    return Painted(vertices.astype(np.float64), faces, colours, uv, rows)


def _rows(name, values, shape):
    values = np.asarray(values, float)
    if values.shape != shape:
        raise ValueError(
            f"export_mesh: {name} has shape {values.shape}; pass one row a vertex: "
            f"{shape}"
        )
    if not np.isfinite(values).all():
        at = int(np.argmin(np.isfinite(values).reshape(len(values), -1).all(1)))
        raise ValueError(
            f"export_mesh: {name} at vertex {at}: {values[at]}; pass finite numbers"
        )
    return values

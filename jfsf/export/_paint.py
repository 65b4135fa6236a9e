"""What a file shows beside the shape: colours and texture coordinates of vertices."""

from typing import NamedTuple

import numpy as np

from jfsf.mesh import checked_mesh
from jfsf.types import ArrayLike, Mesh


class Painted(NamedTuple):
    """A mesh with colours and texture coordinates of its vertices, checked.

    vertices: (n, 3) float64.
    faces: (m, 3) int32.
    colours: (n, 3) sRGB in [0, 1], or None.
    uv: (n, 2), u to the right and v up, the texture repeats at whole numbers; or None.
    """

    vertices: np.ndarray
    faces: np.ndarray
    colours: np.ndarray | None
    uv: np.ndarray | None


def painted(mesh: Mesh, colours: ArrayLike | None, uv: ArrayLike | None) -> Painted:
    """Check a mesh and what is painted on it.

    Raises:
        ValueError: these are not one row a vertex, or not finite, or colours are
            outside [0, 1]; texture coordinates without faces.
        MeshError: no mesh.
    """
    vertices, faces = checked_mesh(mesh, "export_mesh")
    n = len(vertices)
    if colours is not None:
        colours = _rows("colours", colours, n, 3)
        if colours.min() < 0 or colours.max() > 1:
            raise ValueError(
                f"export_mesh: colours run from {colours.min():g} to "
                f"{colours.max():g}; pass sRGB in [0, 1]"
            )
    if uv is not None:
        uv = _rows("uv", uv, n, 2)
        if not len(faces):
            raise ValueError("export_mesh: a point cloud has no texture; leave out uv")
    return Painted(vertices.astype(np.float64), faces.astype(np.int32), colours, uv)


def _rows(name, values, n, width):
    values = np.asarray(values, float)
    if values.shape != (n, width) or not np.isfinite(values).all():
        raise ValueError(
            f"export_mesh: {name} has shape {values.shape}; pass finite rows, one a "
            f"vertex: {(n, width)}"
        )
    return values

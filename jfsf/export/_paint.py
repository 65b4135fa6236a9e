"""What a file has beside the shape: colours, texture coordinates, a confidence."""

from typing import NamedTuple

import numpy as np

from jfsf.mesh import checked_mesh
from jfsf.types import ArrayLike, Mesh


class Painted(NamedTuple):
    """A mesh with what there is a vertex, checked.

    vertices: (n, 3) float64.
    faces: (m, 3) int32.
    colours: (n, 3) sRGB in [0, 1], or None.
    uv: (n, 2), u to the right and v up, the texture repeats at whole numbers; or None.
    confidence: (n,) in [0, 1], or None.
    """

    vertices: np.ndarray
    faces: np.ndarray
    colours: np.ndarray | None
    uv: np.ndarray | None
    confidence: np.ndarray | None = None


def painted(
    mesh: Mesh,
    colours: ArrayLike | None,
    uv: ArrayLike | None,
    confidence: ArrayLike | None = None,
) -> Painted:
    """Check a mesh and what is painted on it.

    Raises:
        ValueError: these are not one row a vertex, or not finite, or colours or the
            confidence are outside [0, 1]; texture coordinates without faces.
        MeshError: no mesh.
    """
    vertices, faces = checked_mesh(mesh, "export_mesh")
    n = len(vertices)
    if colours is not None:
        colours = _rows("colours", colours, (n, 3))
        _check_range("colours", colours, "sRGB")
    if uv is not None:
        uv = _rows("uv", uv, (n, 2))
        if not len(faces):
            raise ValueError("export_mesh: a point cloud has no texture; leave out uv")
    if confidence is not None:
        confidence = _rows("confidence", confidence, (n,))
        _check_range("confidence", confidence, "probabilities")
    faces = faces.astype(np.int32)
    return Painted(vertices.astype(np.float64), faces, colours, uv, confidence)


def _rows(name, values, shape):
    values = np.asarray(values, float)
    if values.shape != shape or not np.isfinite(values).all():
        raise ValueError(
            f"export_mesh: {name} has shape {values.shape}; pass finite rows, one a "
            f"vertex: {shape}"
        )
    return values


def _check_range(name, values, kind):
    if values.min() < 0 or values.max() > 1:
        raise ValueError(
            f"export_mesh: {name} run from {values.min():g} to {values.max():g}; pass "
            f"{kind} in [0, 1]"
        )

"""meshio's meshes <-> `Mesh`; vertex i stays vertex i."""

from typing import TYPE_CHECKING

import numpy as np

from jfsf.apps.interop._packages import need
from jfsf.mesh import MeshError
from jfsf.mesh._polygons import triangulate
from jfsf.mesh._values import check_values, checked_mesh
from jfsf.types import Mesh

if TYPE_CHECKING:
    import meshio

_FLAT = ("triangle", "quad", "polygon")
_LOWER = ("vertex", "line")


def to_meshio(mesh: Mesh) -> "meshio.Mesh":
    """A meshio.Mesh of one block of triangles; of a point cloud, one of vertices.

    Raises:
        ImportError: meshio is missing; the message says how to install it.
        MeshError: no mesh.
    """
    meshio = need("meshio", "meshio")
    vertices, faces = checked_mesh(mesh, "to_meshio")
    points = np.arange(len(vertices), dtype=np.int32)[:, None]
    cells = [("triangle", faces)] if len(faces) else [("vertex", points)]
    return meshio.Mesh(vertices, cells)


def from_meshio(mesh: "meshio.Mesh") -> Mesh:
    """The points and the triangles of a meshio.Mesh, copied; its data are dropped.

    Blocks keep their order, and quads and polygons become triangles in their place.
    Vertex and line cells are left out.

    Raises:
        MeshError: other cells, such as tetrahedra or curved triangles; points that are
            not finite (n, 3); or a cell with a vertex out of range.
    """
    blocks = [np.zeros((0, 3), np.int64)]
    for block in mesh.cells:
        # meshio names polygons by their size too: polygon5.
        if block.type.rstrip("0123456789") == "polygon" or block.type in _FLAT:
            sizes = [len(cell) for cell in block.data]
            corners = np.concatenate([np.zeros(0, np.int64), *block.data])
            blocks.append(triangulate(sizes, corners, mesh.points))
        elif block.type not in _LOWER:
            raise MeshError(
                f"from_meshio: holds cells of type {block.type!r}; pass a surface of "
                f"{', '.join(_FLAT)}"
            )
    faces = np.concatenate(blocks)
    vertices = np.array(mesh.points, np.float64)
    check_values(vertices, faces, "from_meshio")
    return Mesh(vertices, faces.astype(np.int32))

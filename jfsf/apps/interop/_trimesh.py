"""trimesh's meshes and point clouds <-> `Mesh`; vertex i stays vertex i."""

from typing import TYPE_CHECKING, Union

import numpy as np

from jfsf.mesh._values import check_values, checked_mesh
from jfsf.types import Mesh

if TYPE_CHECKING:
    import trimesh


def to_trimesh(mesh: Mesh) -> Union["trimesh.Trimesh", "trimesh.PointCloud"]:
    """A Trimesh, or a PointCloud of a mesh without faces, with all vertices and faces.

    It is made with `process=False`: by default trimesh merges equal vertices and drops
    those that no face uses, which renumbers the others.

    Raises:
        MeshError: no mesh.
    """
    import trimesh  # slow to import

    vertices, faces = checked_mesh(mesh, "to_trimesh")
    if not len(faces):
        return trimesh.PointCloud(vertices)
    return trimesh.Trimesh(vertices, faces, process=False, validate=False)


def from_trimesh(mesh: Union["trimesh.Trimesh", "trimesh.PointCloud"]) -> Mesh:
    """The vertices and faces of a Trimesh or PointCloud, copied.

    They are numbered as in the object. trimesh's own loader may have merged and
    reordered those of a file (`process=True` is its default, and seams split vertices):
    `jfsf.read` keeps the file's order.

    Raises:
        ValueError: something else, such as a Scene or a Path.
        MeshError: no vertices, or some that are not finite.
    """
    import trimesh

    if not isinstance(mesh, trimesh.Trimesh | trimesh.PointCloud):
        hint = ""
        if isinstance(mesh, trimesh.Scene):
            hint = f"; pass one of its geometry: {', '.join(mesh.geometry)}"
        raise ValueError(
            f"from_trimesh: got {type(mesh).__name__}, expected a Trimesh or a "
            f"PointCloud{hint}"
        )
    faces = getattr(mesh, "faces", np.zeros((0, 3), np.int32))
    found = Mesh(np.array(mesh.vertices, np.float64), np.array(faces, np.int32))
    check_values(*found, "from_trimesh")
    return found

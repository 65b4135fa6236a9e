"""path -> Mesh, and whether a mesh can be matched. Host side (numpy)."""

import os
from pathlib import Path

import numpy as np

from jfsf.mesh_check import Report, check, face_areas, vertex_components
from jfsf.mesh_edit import Submesh, largest_component, orient, weld
from jfsf.mesh_formats import parse_gltf, parse_obj, parse_off, parse_stl
from jfsf.mesh_ply import parse_ply
from jfsf.mesh_values import MeshError, check_values
from jfsf.types import Mesh

__all__ = [
    "MeshError",
    "Report",
    "Submesh",
    "check",
    "largest_component",
    "orient",
    "read",
    "validate",
    "weld",
]

_PARSERS = {".off": parse_off, ".obj": parse_obj, ".ply": parse_ply, ".stl": parse_stl}
_SCENES = (".glb", ".gltf")

# Area over the squared size of the bounding box: below this, a surface is a line.
_FLAT = 1e-12


def read(path: str | os.PathLike[str]) -> Mesh:
    """Read an OFF, OBJ, PLY, STL, GLB or glTF file; vertex i stays vertex i.

    Polygons become fans of triangles in their place; colours, normals and the like are
    dropped. STL has no vertex numbers, so exactly equal points become one vertex there.

    Args:
        path: the suffix says the format. A file without faces is a point cloud.

    Returns:
        The mesh, as the file winds it: see `orient`, and `validate` before matching.

    Raises:
        MeshError: no such file, unknown or broken format, cut short, a face with fewer
            than three vertices or with one out of range, no or non-finite vertices.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if not path.is_file():
        what = "is a folder" if path.is_dir() else "does not exist"
        raise MeshError(f"{path}: {what}; pass the path of a mesh file")
    if suffix not in _PARSERS and suffix not in _SCENES:
        known = ", ".join((*_PARSERS, *_SCENES))
        raise MeshError(f"{path}: has format {suffix!r}; convert it to one of {known}")
    try:
        data = path.read_bytes()
        if not data.strip():
            raise MeshError(f"its {len(data)} bytes are empty; export the mesh again")
        parser = _PARSERS.get(suffix)
        mesh = parser(data) if parser else parse_gltf(path)
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from error
    except Exception as error:
        # Broken numbers, and whatever trimesh meets in a broken glTF.
        raise MeshError(
            f"{path}: not a readable {suffix[1:].upper()} file ({error}); "
            "export the mesh again"
        ) from error
    check_values(*mesh, str(path))
    return Mesh(mesh.vertices, mesh.faces.astype(np.int32))


def validate(
    mesh: Mesh, *, k: int | None = None, name: str = "mesh", components: bool = True
) -> None:
    """Raise MeshError on all that makes matching this mesh meaningless.

    Args:
        mesh: n vertices, m faces; without faces, only its points are looked at.
        k: eigenpairs wanted of it, at most n.
        name: opens the message: the file, or the argument.
        components: whether to refuse more than one connected piece.

    Raises:
        MeshError: wrong shapes or types, non-finite coordinates, indices out of range,
            fewer than k vertices, no extent, no area, unreferenced vertices, pieces.
    """
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    check_values(vertices, faces, name)
    n = len(vertices)
    if k is not None and n < k:
        raise MeshError(
            f"{name}: has {n} vertices, fewer than the {k} eigenpairs asked for; "
            "ask for fewer or subdivide the mesh"
        )
    # Centre and scale without overflow: only the shape matters here.
    low, high = vertices.min(axis=0) / 2, vertices.max(axis=0) / 2
    size = (high - low).max()
    if size == 0:
        raise MeshError(f"{name}: all {n} vertices coincide; choose another shape")
    if len(faces) == 0:
        return
    if face_areas((vertices - (low + high)) / size, faces).sum() <= _FLAT:
        raise MeshError(f"{name}: the area of its {len(faces)} faces is 0; repair it")
    loose = np.ones(n, bool)
    loose[faces] = False
    if loose.any():
        raise MeshError(
            f"{name}: vertex {np.argmax(loose)} and {loose.sum() - 1} others belong "
            "to no face; remove them, as largest_component does"
        )
    pieces = vertex_components(mesh).max() + 1
    if components and pieces > 1:
        raise MeshError(
            f"{name}: has {pieces} connected components; keep one with "
            "largest_component, or join seams of coincident vertices with weld"
        )

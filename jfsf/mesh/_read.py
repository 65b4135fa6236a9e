"""path -> Mesh: read a mesh file of any known format."""

import os
from pathlib import Path

import numpy as np

from jfsf.mesh._formats import parse_obj, parse_off, parse_stl
from jfsf.mesh._gltf import parse_gltf
from jfsf.mesh._ply import parse_ply
from jfsf.mesh._values import MeshError, check_values
from jfsf.types import Mesh

_PARSERS = {".off": parse_off, ".obj": parse_obj, ".ply": parse_ply, ".stl": parse_stl}
_SCENES = (".glb", ".gltf")
SUFFIXES = (*_PARSERS, *_SCENES)  # of files that can be read


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
    if suffix not in SUFFIXES:
        known = ", ".join(SUFFIXES)
        raise MeshError(f"{path}: has format {suffix!r}; convert it to one of {known}")
    try:
        data = path.read_bytes()
        if not data.strip():
            raise MeshError(f"its {len(data)} bytes are empty; export the mesh again")
        parser = _PARSERS.get(suffix)
        # numpy warns of nan and overflow where `check_values` says which vertex it is.
        with np.errstate(all="ignore"):
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

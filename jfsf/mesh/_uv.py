"""path -> the texture coordinates of a mesh file, for each corner of its triangles.

A vertex on a seam of the texture has other coordinates in each face, so they belong to
the corners.
"""

import os
from pathlib import Path
from typing import Any

import numpy as np

from jfsf.mesh._gltf import scene_parts
from jfsf.mesh._ply import CORNERS, ply_columns
from jfsf.mesh._read import contents, format_of
from jfsf.mesh._values import MeshError
from jfsf.types import ArrayLike, Mesh

# Names in use for those of a vertex of PLY, and of a face, of its corners in turn.
_OF_VERTEX = ("s", "t"), ("u", "v"), ("texture_u", "texture_v")
_OF_FACE = "texcoord"
FORMATS = "OBJ (vt), PLY (s and t, or texcoord) or glTF"


def read_uv(path: str | os.PathLike[str], mesh: Mesh) -> ArrayLike:
    """Texture coordinates of a file, for the triangles that `jfsf.mesh.read` makes.

    Args:
        path: OBJ, PLY, GLB or glTF.
        mesh: what `read` returned for this file; m triangles.

    Returns:
        (m, 3, 2) float64: u to the right and v up, of each corner; nan where the file
        has none.

    Raises:
        MeshError: a format without texture coordinates, a file that has none, or one
            where they do not fit the faces.
    """
    path = Path(path)
    readers = {".obj": _of_obj, ".ply": _of_ply, ".glb": _of_gltf, ".gltf": _of_gltf}
    reader = readers.get(format_of(path))
    if reader is None:
        raise MeshError(
            f"{path.suffix!r} holds no texture coordinates",
            f"they come from {FORMATS}",
            str(path),
        )
    faces = np.asarray(mesh.faces)
    try:
        uv = reader(contents(path), faces, path)
    except MeshError as error:
        raise error.named(str(path)) from None
    except Exception as error:
        # Broken numbers, and whatever trimesh meets in a broken glTF.
        raise MeshError(
            f"its texture coordinates cannot be read ({error})",
            "export it again",
            str(path),
        ) from error
    if not np.isfinite(uv).all(2).any():
        raise MeshError(
            f"has no texture coordinates for its {len(faces)} faces",
            f"export it with them, as {FORMATS}",
            str(path),
        )
    return uv


def _of_obj(data: bytes, faces, path):
    points, sizes, vertices, number, n = [], [], [], [], 0
    text = data.decode("ascii", "replace").replace("\r\n", "\n")
    for line in text.replace("\\\n", " ").splitlines():
        word, *rest = line.split("#", 1)[0].split() or [""]
        if word == "v":
            n += 1
        elif word == "vt":
            # The format has a default for v.
            points.append([*map(float, rest[:2]), 0.0][:2])
        elif word == "f":
            sizes.append(len(rest))
            for corner in rest:
                v, _, others = corner.partition("/")
                vt = others.split("/", 1)[0]
                vertices.append(_from_zero(v, n))
                number.append(_from_zero(vt, len(points)) if vt else -1)
    number = np.array(number, int)
    if (wrong := number >= len(points)).any():
        raise MeshError(
            f"a face names texture coordinates {number[wrong][0] + 1} of {len(points)}",
            "export it again",
        )
    # The last row is that of a corner without.
    points = np.array([*points, [np.nan, np.nan]])
    return _of_triangles(sizes, vertices, points[number], faces)


def _from_zero(word: str, count: int) -> int:
    """OBJ counts from 1 on, or back from -1, the last so far."""
    at = int(word)
    return at - 1 if at > 0 else count + at


def _of_ply(data: bytes, faces, path):
    columns = ply_columns(data)[0]
    vertex, face = columns.get("vertex", {}), columns.get("face", {})
    named = [name for name in CORNERS if name in face]
    if not named:
        raise MeshError("it has no faces, and a texture needs some")
    sizes, corners = face[named[0]]
    corners = np.asarray(corners, int)
    if _OF_FACE in face:
        counts, uv = face[_OF_FACE]
        if not np.array_equal(counts, 2 * np.asarray(sizes, int)):
            raise MeshError(
                f"its faces have {np.sum(counts)} numbers in {_OF_FACE}, expected "
                f"{2 * len(corners)}, two a corner",
                "export it again",
            )
        return _of_triangles(sizes, corners, np.reshape(uv, (-1, 2)), faces)
    for names in _OF_VERTEX:
        if set(names) <= set(vertex):
            uv = np.stack([vertex[name][1] for name in names], 1)
            return uv.astype(float)[faces]
    return np.full((*faces.shape, 2), np.nan)


def _of_gltf(data: bytes, faces, path: Path):
    rows = []
    parts = scene_parts(data, path.parent, format_of(path), skip_materials=False)
    for _, part in parts:
        uv: Any = getattr(part.visual, "uv", None)
        rows.append(np.full((len(part.vertices), 2), np.nan) if uv is None else uv)
    return np.concatenate(rows)[faces]


def _of_triangles(sizes, vertices, uv, faces):
    """Rows of the corners of polygons, for those of the triangles they are split into.

    The triangles of each polygon follow one another, and two are fewer than corners.
    """
    sizes, vertices = np.asarray(sizes, int), np.asarray(vertices, int)
    polygon = np.repeat(np.arange(len(sizes)), sizes - 2)
    if len(polygon) != len(faces):
        raise MeshError(
            f"its polygons split into {len(polygon)} triangles, and the mesh has "
            f"{len(faces)}",
            "is it that of this file?",
        )
    n = 1 + max(vertices.max(initial=0), faces.max(initial=0))
    keys = np.repeat(np.arange(len(sizes)), sizes) * n + vertices
    order = np.argsort(keys, kind="stable")
    wanted = polygon[:, None] * n + faces
    at = order[np.minimum(np.searchsorted(keys[order], wanted), len(order) - 1)]
    if not np.array_equal(keys[at], wanted):
        raise MeshError(
            "its faces are not those of the mesh", "is it that of this file?"
        )
    return np.asarray(uv, float)[at]

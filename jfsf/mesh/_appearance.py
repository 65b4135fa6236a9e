"""What a mesh file says of the looks of its mesh: colours and texture coordinates.

Colours are those of vertices; textures, materials and colours of faces are none. OFF
and OBJ are read here: trimesh 5.2 drops colours of OFF, and those of an OBJ with
texture. Texture coordinates belong to the corners of triangles: a vertex on a seam of
the texture has other coordinates in each face.
"""

import os
import re
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from jfsf.mesh._formats import off_keyword, text_of
from jfsf.mesh._gltf import scene_parts
from jfsf.mesh._ply import CORNERS, ply_columns
from jfsf.mesh._read import contents, format_of, read_noted
from jfsf.mesh._values import MeshError
from jfsf.types import ArrayLike, Mesh

_GREY = 0.7  # of a part of a scene without colours, beside parts with some
# As glTF's colours are linear, and all others sRGB.
_STEP = 0.0031308
# Names in use for those of a vertex of PLY, and of a face, of its corners in turn.
_UV_OF_VERTEX = ("s", "t"), ("u", "v"), ("texture_u", "texture_v")
_UV_OF_FACE = "texcoord"
FORMATS = "OBJ (vt), PLY (s and t, or texcoord) or glTF"


def vertex_colours(path: str | os.PathLike[str]) -> Float[np.ndarray, "n 3"] | None:
    """The colour of each vertex of `read`, sRGB in [0, 1]; opacity is dropped.

    Args:
        path: a file that `read` reads.

    Returns:
        None if the file has no colours of vertices, or the same everywhere, as some
        programs write for a mesh that has none; and for other formats, such as STL.

    Raises:
        MeshError: as `read`.
    """
    path = Path(path)
    finder = _COLOUR_READERS.get(format_of(path))
    if finder is None:
        return None
    mesh = read_noted(path, finite=False).mesh
    try:
        found = finder(contents(path), mesh, path)
    except MeshError:
        raise
    except ValueError:  # what stands there are no numbers
        return None
    if found is None or np.shape(found) != np.shape(mesh.vertices):
        return None
    if not np.isfinite(found).all() or not np.ptp(found, axis=0).any():
        return None
    return np.clip(found, 0, 1)


def _colours_of_off(data, mesh, path):
    """Behind coordinates and normals: whole numbers to 255, or else to 1."""
    lines = (line.split("#", 1)[0].split() for line in text_of(data).splitlines())
    words = [line for line in lines if line]
    keyword = off_keyword(words[0][0])
    if keyword is None or "C" not in keyword[1]:
        return None
    # The counts stand behind the keyword or on a line of their own.
    first = 1 if len(words[0]) > 1 or words[0][0][-1].isdigit() else 2
    # MeshLab, whose keywords begin with N, writes the normal last.
    at = 6 if "N" in keyword[1] and not keyword[1].startswith("N") else 3
    rows = [row[at : at + 3] for row in words[first : first + len(mesh.vertices)]]
    if any(len(row) < 3 for row in rows):
        return None
    values = np.array(rows, np.float64)
    is_byte = not any("." in word for row in rows for word in row)
    return values / 255 if is_byte else values


def _colours_of_obj(data, mesh, path):
    """Behind the coordinates of a v, in [0, 1]; some programs write up to 255."""
    text = text_of(data).replace("\r\n", "\n").replace("\r", "\n")
    text = text.replace("\\\n", " ")
    rows = re.findall(r"(?m)^[ \t]*v[ \t]+([^\r\n#]*)", text)
    words = [row.split()[3:6] for row in rows]
    if any(len(row) < 3 for row in words):
        return None
    values = np.array(words, np.float64).reshape(-1, 3)
    return values / 255 if len(values) and values.max() > 1 else values


def _colours_of_ply(data, mesh, path):
    """In [0, 1], or whole numbers to 255."""
    vertex = ply_columns(data)[0].get("vertex", {})
    names = "red", "green", "blue"
    if not all(name in vertex for name in names):
        return None
    columns = np.stack([vertex[name][1] for name in names], 1)
    is_byte = columns.dtype.kind in "iu" or columns.max(initial=0) > 1
    return columns / 255 if is_byte else columns


def _colours_of_scene(data, mesh, path):
    found, known = [], False
    for _, part in scene_parts(data, path.parent, format_of(path)):
        colours = np.full((len(part.vertices), 3), _GREY)
        if getattr(part.visual, "kind", None) == "vertex":
            known = True
            colours = _srgb(np.asarray(part.visual.vertex_colors)[:, :3] / 255)
        found.append(colours)
    return np.concatenate(found) if known else None


def _srgb(linear):
    curve = 1.055 * np.maximum(linear, _STEP) ** (1 / 2.4) - 0.055
    return np.where(linear > _STEP, curve, 12.92 * linear)


_COLOUR_READERS = {
    **{".off": _colours_of_off, ".obj": _colours_of_obj, ".ply": _colours_of_ply},
    **dict.fromkeys([".glb", ".gltf"], _colours_of_scene),
}


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
    readers = {
        ".obj": _uv_of_obj,
        ".ply": _uv_of_ply,
        ".glb": _uv_of_gltf,
        ".gltf": _uv_of_gltf,
    }
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


def _uv_of_obj(data: bytes, faces, path):
    points, sizes, vertices, number, n = [], [], [], [], 0
    text = text_of(data).replace("\r\n", "\n")
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
    return _uv_of_triangles(sizes, vertices, points[number], faces)


def _from_zero(word: str, count: int) -> int:
    """OBJ counts from 1 on, or back from -1, the last so far."""
    at = int(word)
    return at - 1 if at > 0 else count + at


def _uv_of_ply(data: bytes, faces, path):
    columns = ply_columns(data)[0]
    vertex, face = columns.get("vertex", {}), columns.get("face", {})
    named = [name for name in CORNERS if name in face]
    if not named:
        raise MeshError("it has no faces, and a texture needs some")
    sizes, corners = face[named[0]]
    corners = np.asarray(corners, int)
    if _UV_OF_FACE in face:
        counts, uv = face[_UV_OF_FACE]
        if not np.array_equal(counts, 2 * np.asarray(sizes, int)):
            raise MeshError(
                f"its faces have {np.sum(counts)} numbers in {_UV_OF_FACE}, expected "
                f"{2 * len(corners)}, two a corner",
                "export it again",
            )
        return _uv_of_triangles(sizes, corners, np.reshape(uv, (-1, 2)), faces)
    for names in _UV_OF_VERTEX:
        if set(names) <= set(vertex):
            uv = np.stack([vertex[name][1] for name in names], 1)
            return uv.astype(float)[faces]
    return np.full((*faces.shape, 2), np.nan)


def _uv_of_gltf(data: bytes, faces, path: Path):
    rows = []
    parts = scene_parts(data, path.parent, format_of(path), skip_materials=False)
    for _, part in parts:
        uv: Any = getattr(part.visual, "uv", None)
        rows.append(np.full((len(part.vertices), 2), np.nan) if uv is None else uv)
    return np.concatenate(rows)[faces]


def _uv_of_triangles(sizes, vertices, uv, faces):
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


_UV_READERS = {
    **{".obj": _uv_of_obj, ".ply": _uv_of_ply},
    **dict.fromkeys([".glb", ".gltf"], _uv_of_gltf),
}

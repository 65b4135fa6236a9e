"""The colours of the vertices of a mesh file, where it has any.

OFF and OBJ are read here: trimesh 5.2 drops colours of OFF, and those of an OBJ with
texture. Textures, materials and colours of faces are no colours of vertices.
"""

import io
import os
import re
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from jfsf.mesh._gltf import scene_parts
from jfsf.mesh._read import contents, format_of, read_noted
from jfsf.mesh._values import MeshError

_GREY = 0.7  # of a part of a scene without colours, beside parts with some
# Of the diagonal of the bounding box: within, two vertices are one.
_SAME = 1e-6
# As glTF's colours are linear, and all others sRGB.
_STEP = 0.0031308


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
    finder = _FINDERS.get(format_of(path))
    if finder is None:
        return None
    mesh = read_noted(path).mesh
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


def _of_off(data, mesh, path):
    """Behind coordinates and normals: whole numbers to 255, or else to 1."""
    text = data.decode("ascii", "replace")
    lines = (line.split("#", 1)[0].split() for line in text.splitlines())
    words = [line for line in lines if line]
    keyword = re.match(r"(?:ST)?(C?)(N?)OFF", words[0][0])
    if keyword is None or not keyword[1]:
        return None
    # The counts stand behind the keyword or on a line of their own.
    first = 1 if len(words[0]) > 1 or words[0][0][-1].isdigit() else 2
    at = 6 if keyword[2] else 3
    rows = [row[at : at + 3] for row in words[first : first + len(mesh.vertices)]]
    if any(len(row) < 3 for row in rows):
        return None
    values = np.array(rows, np.float64)
    is_byte = not any("." in word for row in rows for word in row)
    return values / 255 if is_byte else values


def _of_obj(data, mesh, path):
    """Behind the coordinates of a v, in [0, 1]; some programs write up to 255."""
    data = data.replace(b"\\\n", b" ").replace(b"\\\r\n", b" ")
    rows = re.findall(rb"(?m)^[ \t]*v[ \t]+([^\r\n#]*)", data)
    words = [row.split()[3:6] for row in rows]
    if any(len(row) < 3 for row in words):
        return None
    values = np.array(words, np.float64).reshape(-1, 3)
    return values / 255 if len(values) and values.max() > 1 else values


def _of_ply(data, mesh, path):
    import trimesh

    try:
        found = trimesh.load(io.BytesIO(data), file_type="ply", process=False)
    except Exception:  # it reads fewer files than `read`
        return None
    if getattr(found.visual, "kind", None) != "vertex":  # type: ignore
        return None
    colours = np.asarray(found.visual.vertex_colors)[:, :3] / 255  # type: ignore
    # Split at texture seams it has other vertices.
    points = np.asarray(found.vertices, np.float64)  # type: ignore
    if np.array_equal(points, mesh.vertices):
        return colours
    away, near = KDTree(points).query(mesh.vertices)
    size = np.linalg.norm(np.ptp(np.asarray(mesh.vertices), axis=0))
    return colours[near] if away.max() <= _SAME * size else None


def _of_scene(data, mesh, path):
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


_FINDERS = {
    **{".off": _of_off, ".obj": _of_obj, ".ply": _of_ply},
    **dict.fromkeys([".glb", ".gltf"], _of_scene),
}

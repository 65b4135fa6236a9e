"""The colours of the vertices of a mesh file, where it has any.

OFF and OBJ are read here: trimesh 5.2 drops colours of OFF, and those of an OBJ with
texture. Textures, materials and colours of faces are no colours of vertices.
"""

import os
import re
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jfsf.mesh._formats import off_keyword, text_of
from jfsf.mesh._gltf import scene_parts
from jfsf.mesh._ply import ply_columns
from jfsf.mesh._read import contents, format_of, read_noted
from jfsf.mesh._values import MeshError

_GREY = 0.7  # of a part of a scene without colours, beside parts with some
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


def _of_off(data, mesh, path):
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


def _of_obj(data, mesh, path):
    """Behind the coordinates of a v, in [0, 1]; some programs write up to 255."""
    data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    data = data.replace(b"\\\n", b" ")
    rows = re.findall(rb"(?m)^[ \t]*v[ \t]+([^\r\n#]*)", data)
    words = [row.split()[3:6] for row in rows]
    if any(len(row) < 3 for row in words):
        return None
    values = np.array(words, np.float64).reshape(-1, 3)
    return values / 255 if len(values) and values.max() > 1 else values


def _of_ply(data, mesh, path):
    """In [0, 1], or whole numbers to 255."""
    vertex = ply_columns(data)[0].get("vertex", {})
    names = "red", "green", "blue"
    if not all(name in vertex for name in names):
        return None
    columns = np.stack([vertex[name][1] for name in names], 1)
    is_byte = columns.dtype.kind in "iu" or columns.max(initial=0) > 1
    return columns / 255 if is_byte else columns


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

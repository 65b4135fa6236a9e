"""A painted mesh -> OBJ, with its material and texture in files beside it."""

import io
import re
from pathlib import Path

import numpy as np

from jfsf.apps.export._paint import Painted
from jfsf.storage._atomic import utf8


def obj_files(path: Path, shape: Painted, texture: bytes | None) -> dict[Path, bytes]:
    """The files by path, the OBJ last.

    Colours stand behind the coordinates of a vertex, sRGB in [0, 1], where MeshLab and
    Blender look for them. With a texture there are STEM_checker.mtl and .png too.
    """
    files = {}
    text = io.BytesIO()
    if texture is not None:
        # The format separates names by spaces.
        stem = re.sub(r"\s", "_", path.stem) + "_checker"
        files[path.with_name(f"{stem}.png")] = texture
        material = f"newmtl checker\nKd 1 1 1\nKs 0 0 0\nmap_Kd {stem}.png\n"
        files[path.with_name(f"{stem}.mtl")] = utf8(material)
        text.write(utf8(f"mtllib {stem}.mtl\nusemtl checker\n"))
    rows, form = shape.vertices, "v" + 3 * " %.17g"
    if shape.colours is not None:
        rows, form = np.hstack([rows, shape.colours]), form + 3 * " %.6g"
    np.savetxt(text, rows, form)
    if shape.uv is not None:
        np.savetxt(text, shape.uv, "vt %.9g %.9g")
    corners = shape.faces + 1
    if shape.uv is not None:
        corners, corner = np.repeat(corners, 2, axis=1), "%d/%d"
    else:
        corner = "%d"
    np.savetxt(text, corners, "f" + 3 * f" {corner}")
    return files | {path: text.getvalue()}

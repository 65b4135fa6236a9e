"""A mesh with an image on it -> OBJ with its material and PNG, or GLB."""

import io
import os
import re
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jfsf.apps.export._glb import glb_bytes
from jfsf.apps.export._paint import Painted
from jfsf.mesh import MeshError, vertex_normals
from jfsf.mesh._values import checked_mesh
from jfsf.storage._atomic import utf8, write_atomically
from jfsf.types import ArrayLike, Mesh

TEXTURED = ".obj", ".glb"


def textured_files(path: Path) -> list[Path]:
    """What `export_textured` writes: the file, and those beside it.

    Raises:
        ValueError: another suffix than `TEXTURED`.
    """
    suffix = path.suffix.lower()
    if suffix not in TEXTURED:
        raise ValueError(
            f"{path}: a mesh with a texture is written as {', '.join(TEXTURED)}, not "
            f"{suffix!r}"
        )
    if suffix == ".glb":
        return [path]
    # The format separates names by spaces.
    stem = re.sub(r"\s", "_", path.stem)
    return [path, path.with_name(f"{stem}.mtl"), path.with_name(f"{stem}.png")]


def export_textured(
    path: str | os.PathLike[str],
    mesh: Mesh,
    uv: Float[ArrayLike, "m 3 2"],
    png: bytes,
) -> None:
    """Write a mesh with a texture.

    Each file appears complete or not at all, the OBJ after those that it names.

    Args:
        path: `.obj`, doubles, with STEM.mtl and STEM.png beside it: vertex i stays
            vertex i. `.glb`, float32, all in one: that format splits vertices where
            texture coordinates differ, so the order of the vertices is another.
        mesh: in its own unit and axes, with m faces.
        uv: texture coordinates of the corners of its faces: u to the right, v up.
        png: the file of the image.

    Raises:
        ValueError: another suffix, or uv that is not finite rows of the corners.
        MeshError: no mesh, or one without faces.
        OSError: the folder cannot be written.
    """
    path = Path(path)
    written = textured_files(path)
    vertices, faces = checked_mesh(mesh, "export_textured")
    if not len(faces):
        raise MeshError("export_textured: the mesh has no faces; triangulate it")
    uv = np.asarray(uv, np.float64)
    if uv.shape != (len(faces), 3, 2) or not np.isfinite(uv).all():
        raise ValueError(
            f"export_textured: uv has shape {uv.shape}; pass finite rows, two numbers "
            f"a corner: {(len(faces), 3, 2)}"
        )
    # A row for each pair of a vertex and its texture coordinates.
    corners = np.column_stack([faces.ravel(), uv.reshape(-1, 2)])
    rows, corner = np.unique(corners, axis=0, return_inverse=True)
    corner = corner.reshape(-1, 3)
    if len(written) == 1:
        vertex = rows[:, 0].astype(int)
        split = Painted(vertices[vertex].astype(float), corner, None, rows[:, 1:], {})
        normals = vertex_normals(vertices, faces)[vertex]
        files = {path: glb_bytes(path.stem, split, png, normals)}
    else:
        text = _obj_text(written[1].name, vertices, faces, rows[:, 1:], corner)
        material = f"newmtl texture\nKd 1 1 1\nKs 0 0 0\nmap_Kd {written[2].name}\n"
        files = {written[2]: png, written[1]: utf8(material), path: text}
    for name, data in files.items():
        write_atomically(name, lambda file, data=data: file.write(data))


def _obj_text(material: str, vertices, faces, points, corner) -> bytes:
    text = io.BytesIO()
    text.write(utf8(f"mtllib {material}\nusemtl texture\n"))
    np.savetxt(text, vertices, "v" + 3 * " %.17g")
    np.savetxt(text, points, "vt %.9g %.9g")
    pairs = np.stack([faces, corner], 2).reshape(-1, 6) + 1
    np.savetxt(text, pairs, "f" + 3 * " %d/%d")
    return text.getvalue()

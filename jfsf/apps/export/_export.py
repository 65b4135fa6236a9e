"""Write a mesh, the map from it, or an image on it, in the format of the suffix."""

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from jfsf.apps.export._formats import (
    Painted,
    beside,
    glb_bytes,
    obj_files,
    painted,
    ply_bytes,
)
from jfsf.apps.export._formats import checker as checker_png
from jfsf.apps.plot._colours import (
    body_colours,
    matched_colours,
    pull_back,
    texture_coordinates,
)
from jfsf.apps.plot._frames import Up, frame
from jfsf.mesh import MeshError
from jfsf.mesh._geometry import vertex_normals
from jfsf.mesh._values import checked_mesh
from jfsf.storage._atomic import write_atomically
from jfsf.types import ArrayLike, Mesh

FORMATS = ".ply", ".obj", ".glb"
TEXTURED = ".obj", ".glb"
TILES = 16  # squares of the checker along the longer side of Y


def export_map(
    path: str | os.PathLike[str],
    mesh_x: Mesh,
    mesh_y: Mesh,
    T_xy: Int[ArrayLike, " n_x"],
    *,
    up: Up = "y",
    checker: bool = False,
    matched_x: Bool[ArrayLike, " n_x"] | None = None,
    colours_y: Float[ArrayLike, "n_y 3"] | None = None,
    values: Mapping[str, ArrayLike] | None = None,
) -> None:
    """Write X with the colours of Y through the map from X to Y.

    To compare, write Y too, with its own vertices as the map:
    `export_map(path, mesh_y, mesh_y, range(n_y))`, and of parts with
    `matched_x=found.matched_y`.

    Args:
        path: `.ply`, `.obj` or `.glb`; see `export_mesh`.
        mesh_x, mesh_y: meshes or point clouds.
        T_xy: the vertex of Y for each vertex of X.
        up: the axis that points up in Y's file. Y is coloured alone, so that both can
            be written one by one; in a picture it is turned onto X first, and if it
            stands otherwise in its file, colours differ from those.
        checker: carry a checker from Y to X too, as texture (OBJ and GLB): a projection
            from the front, with `TILES` squares along the longer side. Viewers multiply
            it with the colours, or show it alone.
        matched_x: for a match of parts, `Match.matched_x`; all other vertices are grey.
        colours_y: sRGB in [0, 1] of each vertex of Y, such as those of its file
            (`jfsf.mesh.vertex_colours`). When absent its vertices are coloured by their
            place.
        values: numbers (n_x,) by name, such as `Match.confidence_x` as "confidence" and
            `Match.membership_x` as "membership"; see `export_mesh`.

    Raises:
        ValueError: T_xy is no map from X to Y; or as `export_mesh`.
        OSError: the folder cannot be written.
    """
    n_x, n_y = len(mesh_x.vertices), len(mesh_y.vertices)
    if np.shape(T_xy) != (n_x,):
        raise ValueError(
            f"export_map: X has {n_x} vertices, T_xy has shape {np.shape(T_xy)}"
        )
    T_xy = np.asarray(T_xy)

    body = np.asarray(mesh_y.vertices, float) @ frame(up)
    if colours_y is None:
        colours_y = body_colours(body)
    elif np.shape(colours_y) != (n_y, 3):
        raise ValueError(
            f"export_map: Y has {n_y} vertices, colours_y has shape "
            f"{np.shape(colours_y)}"
        )
    colours = matched_colours(pull_back(np.asarray(colours_y), T_xy), matched_x)
    uv = texture_coordinates(body)[T_xy] * (TILES / 2) if checker else None
    export_mesh(path, mesh_x, colours=colours, uv=uv, values=values)


def export_mesh(
    path: str | os.PathLike[str],
    mesh: Mesh,
    *,
    colours: Float[ArrayLike, "n 3"] | None = None,
    uv: Float[ArrayLike, "n 2"] | None = None,
    values: Mapping[str, ArrayLike] | None = None,
) -> None:
    """Write a mesh with colours or a checker on it; vertex i stays vertex i.

    Each file appears complete or not at all, the OBJ after those that it names.

    Args:
        path: `.ply`, doubles; `.obj`, doubles, and with `uv` STEM_checker.mtl and .png
            beside it; `.glb`, float32, all in one (MeshLab takes its colours, which
            are linear, for sRGB, and shows them too dark).
        mesh: in its own unit and axes. Of a point cloud the points are written.
        colours: sRGB in [0, 1].
        uv: texture coordinates, u to the right and v up, for a checker of two by two
            squares that repeats at whole numbers. Not for PLY.
        values: other numbers, (n,) each, by names of lower case letters, for other
            programs to read: vertex properties of PLY, attributes such as `_CONFIDENCE`
            of GLB. OBJ has no attributes, so there they are left out. Programs know
            `confidence` of a PLY, as scanners write it, and MeshLab shows `quality` in
            colours.

    Raises:
        ValueError: another suffix; colours, uv or values that are not one row for each
            vertex; uv of PLY or of a point cloud; a value with a name that the formats
            use.
        MeshError: no mesh.
        OSError: the folder cannot be written.
    """
    path = Path(path)
    check_path(path, checker=uv is not None)
    shape = painted(mesh, colours, uv, values)
    texture = None if uv is None else checker_png()
    suffix = path.suffix.lower()
    if suffix == ".ply":
        files = {path: ply_bytes(shape)}
    elif suffix == ".obj":
        files = obj_files(path, shape, texture, tail="_checker")
    else:
        files = {path: glb_bytes(path.stem, shape, texture)}
    _write(files)


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
    textured_files(path)
    vertices, faces = checked_mesh(mesh, "export_textured")
    if not len(faces):
        raise MeshError("the mesh has no faces", "triangulate it", "export_textured")
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
    if path.suffix.lower() == ".glb":
        vertex = rows[:, 0].astype(int)
        split = Painted(vertices[vertex].astype(float), corner, None, rows[:, 1:], {})
        normals = vertex_normals(vertices, faces)[vertex]
        _write({path: glb_bytes(path.stem, split, png, normals)})
    else:
        shape = Painted(vertices, faces, None, rows[:, 1:], {})
        _write(obj_files(path, shape, png, corner))


def check_path(path: Path, *, checker: bool = False) -> None:
    """ValueError if no mesh can be written under this suffix, with a checker or not."""
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise ValueError(
            f"{path}: a mesh is exported as {', '.join(FORMATS)}, not {suffix!r}"
        )
    if checker and suffix == ".ply":
        raise ValueError(f"{path}: PLY has no texture here; export .obj or .glb")


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
    return [path] if suffix == ".glb" else [path, *beside(path)]


def _write(files: Mapping[Path, bytes]) -> None:
    """Each completely or not at all, in this order."""
    for name, data in files.items():
        write_atomically(name, lambda file, data=data: file.write(data))

"""Write a mesh, or the map from it, in the format of the suffix."""

import os
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from jfsf.apps.export._glb import glb_bytes
from jfsf.apps.export._obj import obj_files
from jfsf.apps.export._paint import painted
from jfsf.apps.export._ply import ply_bytes
from jfsf.apps.export._texture import checker as checker_png
from jfsf.apps.plot import pull_back
from jfsf.apps.plot._colours import Up, body_colours, frame, matched_colours
from jfsf.apps.plot._pictures import texture_coordinates
from jfsf.apps.plot._upright import find_frame
from jfsf.storage._atomic import write_atomically
from jfsf.types import ArrayLike, Mesh

FORMATS = (".ply", ".obj", ".glb")
TILES = 16  # squares of the checker along the longer side of Y


def export_map(
    path: str | os.PathLike[str],
    mesh_x: Mesh,
    mesh_y: Mesh,
    T_xy: Int[ArrayLike, " n_x"],
    *,
    up: Up | None = None,
    checker: bool = False,
    uv_y: Float[ArrayLike, "n_y 2"] | None = None,
    confidence: Float[ArrayLike, " n_x"] | None = None,
    matched_x: Bool[ArrayLike, " n_x"] | None = None,
    colours_y: Float[ArrayLike, "n_y 3"] | None = None,
    membership: Float[ArrayLike, " n_x"] | None = None,
) -> None:
    """Write X with the colours of Y through the map from X to Y.

    To compare, write Y too, with its own vertices as the map:
    `export_map(path, mesh_y, mesh_y, range(n_y))`, and of parts with
    `matched_x=found.matched_y`.

    Args:
        path: `.ply`, `.obj` or `.glb`; see `export_mesh`.
        mesh_x, mesh_y: meshes or point clouds.
        T_xy: the vertex of Y for each vertex of X.
        up: the axis that points up in Y's file; found in its shape alone when
            absent, so the colours may differ from those of a picture of the pair.
        checker: carry a checker from Y to X too, as texture (OBJ and GLB). Viewers
            multiply it with the colours, or show it alone.
        uv_y: texture coordinates of Y for it; by default a projection from the front,
            with `TILES` squares along the longer side.
        confidence: of each vertex of X, `Match.confidence_x`; see `export_mesh`.
        matched_x: of a match of parts, `Match.matched_x`; all other vertices are grey.
        colours_y: sRGB in [0, 1] of each vertex of Y, such as those of its file
            (`jfsf.mesh.vertex_colours`). When absent its vertices are coloured by their
            place.
        membership: likewise, `Match.membership_x`, for other programs to read: written
            as the confidence is, under the name `membership`.

    Raises:
        ValueError: T_xy is no map from X to Y; or as `export_mesh`.
        OSError: the folder cannot be written.
    """
    if np.shape(T_xy) != (n_x := len(mesh_x.vertices),):
        raise ValueError(
            f"export_map: X has {n_x} vertices, T_xy has shape {np.shape(T_xy)}"
        )
    T_xy = np.asarray(T_xy)

    @cache
    def body():
        # Of Y alone, so that X and Y can be written one by one.
        axes = frame(up) if up else find_frame(mesh_y).axes
        return np.asarray(mesh_y.vertices, float) @ axes

    if colours_y is None:
        colours_y = body_colours(body())
    elif np.shape(colours_y) != np.shape(mesh_y.vertices):
        raise ValueError(
            f"export_map: Y has {len(mesh_y.vertices)} vertices, colours_y has shape "
            f"{np.shape(colours_y)}"
        )
    colours = matched_colours(pull_back(np.asarray(colours_y), T_xy), matched_x)
    uv = None
    if checker or uv_y is not None:
        if uv_y is None:
            uv_y = texture_coordinates(body()) * (TILES / 2)
        if np.shape(uv_y) != (len(mesh_y.vertices), 2):
            raise ValueError(
                f"export_map: Y has {len(mesh_y.vertices)} vertices, uv_y has shape "
                f"{np.shape(uv_y)}"
            )
        uv = pull_back(uv_y, T_xy)
    values = None if membership is None else {"membership": membership}
    export_mesh(
        path, mesh_x, colours=colours, uv=uv, confidence=confidence, values=values
    )


def export_mesh(
    path: str | os.PathLike[str],
    mesh: Mesh,
    *,
    colours: Float[ArrayLike, "n 3"] | None = None,
    uv: Float[ArrayLike, "n 2"] | None = None,
    confidence: Float[ArrayLike, " n"] | None = None,
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
        confidence: in [0, 1], for other programs to read: the vertex property
            `confidence` of PLY, the attribute `_CONFIDENCE` of GLB. OBJ has no
            attributes, so there it is left out.
        values: other numbers, (n,) each, by names of lower case letters, for other
            programs likewise. MeshLab shows `quality` of a PLY in colours.

    Raises:
        ValueError: another suffix; colours, uv, confidence or values that are not one
            row a vertex; uv of PLY or of a point cloud; a value with a name that the
            formats use.
        MeshError: no mesh.
        OSError: the folder cannot be written.
    """
    path = Path(path)
    check_path(path, checker=uv is not None)
    shape = painted(mesh, colours, uv, confidence, values)
    texture = None if uv is None else checker_png()
    suffix = path.suffix.lower()
    if suffix == ".ply":
        files = {path: ply_bytes(shape)}
    elif suffix == ".obj":
        files = obj_files(path, shape, texture)
    else:
        files = {path: glb_bytes(path.stem, shape, texture)}
    for name, data in files.items():
        write_atomically(name, lambda file, data=data: file.write(data))


def check_path(path: Path, *, checker: bool = False) -> None:
    """ValueError if no mesh can be written under this suffix, with a checker or not."""
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise ValueError(
            f"{path}: a mesh is exported as {', '.join(FORMATS)}, not {suffix!r}"
        )
    if checker and suffix == ".ply":
        raise ValueError(f"{path}: PLY has no texture here; export .obj or .glb")

"""jfsf transfer: values, labels, landmarks or a texture carried along a map."""

from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import typer

from jfsf.apps.cli import _options as opt
from jfsf.apps.cli._files import can_write_beside
from jfsf.apps.cli._print import say, say_result, stage_bar
from jfsf.apps.cli._stored import of_kept, read_pair, stored_match
from jfsf.apps.report._words import verdict, warnings_of
from jfsf.types import Mesh


class Source(StrEnum):
    """The shape that has what is carried, as choices of an option."""

    y = "y"
    x = "x"


class To(StrEnum):
    """What of the other shape gets labels, as choices of an option."""

    vertices = "vertices"
    faces = "faces"


class Work(NamedTuple):
    """One thing to carry.

    what: its name.
    carry: what is laid -> the result.
    write: the result -> its file.
    unknown: what the result has where the shape with the things has no surface.
    placed: where landmarks lie on their shape (`jfsf.apps.landmarks`); else None.
    """

    what: str
    carry: Callable[[Any], Any]
    write: Callable[[Any], None]
    unknown: str
    placed: Any = None


def transfer(
    x: opt.MeshX,
    y: opt.MeshY,
    map_file: opt.MapFile,
    out: Annotated[
        Path,
        typer.Option(
            metavar="FILE",
            help="The file to write. Values and labels: .npy, .csv or .txt; labels "
            "also .seg, or .json of vertices. Landmarks: any format that is read. A "
            "texture: .obj (with .mtl and .png beside it) or .glb.",
        ),
    ],
    values: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="A row of numbers for each vertex of Y: .npy, .csv or .txt.",
        ),
    ] = None,
    labels: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Whole numbers or names, one for each vertex or each face of Y: .npy, "
            ".csv, .txt or .seg; or .json with the vertices of each part, like SMPL's.",
        ),
    ] = None,
    landmarks: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Landmarks of Y: .mrk.json or .fcsv (3D Slicer), .pp (MeshLab), or a "
            "table (.csv, .tsv, .txt).",
        ),
    ] = None,
    texture: Annotated[
        Path | None,
        typer.Option(
            metavar="IMAGE",
            help="The image on Y, whose file (OBJ, PLY, GLB) has texture coordinates. "
            "A new image for X is made.",
        ),
    ] = None,
    source: Annotated[
        Source,
        typer.Option(
            "--from", help="The shape that data are carried from, to the other one."
        ),
    ] = Source.y,
    to: Annotated[
        To | None,
        typer.Option(
            help="Whether vertices or faces get labels; by default as in the input."
        ),
    ] = None,
    size: Annotated[
        int,
        typer.Option(help="Width and height of the new image, a power of two."),
    ] = 2048,
    repair: opt.MapRepairOption = False,
) -> None:
    """Carry values, labels, landmarks or a texture from Y to X.

    X is registered to Y by the map, so that vertices and what lies between them have a
    point on Y. Give one of --values, --labels, --landmarks and --texture. The result
    counts the vertices and faces of X's file. With --from x it goes from X to Y.

    Example: jfsf transfer a.off b.off map.npz --labels b_parts.txt --out a_parts.txt
    """
    from jfsf.apps.transfer import overlay
    from jfsf.apps.transfer._overlay import extended
    from jfsf.mesh import read, surface_area

    given = {"values": values, "labels": labels}
    given |= {"landmarks": landmarks, "texture": texture}
    what = [name for name, path in given.items() if path is not None]
    if len(what) != 1:
        raise ValueError(
            f"transfer: {' and '.join(f'--{name}' for name in what) or 'nothing'} was "
            "given; give one of --values, --labels, --landmarks and --texture"
        )
    if to is not None and labels is None:
        raise ValueError("--to says where labels go; give --labels, or leave it out")
    inputs = [x, y, map_file, *(path for path in given.values() if path is not None)]
    can_write_beside(_written(out, texture is not None), inputs)
    paths = (x, y) if source is Source.y else (y, x)
    goal, own = (read(path, finite=not repair) for path in paths)
    if (column := values or labels) is not None:
        work = _column(column, own, out, to, named=labels is not None)
    elif landmarks is not None:
        work = _landmarks(landmarks, own, out)
    else:
        assert texture is not None
        work = _texture(texture, goal, own, paths[1], out, size)
    mesh_x, mesh_y, maps, _ = read_pair(x, y, map_file, None, None, None, mend=repair)
    match = stored_match(map_file)
    T, matched = maps.T_xy, match and match.matched_x
    if source is Source.x:
        if maps.T_yx is None:
            raise ValueError(
                f"{map_file}: holds no T_yx, the map from Y to X, for --from x; give a "
                "file of match, or the meshes and the map the other way round"
            )
        mesh_x, mesh_y = mesh_y, mesh_x
        T, matched = maps.T_yx, match and match.matched_y
    with stage_bar() as stage:
        stage("registration")
        if matched is not None:
            matched = of_kept(np.asarray(matched), goal, mesh_x)
        part = overlay(mesh_x, mesh_y, T, matched_x=matched)
        whole = extended(part, goal, own)
        stage(work.what)
        result = work.carry(whole)
        stage("writing")
        work.write(result)
    say(f"{work.what} carried from {paths[1]} to {paths[0]}")
    notes: list[str] = list(getattr(result, "said", ()))
    if share := 1 - whole.known_x.mean():
        notes.append(
            f"the map counts for nothing at {share:.1%} of the vertices of {paths[0]}: "
            f"{work.unknown}"
        )
    if match is not None:
        radius = match.radius_y if source is Source.y else match.radius_x
        radius = np.asarray([] if radius is None else radius)
        if work.placed is not None and len(radius) == len(own.vertices):
            # In the unit of the file they go to.
            lengths = (radius[work.placed.corners] * work.placed.weights).sum(1)
            lengths *= np.sqrt(surface_area(mesh_x))
            for number, length in enumerate(lengths):
                name = result.names[number] or number + 1
                say(f"{name}: within {length:.3g}, 90 %, if the map is right")
        likely = float(match.certificate.confidence)
        say(f"confidence of the map: {likely:.2f}, {verdict(likely)}")
        # Which orientation was asked for is not in the file.
        notes += warnings_of(match.certificate, "any")
        if (score := float(match.certificate.orientation)) < 0:
            notes.append(
                f"the map mirrors, orientation {score:.2f}: left and right are "
                "swapped, unless match was asked for that"
            )
    say_result([], [], notes, _written(out, texture is not None))


def _written(out: Path, textured: bool) -> list[Path]:
    from jfsf.apps.export._export import textured_files

    return textured_files(out) if textured else [out]


def _column(path: Path, own: Mesh, out: Path, to: To | None, named: bool) -> Work:
    """Values, or labels if they are named."""
    from jfsf.apps import transfer
    from jfsf.apps.transfer._files import (
        FORMATS,
        LABEL_FORMATS,
        check_format,
        read_labels,
        read_values,
        write_column,
    )

    check_format(out, LABEL_FORMATS if named else FORMATS)
    n, m = len(own.vertices), len(own.faces)
    write = lambda rows: write_column(out, column._replace(rows=rows))
    if named:
        column, goal = read_labels(path, n, m), to and to.value
        came_as = "vertices" if len(column.rows) == n else "faces"
        if out.suffix.lower() == ".json" and (goal or came_as) == "faces":
            raise ValueError(
                f"{out}: holds the vertices of parts, and these labels are of faces; "
                "give --to vertices, or write .seg"
            )
        carry = lambda on: transfer.labels(on, column.rows, to=goal)  # type: ignore
        return Work("labels", carry, write, "their labels are -1, or empty names")
    column = read_values(path, n)
    carry = lambda on: transfer.values(on, column.rows)
    return Work("values", carry, write, "their values are nan")


def _landmarks(path: Path, own: Mesh, out: Path) -> Work:
    from jfsf.apps.landmarks import read_landmarks, write_landmarks
    from jfsf.apps.landmarks._files import FORMATS
    from jfsf.apps.landmarks._files import SUFFIXES as KNOWN
    from jfsf.apps.landmarks._place import on_surface
    from jfsf.apps.transfer import landmarks

    if out.suffix.lower() not in KNOWN:
        raise ValueError(f"{out}: landmarks are written as {FORMATS}")
    found = read_landmarks(path)
    try:
        there = on_surface(found, own)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return Work(
        "landmarks",
        lambda on: landmarks(on, found),
        lambda carried: write_landmarks(out, carried),
        "landmarks there are at the nearest points",
        there,
    )


def _texture(path: Path, goal: Mesh, own: Mesh, file: Path, out, size: int) -> Work:
    from jfsf.apps.export import export_textured
    from jfsf.apps.transfer import texture
    from jfsf.apps.transfer._files import png_of, read_image
    from jfsf.apps.transfer._texture import check_size
    from jfsf.mesh import read_uv

    check_size(len(goal.faces), size)
    uv, image = read_uv(file, own), read_image(path)
    return Work(
        "texture",
        lambda on: texture(on, uv, image, size=size),
        lambda baked: export_textured(out, goal, baked.uv, png_of(baked.image)),
        "it is grey there",
    )

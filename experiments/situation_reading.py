"""Rows of situations.py on what files hold: pieces, strays, formats, clouds, holes.

A maker writes the files of a situation into a folder and returns the commands that are
run there. `READING` names the makers, with what jfsf says or does, and what to do then:
rows of the table in `jfsf/apps/guide/troubleshooting.md`.
"""

from importlib.util import find_spec
from pathlib import Path

import numpy as np
from situation_files import (
    cloud,
    torn,
    with_body,
    with_floor,
    with_nan,
    with_outliers,
    with_strays,
    with_triangle,
)
from situation_formats import ply, write, write_darts
from situation_runs import (
    OTHER,
    PAIR,
    Check,
    Command,
    FileSituation,
    bodies,
    map_error,
    matched,
    refused,
)

from jfsf.mesh import read, surface_area


def two_bodies(folder: Path) -> list[Command]:
    """Another, smaller body in each file."""
    found, contents = [], []
    for names, others in ((PAIR, OTHER), (OTHER, PAIR)):
        x, y = (
            with_body(*pair) for pair in zip(bodies(names), bodies(others), strict=True)
        )
        words = ("--largest-component leaves out 1 other piece with 1202 vertices",)
        args = ("--largest-component",)
        found.append(matched(folder, names[0], x, y, args, words=words))
        contents.append((x, y))
    error = lambda: map_error(folder / "pieces.npz", *contents[0])
    all_pieces = Command(
        "piece to piece",
        (*found[0].args[:3], "--out", "pieces.npz", "--components"),
        ("pieces that were matched",),
        checks={"error": Check(error)},
    )
    refusal = ("2 connected components", "--largest-component")
    found.append(refused(found[0], *refusal, name="without the option"))
    pieces = ("separate pieces: 1 beside the largest, of 2400 faces",)
    said = Command("info", ("info", found[0].args[1]), pieces, code=1)
    return [*found, all_pieces, said]


def stray_vertices(folder: Path) -> list[Command]:
    """Vertices that belong to no face."""
    x, y = bodies()
    one = matched(
        folder, "one in X", with_strays(x, 1), y, words=("1 vertex without a face",)
    )
    x, y = bodies(OTHER)
    many = matched(
        folder,
        "some in both",
        with_strays(x, 7),
        with_strays(y, 5),
        words=("7 vertices without a face", "5 vertices without a face"),
    )
    words = ("vertices without a face: match leaves out 1", "can be matched")
    return [one, many, Command("info", ("info", one.args[1]), words)]


def stray_triangle(folder: Path) -> list[Command]:
    """A triangle apart from the body."""
    x, y = bodies()
    words = ("1 small component removed",)
    repaired = matched(
        folder, "repaired", with_triangle(x), y, ("--repair",), words=words
    )
    words = ("leaves out 1 other piece with 3 vertices",)
    args = ("--largest-component",)
    kept = matched(folder, "left out", with_triangle(x), y, args, words=words)
    words = ("separate pieces: 1 beside the largest, of 1 face",)
    said = Command(
        "info", ("info", repaired.args[1]), words, code=1, unsaid=("small holes",)
    )
    return [said, repaired, kept]


def formats(folder: Path) -> list[Command]:
    """Formats of other programs, and packed files."""
    x, y = bodies()
    found = []
    for suffix in (".off.gz", ".ply.xz", ".obj.bz2", ".vtk", ".vtp", ".gii", ".vtk.gz"):
        write(folder / f"scan{suffix}", x.mesh)
        needs = {".vtk": "vtkmodules", ".vtp": "vtkmodules", ".gii": "nibabel"}
        own = needs.get(suffix.removesuffix(".gz"), "")
        args = ("info", f"scan{suffix}")
        words = ("vertices │ 1202", "faces │ 2400", "can be matched")
        found.append(Command(suffix, args, words, needs=own))
    for suffix in (".xyz", ".npy", ".xyz.gz"):
        write(folder / f"points{suffix}", x.mesh)
        words = ("vertices │ 1202", "can be matched")
        found.append(Command(suffix, ("info", f"points{suffix}"), words))
    if find_spec("vtkmodules") is None:
        words = ("pip install 'jfsf[vtk]'",)
        args = ("info", "scan.vtp")
        found.append(Command(".vtp without its library", args, words, code=1))
    suffixes = (".xyz.gz", ".ply.xz")
    return [*found, matched(folder, "a packed cloud", cloud(x), y, suffixes=suffixes)]


def long_lines(folder: Path) -> list[Command]:
    """PLY as MeshLab writes it, with values that the header does not name."""
    x, y = bodies()
    passed, found = "that its header does not name; passed over", []
    ends = {
        "quality of vertices": (" 0.25", ""),
        "texture of faces": ("", " 6 0 0 1 0 1 1"),
        "both": (" 255 255", " 0.5"),
    }
    for name, own in ends.items():
        text = ply(x.mesh.vertices.tolist(), x.mesh.faces.tolist(), *own)
        file = f"{name.replace(' ', '_')}.ply"
        (folder / file).write_text(text, encoding="utf-8")
        words = passed, "can be matched"
        found.append(Command(name, ("info", file), words))
    match = matched(folder, "matched", x, y, words=(passed,))
    args = ("match", "both.ply", *match.args[2:])
    return [*found, match._replace(args=args)]


def far_away(folder: Path) -> list[Command]:
    """Coordinates of a survey, as 32-bit numbers."""
    x, _ = bodies()
    place, found = np.array([4.3e5, 5.6e6, 120.0]), []
    for name, scale, kind, code, words, unsaid in (
        ("a body", 1, "f4", 1, ("rounded to", "cannot be matched"), ()),
        ("a statue", 15, "f4", 0, ("rounded to", "can be matched"), ()),
        ("in doubles", 1, "f8", 0, ("can be matched",), ("rounded to",)),
    ):
        file = f"{name.replace(' ', '_')}.ply"
        write(
            folder / file,
            x.mesh._replace(vertices=scale * x.mesh.vertices + place),
            kind=kind,
        )
        if unsaid == ():
            words = (*words, "subtract the centre before the export")
        found.append(Command(name, ("info", file), words, code, unsaid))
    args = ("match", "a_body.ply", "in_doubles.ply", "--out", "map.npz")
    words = ("faces have no area", "subtract the centre before the export")
    return [*found, Command("matched", args, words, code=1)]


def dirty_clouds(folder: Path) -> list[Command]:
    """Outliers, a floor, a wall."""
    x, y = bodies()
    cases = {
        "outliers, 1 %": (with_outliers(x, 0.01), "as outliers"),
        "outliers, 5 %": (with_outliers(x, 0.05), "as outliers"),
        "a floor": (with_floor(x, 600, 1), "as a floor or wall"),
        "a wall": (with_floor(x, 900, 2), "as a floor or wall"),
    }
    found = []
    for name, (dirty, why) in cases.items():
        suffixes = (".xyz", ".ply")
        one = matched(
            folder, name, dirty, y, ("--repair",), suffixes, words=(f"removed, {why}",)
        )
        words = ("--repair would mend:", f"removed, {why}")
        found += [Command(f"{name}: info", ("info", one.args[1]), words), one]
    return found


def not_finite(folder: Path) -> list[Command]:
    """Vertices without a position."""
    (x, y), (z, w) = bodies(), bodies(OTHER)
    words = ("1 vertex with coordinates that are not finite removed",)
    one = matched(folder, "one in X", with_nan(x, 1), y, ("--repair",), words=words)
    words = ("9 vertices with coordinates that are not finite removed",)
    some = matched(
        folder,
        "some in both",
        with_nan(z, 9),
        with_nan(w, 3),
        ("--repair",),
        words=words,
    )
    refusal = ("are not finite", "--repair")
    return [
        *(one, some, refused(one, *refusal, name="without the option")),
        Command("info", ("info", one.args[1]), ("not finite: 1 of 1202",), code=1),
    ]


def torn_meshes(folder: Path) -> list[Command]:
    """Tunnels, loose pieces, edges of three faces."""
    found = []
    for names, tunnels, pieces, edges in ((PAIR, 8, 5, 20), (OTHER, 20, 12, 40)):
        x, y = (torn(own, tunnels, pieces, edges) for own in bodies(names))
        words = (f"{pieces} small components removed",)
        found.append(matched(folder, names[0], x, y, ("--repair",), words=words))
    refusal = ("6 connected components", "--largest-component", "--repair")
    words = ("separate pieces: 5 beside the largest", "--repair would mend")
    return [
        *(*found, refused(found[0], *refusal[:2], name="without the option")),
        Command("info", ("info", found[0].args[1]), words, code=1),
    ]


def concave_quads(folder: Path) -> list[Command]:
    """Quads that a fan would fold over."""
    x, _ = bodies()
    area, found = surface_area(x.mesh), []
    for suffix in (".obj", ".off", ".ply"):
        write_darts(folder / f"quads{suffix}", x.mesh)

        def error(path=folder / f"quads{suffix}"):
            return abs(surface_area(read(path)) / area - 1)

        words = (f"area │ {area:.6g}", "can be matched")
        args = ("info", f"quads{suffix}")
        checks = {"area": Check(error, 1e-6)}
        found.append(Command(suffix, args, words, checks=checks))
    return found


READING = {
    "two bodies in a file": FileSituation(
        "several bodies in a file",
        "refuses it and names `--largest-component`; with it, says how many pieces and "
        "how much of the area are left out",
        "`--components` matches all of them, `--largest-component` one",
        two_bodies,
    ),
    "stray vertices": FileSituation(
        "vertices that belong to no face",
        "leaves them out and says how many; they go where the nearest goes",
        "nothing",
        stray_vertices,
    ),
    "a stray triangle": FileSituation(
        "a triangle or crumbs beside the shape",
        '`jfsf info`: "separate pieces", with their number and area',
        "`--repair`, or `--largest-component`",
        stray_triangle,
    ),
    "formats": FileSituation(
        "`.vtk`, `.vtp`, `.gii`, `.xyz`, `.npy`, packed files (`.gz`, `.bz2`, `.xz`)",
        "reads them; for the first three it names what to install",
        "`pip install 'jfsf[vtk]'`, `'jfsf[gifti]'`",
        formats,
    ),
    "long lines": FileSituation(
        "ASCII PLY of MeshLab with more values on a line than its header names",
        "reads it, and says what it passed over",
        "nothing",
        long_lines,
    ),
    "far from the origin": FileSituation(
        "32-bit coordinates millions of metres from the origin",
        '"its coordinates are rounded to", and refuses the mesh if its faces are lost',
        "subtract the centre before the export, or store doubles",
        far_away,
    ),
    "outliers and floors": FileSituation(
        "a point cloud with outliers, the floor or a wall",
        "`jfsf info` and `jfsf match` count them",
        "`--repair` leaves them out",
        dirty_clouds,
    ),
    "not finite": FileSituation(
        "vertices whose coordinates are `nan`",
        "refuses the mesh and says how many there are",
        "`--repair` leaves them out, with their faces",
        not_finite,
    ),
    "torn meshes": FileSituation(
        "scans with tunnels, loose pieces and edges of three faces",
        "refuses the pieces; `jfsf info` counts them. Tunnels and such edges are no "
        "reason to refuse",
        "`--repair`",
        torn_meshes,
    ),
    "concave quads": FileSituation(
        "polygons that are concave",
        "splits them so that no triangle folds over",
        "nothing",
        concave_quads,
    ),
}

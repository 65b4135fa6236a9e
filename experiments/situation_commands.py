"""Rows of situations.py on commands: landmarks, batches, units, what is carried.

As `situation_reading.py`; `COMMANDS` names the makers.
"""

import json
from pathlib import Path

import numpy as np
from situation_files import body, landmark_vertices, torn, with_body, with_strays
from situation_formats import off, ply, write, write_landmarks
from situation_runs import (
    OTHER,
    Check,
    Command,
    FileSituation,
    bodies,
    map_error,
    matched,
    true_maps,
)
from transfer import true_map

from jfsf.apps.mapfiles import read_match, write_map
from jfsf.matching.parts import cut
from jfsf.mesh import vertex_colours
from jfsf.types import Mesh

# Without UTF-8: Python would take it in the locale C by itself.
ASCII = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}


def landmark_files(folder: Path) -> list[Command]:
    """Landmarks in the formats of 3D Slicer, MeshLab, spreadsheets, and as numbers."""
    x, y = bodies()
    files = {".mrk.json": ".fcsv", ".pp": ".csv", ".csv": ".mrk.json", ".fcsv": ".pp"}
    found = []
    for of_x, of_y in files.items():
        write_landmarks(folder / f"x{of_x}", x)
        write_landmarks(folder / f"y{of_y}", y)
        args = ("--landmarks-x", f"x{of_x}", "--landmarks-y", f"y{of_y}")
        words = ("5 paired by name", "are within 0 of their vertices")
        if ".fcsv" in (of_x, of_y):
            words = ("5 paired by name", "was taken to be in LPS")
        found.append(matched(folder, f"{of_x} {of_y}", x, y, args, words=words))
    rows = zip(landmark_vertices(x), landmark_vertices(y), strict=True)
    text = "".join(f"{i},{j}\n" for i, j in rows)
    (folder / "pairs.txt").write_text(text, encoding="utf-8")
    args = ("--landmarks", "pairs.txt")
    found.append(matched(folder, "two numbers a line", x, y, args))
    (folder / "far.txt").write_text("12,34\n5,99999\n", encoding="utf-8")
    args = (*found[-1].args[:-1], "far.txt")
    words = ("landmark 2 names vertex 99999 of Y", "counted from 1")
    return [*found, Command("a vertex that there is not", args, words, code=1)]


def pair_list(folder: Path) -> list[Command]:
    """A list for `jfsf batch` whose columns say how pairs differ, as Excel saves it."""
    x, y = bodies()
    cases = {
        "plain": (x, ",,,"),
        "torn": (torn(x, 8, 5, 20), "yes,,,"),
        "two": (with_body(x, body(OTHER[0])), ",yes,,"),
        "marked": (x, ",,marked.mrk.json,y.csv"),
    }
    write(folder / "y.off", y.mesh)
    write_landmarks(folder / "marked.mrk.json", x)
    write_landmarks(folder / "y.csv", y)
    rows = ["x,y,repair,largest_component,landmarks_x,landmarks_y"]
    for name, (own, options) in cases.items():
        write(folder / f"{name}.off", own.mesh)
        rows.append(f"{name}.off,y.off,{options}")
    (folder / "pairs.csv").write_bytes("\r\n".join(rows).encode("utf-8-sig"))
    error = lambda: max(
        map_error(folder / "maps" / f"{name}.off__y.off.npz", own, y)
        for name, (own, _) in cases.items()
    )
    words = (
        "5 small components removed",
        "--largest-component leaves out 1 other piece",
    )
    args = ("batch", "pairs.csv", "--out", "maps", "--workers", "1")
    whole = Command("four pairs", args, words, checks={"error": Check(error)})
    bad = "\r\n".join([*rows[:2], rows[2].replace("yes", "perhaps")])
    (folder / "bad.csv").write_text(bad, encoding="utf-8")
    args = ("batch", "bad.csv", "--out", "other")
    return [whole, Command("a wrong word", args, ("bad.csv", "perhaps"), code=1)]


def truth_on_strays(folder: Path) -> list[Command]:
    """Ground truth of which some points lie on vertices without a face."""
    x, y = (with_strays(own, n) for own, n in zip(bodies(), (3, 2), strict=True))
    found = []
    for name, mesh in (("x", x.mesh), ("y", y.mesh)):
        write(folder / f"{name}.off", mesh)
    points = [own.at[own.body.template_to_vertex[::100]] for own in (x, y)]
    for at, side in zip(points, "xy", strict=True):
        write_map(folder / f"{side}.vts", np.concatenate([[0, 1], at]))
        write_map(folder / f"{side}_lost.vts", np.array([0, 1]))
    args = ("evaluate", "x.off", "y.off", true_maps(folder, x, y))
    truth = ("--gt-x", "x.vts", "--gt-y", "y.vts", "--json", "figures.json")
    written = folder / "figures.json"
    number = len(points[0]) + 2
    words = (
        f"ground truth: 2 of {number} points are left out, on vertices that belong",
    )
    figures = lambda: json.loads(written.read_text(encoding="utf-8"))["figures"]
    checks = {"error": Check(lambda: figures()["error_mean"])}
    found.append(Command("some points", (*args, *truth), words, checks=checks))
    truth = ("--gt-x", "x_lost.vts", "--gt-y", "y_lost.vts")
    words = ("all 2 points are left out", "belong to no face")
    return [*found, Command("all points", (*args, *truth), words, code=1)]


def two_units(folder: Path) -> list[Command]:
    """A part and a whole, one of them in millimetres and the other in metres."""
    x, y = bodies()
    vertices = x.mesh.vertices
    half = cut(x.mesh, vertices[:, 1] > np.median(vertices[:, 1])).mesh
    for name, mesh in (("half", half), ("whole", y.mesh)):
        write(folder / f"{name}_m.off", mesh)
        write(folder / f"{name}_mm.off", Mesh(1000 * mesh.vertices, mesh.faces))
    found = []
    for one, other, small in (("mm", "m", "whole_m"), ("m", "mm", "half_m")):
        args = ("match", f"half_{one}.off", f"whole_{other}.off", "--out", "map.npz")
        words = ("millimetres", "metres", f"multiply the coordinates of {small}.off")
        found.append(Command(f"the part in {one}", (*args, "--partial"), words, code=1))
    return found


def other_locale(folder: Path) -> list[Command]:
    """Reports where the locale is not UTF-8, and names that it cannot hold."""
    x, y = bodies()
    found = []
    for name, own in (
        ("plain", {}),
        ("头部", {}),
        ("größe", {"PYTHONIOENCODING": "latin-1"}),
    ):
        page = f"{name}.html"
        args = ("--report", page)
        one = matched(folder, name, x, y, args, environment=ASCII | own)
        whole = Check(lambda page=page: _not_utf8(folder / page), 0)
        found.append(one._replace(checks=one.checks | {"page": whole}))
    return found


def _not_utf8(path: Path) -> float:
    """0 if a page is UTF-8, says so, and has its own name as it is; 1 if not."""
    try:
        text = path.read_bytes().decode("utf-8")
    except UnicodeDecodeError:
        return 1.0
    whole = 'charset="utf-8"' in text and not text.isascii() and path.stem in text
    return float(not whole)


def colours_of_a_file(folder: Path) -> list[Command]:
    """Y has colours of its own."""
    x, y = bodies()
    colours = np.random.default_rng(0).integers(0, 256, (len(y.mesh.vertices), 3))
    found = []
    for suffix, text in ((".ply", ply), (".off", off)):
        one = matched(folder, f"Y as {suffix}", x, y, suffixes=(".off", suffix))
        file, out = one.args[2], f"coloured_{suffix[1:]}.ply"
        rows = y.mesh.vertices.tolist(), y.mesh.faces.tolist()
        painted = text(*rows, colours=colours.tolist())
        (folder / file).write_text(painted, encoding="utf-8")

        def error(out=out, map_file=one.map):
            shown = vertex_colours(folder / out)
            T_xy = read_match(folder / map_file).T_xy
            away = np.asarray(shown)[:, :3] - colours[T_xy] / 255
            return float(np.abs(away).max())

        words = (f"exported in the vertex colours of {file}",)
        checks = one.checks | {"colours": Check(error, 1 / 255)}
        args = (*one.args, "--export", out)
        found.append(one._replace(args=args, words=words, checks=checks))
    return found


def from_zero(folder: Path) -> list[Command]:
    """A map in a text file that counts from 0."""
    x, y = bodies()
    for name, own in (("x", x), ("y", y)):
        write(folder / f"{name}.off", own.mesh)
    T_xy = true_map(x.body, y.body)
    T_xy[0] = 0
    write_map(folder / "zero.map", T_xy, base=0)
    args = ("evaluate", "x.off", "y.off", "zero.map")
    words = ("holds a 0, so it is not 1-based; pass --base 0",)
    return [
        Command("as it is", args, words, code=1),
        Command("with --base 0", (*args, "--base", "0"), ("coverage",)),
    ]


COMMANDS = {
    "landmark files": FileSituation(
        "landmarks in `.mrk.json`, `.fcsv`, `.pp`, a table, or as two numbers a line",
        "reads them, pairs them by name, and says which and how far they are from the "
        "mesh; RAS and LPS are told apart",
        "`--landmarks-x` and `--landmarks-y`, or `--landmarks`",
        landmark_files,
    ),
    "pairs that differ": FileSituation(
        "a list of pairs that need different options",
        "takes them from columns of the list; a wrong word is named, with its line",
        "titles such as `repair` and `landmarks_x` in the first line of the list",
        pair_list,
    ),
    "truth on strays": FileSituation(
        "ground truth on vertices that belong to no face",
        "leaves these points out, and says how many",
        "nothing",
        truth_on_strays,
    ),
    "two units": FileSituation(
        "a part in millimetres and a whole in metres, with `--partial`",
        "refuses them at once, names both units, and says which to multiply by what",
        "multiply the coordinates, or export again in one unit",
        two_units,
    ),
    "another locale": FileSituation(
        "a report, or names of files, where the locale is not UTF-8",
        "writes all text as UTF-8",
        "nothing",
        other_locale,
    ),
    "colours of a file": FileSituation(
        "`--export`, where Y's file has colours of its own",
        "gives X these colours, and says so",
        "`--by-place` colours Y by place instead",
        colours_of_a_file,
    ),
    "numbers from 0": FileSituation(
        "a text file of a map that counts from 0",
        "says so, and names the option",
        "`--base 0`",
        from_zero,
    ),
}

"""Rows of situations.py that are commands: how they are run, and what is measured."""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from protocol import RIGHT
from scipy.spatial import KDTree
from situation_files import Contents, body
from situation_formats import write
from transfer import true_map

import jfsf
from jfsf.apps.mapfiles import read_match, read_stored, write_map
from jfsf.evaluate import geodesic_error

POINTS, SEED = 250, 0  # of the ground truth
PAIR, OTHER = ("man_walk", "man_up"), ("woman_walk", "woman_up")
LONGEST = 300  # characters of a line that is kept
WIDTH = 200  # of the terminal: tables are not folded


class Check(NamedTuple):
    """An error that is measured when the command is done, and its limit."""

    error: Callable[[], float]
    limit: float = RIGHT


class Command(NamedTuple):
    """A run of `jfsf`.

    name: what is tried.
    args: what follows `jfsf`; files are in the folder.
    words: pieces of what it prints, all of which must be there.
    code: the exit code.
    unsaid: pieces that must not be there.
    checks: errors of what it wrote, by name, and how large they may be.
    map: the file of the map, whose confidence is kept too.
    environment: variables that are set.
    needs: a module without which it is skipped.
    """

    name: str
    args: tuple[str, ...]
    words: tuple[str, ...] = ()
    code: int = 0
    unsaid: tuple[str, ...] = ()
    checks: dict[str, Check] = {}
    map: str = ""
    environment: dict[str, str] = {}
    needs: str = ""


class FileSituation(NamedTuple):
    """A kind of files.

    what: people come with, in a phrase.
    says: what jfsf says or does, in markdown.
    remedy: what to do, likewise.
    commands: writes files into a folder and returns what is run there.
    """

    what: str
    says: str
    remedy: str
    commands: Callable[[Path], list[Command]]


def results_of(name: str, own: FileSituation, folder: Path) -> dict[str, Any]:
    """Run the commands of a situation, and print a line for each.

    Args:
        name: of the situation; its files go to a folder of that name.
        own: the situation.
        folder: for its files, and for programs, which later situations use too.
    """
    (files := folder / name.replace(" ", "_")).mkdir()
    rows = []
    for command in own.commands(files):
        rows.append(row_of(command, files, folder / "cache"))
        print(name, "|", line_of(rows[-1]), flush=True)
    done = [row for row in rows if "skipped" not in row]
    counts = {
        "commands": len(done),
        "as_expected": sum(row["expected"] for row in done),
        "skipped": len(rows) - len(done),
        "seconds": sum(row["seconds"] for row in done),
    }
    return {"what": own.what, "summary": counts, "commands": rows}


def line_of(row: dict[str, Any]) -> str:
    """A row in short."""
    if "skipped" in row:
        return f"{row['name']}: skipped, {row['skipped']}"
    errors = "".join(f" {name} {error:.3g}" for name, error in row["errors"].items())
    sure = f" confidence {row['confidence']:.3f}" if "confidence" in row else ""
    wrong = f"  NOT AS EXPECTED: {'; '.join(row['wrong'])}" if row["wrong"] else ""
    end = f"{row['seconds']:.1f} s{wrong}"
    return f"{row['name']}: exit {row['code']}{errors}{sure} {end}"


def row_of(command: Command, folder: Path, cache: Path) -> dict[str, Any]:
    """Run a command in a folder, and what came of it.

    Args:
        command: what is typed.
        folder: has its files.
        cache: of programs, for all commands.
    """
    row: dict[str, Any] = {
        "name": command.name,
        "command": " ".join(("jfsf", *command.args)),
    }
    if command.needs and find_spec(command.needs) is None:
        return row | {"skipped": f"needs {command.needs}"}
    package = str(Path(jfsf.__file__).parents[1])
    there = os.environ.get("PYTHONPATH")
    variables = {
        "JFSF_CACHE": str(cache),
        "COLUMNS": str(WIDTH),
        "PYTHONPATH": package if not there else f"{package}{os.pathsep}{there}",
        "PYTHONIOENCODING": "utf-8",
        **command.environment,
    }
    started = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "jfsf", *command.args],
        cwd=folder,
        env=os.environ | variables,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    row["seconds"] = time.perf_counter() - started
    row["code"] = done.returncode
    printed = done.stdout.decode(errors="replace").replace(f"{folder}{os.sep}", "")
    lines = [" ".join(line.split()) for line in printed.splitlines()]
    has = lambda text: any(text in line for line in lines)
    row["said"] = [
        line[:LONGEST] for line in lines if any(word in line for word in command.words)
    ]
    wrong = [f"exit code {row['code']}, not {command.code}"]
    wrong = wrong if row["code"] != command.code else []
    wrong += [f"did not say {text!r}" for text in command.words if not has(text)]
    wrong += [f"said {text!r}" for text in command.unsaid if has(text)]
    row["errors"] = {}
    if row["code"] == 0:
        for name, check in command.checks.items():
            row["errors"][name] = error = float(check.error())
            if not error <= check.limit:
                wrong.append(f"{name} {error:.3g}, above {check.limit:.3g}")
        if command.map:
            evidence = read_match(folder / command.map).certificate
            row["confidence"] = float(evidence.confidence)
    row["wrong"] = wrong
    if wrong:
        row["output"] = lines[-20:]
    return row | {"expected": not wrong}


def map_error(path: Path, x: Contents, y: Contents) -> float:
    """The mean geodesic error of T_xy in a file of a map, over sqrt(area).

    The images of the body's points, taken to the nearest vertex of the body.
    """
    stored = read_stored(path, n_x=len(x.mesh.vertices), n_y=len(y.mesh.vertices))
    T_xy = stored.T_xy
    if stored.index_x is not None:
        T_xy = np.full(len(x.mesh.vertices), -1)
        T_xy[stored.index_x] = np.asarray(stored.index_y)[stored.T_xy]
    gt_x, gt_y = x.body.template_to_vertex, y.body.template_to_vertex
    some = np.random.default_rng(SEED).permutation(len(gt_x))[:POINTS]
    images = T_xy[x.at[gt_x[some]]]
    places = y.mesh.vertices[images]
    if (images < 0).any() or not np.isfinite(places).all():
        return np.inf
    near = np.asarray(KDTree(y.body.mesh.vertices).query(places)[1])
    away = geodesic_error(near, y.body.mesh, np.arange(len(some)), gt_y[some])
    return float(away.mean())


def matched(
    folder: Path,
    name: str,
    x: Contents,
    y: Contents,
    args=(),
    suffixes=(".off",) * 2,
    **own,
) -> Command:
    """`jfsf match` of two bodies that are written here, and the error of its map."""
    stem = "".join(letter for letter in name if letter.isalnum())
    files = [f"{stem}_{side}{s}" for side, s in zip("xy", suffixes, strict=True)]
    for file, contents in zip(files, (x, y), strict=True):
        write(folder / file, contents.mesh)
    out = f"{stem}.npz"
    error = lambda: map_error(folder / out, x, y)
    full = ("match", *files, "--out", out, *args)
    return Command(name, full, checks={"error": Check(error)}, map=out, **own)


def bodies(names=PAIR) -> tuple[Contents, Contents]:
    """X and Y of a pair, of different numbers of vertices."""
    return body(names[0], "x"), body(names[1], "y")


def refused(command: Command, *words: str, name: str, without=1) -> Command:
    """The same without its last options: an error that says what to do."""
    args = command.args[: len(command.args) - without]
    return Command(name, args, words, code=1)


def true_maps(folder: Path, x: Contents, y: Contents, name: str = "true") -> str:
    """The file of the true map, between all vertices of the files."""
    T = np.zeros(len(x.mesh.vertices), int)
    T[x.at] = y.at[true_map(x.body, y.body)]
    write_map(folder / f"{name}.npz", T)
    return f"{name}.npz"

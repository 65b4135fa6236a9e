"""What a run of `jfsf collection` shows: on a pipe, on a terminal, and interrupted.

Matching and registration are stood in for: the meshes share their vertices.
"""

import csv
import gc
import os
import re
import subprocess
import sys
import threading
import time
import weakref
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from jfsf import testing
from jfsf.apps.cli._app import app
from jfsf.apps.cli._collection_jobs import RECENT, Sketches
from jfsf.apps.cli._collection_results import in_doubt
from jfsf.apps.cli._collection_runner import KEPT, STAGES
from jfsf.apps.cli._look import doubts
from jfsf.apps.cli._runs import _kept
from jfsf.apps.cli._stages import Stage, duration
from jfsf.apps.collections import _member
from jfsf.apps.registration import Registration
from jfsf.types import Certificate, Match, Mesh

distributed = pytest.importorskip("distributed")
BLOB = testing.blob(0)
N = len(BLOB.vertices)


def blob(i):
    """One of many like shapes with the same faces."""
    vertices = BLOB.vertices * [1, 1 + 0.02 * i, 1 - 0.01 * i]
    return Mesh(vertices, BLOB.faces)


def write(path, *meshes):
    pieces = [trimesh.Trimesh(*mesh, process=False) for mesh in meshes]
    trimesh.util.concatenate(pieces).export(path)


@pytest.fixture(scope="module")
def scans(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scans")
    for i in range(3):
        write(folder / f"{i}.ply", blob(i))
    write(folder / "inches.ply", Mesh(25.4 * blob(3).vertices, BLOB.faces))
    small = testing.blob(1)
    small = small._replace(vertices=0.1 * small.vertices + 9)
    write(folder / "two.ply", blob(4), small)
    return folder


def same_vertices(x, y, **_):
    values = {"orientation": 0.9, "finite": True, "confidence": 0.99, "shear": 0.1}
    values |= {"landmarks": np.zeros(0), "region_cost": np.nan}
    names = Certificate._fields
    sure = Certificate(*(jnp.asarray(values.get(name, 0.0)) for name in names))
    own = np.arange(N, dtype=np.int32)
    radius = jnp.full(N, 0.02)
    return Match(own, own, jnp.eye(3), sure, radius_x=radius, radius_y=radius)


def at_vertices(x, y, T, **_):
    zero, none = np.zeros(N, int), np.zeros(N, bool)
    away = np.full(N, 0.01), none, zero, np.zeros((N, 3)), 0, 0, 1.0, 1
    return Registration(np.asarray(y.vertices)[np.asarray(T)], *away)


@pytest.fixture(scope="module")
def collected(scans, tmp_path_factory):
    """A function that runs the command, in workers that are threads of this process."""
    out = tmp_path_factory.mktemp("out") / "model"
    with (
        pytest.MonkeyPatch.context() as patch,
        distributed.Client(
            processes=False, n_workers=1, threads_per_worker=2, dashboard_address=":0"
        ) as client,
    ):
        patch.setenv("JFSF_CACHE", str(out.parent / "cache"))
        for room in ("jfsf.matching.match", "jfsf.apps.collections._member.match"):
            patch.setattr(room, same_vertices)
        patch.setattr(_member, "register", at_vertices)
        args = "collection", scans, "--out", out, "--scheduler"
        yield out, [str(arg) for arg in (*args, client.scheduler.address)]


def read_all(terminal):
    """What is written to a pseudo terminal until its other end is closed: in a list."""
    seen = []

    def read():
        with suppress(OSError):  # the end
            while text := os.read(terminal, 1 << 16):
                seen.append(text)
        os.close(terminal)

    reader = threading.Thread(target=read)
    reader.start()
    return seen, reader


def test_a_log_tells_each_step_and_what_is_unfit(collected, scans):
    out, args = collected
    done = CliRunner().invoke(app, args)
    assert done.exit_code == 1, done.output
    lines = done.stdout.splitlines()
    at = lambda words: next(i for i, line in enumerate(lines) if words in line)
    # Before any pair: what is unfit, and what mends it.
    first = at(" pairs 1/")
    assert lines[0] == "looked at 5 meshes: 4 can be matched"
    assert lines[1].startswith(f"{scans / 'two.ply'}: ") and re.search(
        "--largest-component mends it: leaves out 1 other piece with 162 vertices",
        lines[1],
    )
    assert "until --largest-component is added" in lines[2]
    assert at("inches.ply: is 25") < first
    # A line with times for each shape, pair and map; what is left once it is known.
    step = r"\d\d:\d\d:\d\d {} {}: {}, \d+\.\d s"
    of = lambda *stage: [s for s in lines if re.match(step.format(*stage), s)]
    shapes = of("shapes", "./4", ".+")
    assert len(shapes) == 4 and re.search(r"; \d+ s left$", shapes[0])
    assert len(of("pairs", r"\d+/\d+", r"\w+, \w+")) >= 3
    assert len(of("maps", "./4", ".+")) == 4
    # Files of others in the same folder are kept when the option is added; pages, which
    # would show what was known before, are not.
    for page in ("index.html", "model.html"):
        (out / page).write_text("of an earlier run")
    before = {path: path.stat().st_mtime_ns for path in out.glob("*/*.npz")}
    done = CliRunner().invoke(app, [*args, "--largest-component"])
    assert done.exit_code == 0, done.output
    assert "looked at 5 meshes: 5 can be matched" in done.stdout
    assert not [*out.glob("*.html")]
    for part in ("shapes", "pairs"):
        kept = [path for path in before if path.parent.name == part]
        assert kept and all(path.stat().st_mtime_ns == before[path] for path in kept)
    with (out / "summary.csv").open() as file:
        rows = {row["name"]: row for row in csv.DictReader(file)}
    for row in rows.values():
        figures = {name: float(row[name]) for name in row if "_" in name}
        assert figures["mean_in_unit"] == pytest.approx(0.01)
        of_size = figures["mean_in_unit"] / figures["rms_size"]
        assert figures["mean_of_size"] == pytest.approx(of_size)
    size = [float(rows[name]["rms_size"]) for name in ("inches", "0")]
    assert size[0] / size[1] == pytest.approx(25.4, rel=0.1)


def test_a_terminal_shows_all_stages_beforehand(collected, monkeypatch, capsys):
    pty = pytest.importorskip("pty")
    out, args = collected
    for path in out.glob("registered/*.npz"):  # so that something is done
        path.unlink()
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")
    shown, terminal = pty.openpty()
    seen, reader = read_all(shown)
    with os.fdopen(terminal, "w") as stream, monkeypatch.context() as patch:
        patch.setattr(sys, "stderr", stream)
        app([*args, "--largest-component"], standalone_mode=False)
    reader.join()
    text = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", b"".join(seen).decode())
    begun = text[: text.index("registered", text.index("model"))]
    assert all(re.search(rf"{name} .*estimating", begun) for name in STAGES)
    assert re.search(r"registered .*5/5 done, \d+ s", text)
    assert re.search(r"mirror images .*0/0 not needed", text)
    assert "estimating" not in text[text.rindex("files") :].split("mirror")[0]
    # The log, which is no terminal, has its lines all the same.
    assert "registered 5/5: " in capsys.readouterr().out


def test_landmarks_are_carried_by_templates_and_checked(collected, scans, tmp_path):
    out, args = collected
    args = [*args, "--largest-component", "--template", str(scans / "0.ply")]
    at, people = [3, 40, 77, 110], tmp_path / "people"
    people.mkdir()
    sizes = {"0": 1.0, "1": 1.0, "inches": 25.4}

    def place(path, mesh):
        rows = [f"p{i},{x},{y},{z}" for i, (x, y, z) in enumerate(mesh.vertices[at])]
        path.write_text("\n".join(["name,x,y,z", *rows, ""]))

    place(marks := tmp_path / "0.csv", blob(0))
    shapes = {"0": blob(0), "1": blob(1), "inches": blob(3)}
    for name, mesh in shapes.items():
        off = mesh.vertices + [0.03, 0, 0]
        place(people / f"{name}.csv", Mesh(sizes[name] * off, mesh.faces))

    def table(name):
        with (out / name).open() as file:
            return list(csv.DictReader(file))

    def run(*more):
        done = CliRunner().invoke(app, [*args, "--landmarks", str(marks), *more])
        assert done.exit_code == 0, done.output
        return done.stdout

    said = run("--check-landmarks", str(people))
    assert "8 landmarks that people placed on 2 shapes" in said
    assert "check these landmarks first" in said and not (out / "templates").exists()
    one = (out / "landmarks.csv").read_bytes()
    for row in table("landmarks.csv"):  # as the registered template has them
        with np.load(out / "registered" / f"{row.pop('specimen')}.npz") as file:
            points = file["vertices"][at]
        found = [float(x) for x in row.values()]
        np.testing.assert_allclose(found, points.ravel(), atol=1e-6)
    # Errors and radii are in the unit of the file.
    errors = {name: 0.03 * sizes[name] for name in ("1", "inches")}
    for row in table("check.csv"):
        name = row["specimen"]
        assert float(row["error"]) == pytest.approx(errors[name], rel=1e-4)
        root = np.sqrt(trimesh.Trimesh(*shapes[name]).area) * sizes[name]
        assert float(row["radius"]) == pytest.approx(0.02 * root, rel=1e-4)
    # More templates: a stage of its own, and nothing that was made is made again.
    before = {path: path.stat().st_mtime_ns for path in out.glob("*/*.npz")}
    said = run("--templates", "3")
    assert re.search(r"other templates 20/20: ", said)
    others = sorted(path.name for path in (out / "templates").iterdir())
    named = re.findall(r"also (\w+),", " ".join(said.split()))
    assert sorted(named) == others and len(others) == 2
    assert all(path.stat().st_mtime_ns == date for path, date in before.items())
    several = sorted(out.glob("templates/*/registered/*.npz"))
    assert len(several) == 10
    for row, old in zip(
        table("landmarks.csv"), one.decode().splitlines()[1:], strict=True
    ):
        found = [float(x) for x in [*row.values()][1:]]
        np.testing.assert_allclose(found, np.array(old.split(",")[1:], float), 1e-6)
    # Stopped and run again: only what is missing is made, to the same bytes.
    table_of_all = (out / "landmarks.csv").read_bytes()
    dates = {path: path.stat().st_mtime_ns for path in several[1:]}
    whole = several[0].read_bytes()
    several[0].unlink()
    made = re.findall(r"other templates \d+/\d+: (\w+),", run("--templates", "3"))
    assert made == [several[0].stem]
    assert several[0].read_bytes() == whole
    assert all(path.stat().st_mtime_ns == date for path, date in dates.items())
    assert table_of_all == (out / "landmarks.csv").read_bytes()
    # People's landmarks on the template and on "1", which is a template then.
    marks = people
    run()
    (row,) = (row for row in table("landmarks.csv") if row["specimen"] == "1")
    own = (shapes["1"].vertices + [0.03, 0, 0])[at]
    np.testing.assert_allclose([float(x) for x in [*row.values()][1:]], own.ravel())
    assert (out / "templates" / "1").is_dir()
    marks = tmp_path / "0.csv"
    run()
    assert (out / "landmarks.csv").read_bytes() == one
    done = CliRunner().invoke(app, [*args, "--templates", "2"])
    assert done.exit_code == 1 and "give --landmarks" in done.output


def test_what_is_odd_beside_the_others_is_named():
    def one(mesh, factor=1.0):
        signature = factor * np.sqrt(np.arange(1, 31) / 30)
        return SimpleNamespace(mesh=mesh, sketch=SimpleNamespace(signature=signature))

    whole = [one(blob(i)) for i in range(3)]
    assert doubts("abc", whole) == []
    half = Mesh(BLOB.vertices, BLOB.faces[BLOB.vertices[BLOB.faces, 2].min(1) > 0])
    odd = [one(half), one(BLOB._replace(vertices=BLOB.vertices / 100)), one(BLOB, 2)]
    said = doubts("abcdef", whole + odd)
    assert [line[0] for line in said] == ["d", "e", "f"]
    for line, words in zip(
        said, ("is open", "100 times as small", "kind"), strict=True
    ):
        assert words in line


def test_joined_shapes_in_doubt_are_named_the_least_sure_first():
    trusts = {"sure": 0.96, "low": 0.71, "out": 0.5, "half": 0.9, "template": 1.0}
    rows = [
        {"name": name, "trust": trust, "reason": "why" * (name == "out")}
        for name, trust in trusts.items()
    ]
    lines = in_doubt(rows)
    assert [line.split(": ")[1] for line in lines] == ["low", "half"]
    assert "with 71% probability" in lines[0]
    many = in_doubt(20 * rows)
    assert len(many) == 11 and many[-1] == "  and 30 more: trust in summary.csv"


def test_time_left_follows_from_what_was_measured():
    stage = Stage("pairs", total=10, earlier=4)
    assert stage.said(0) == "estimating"
    stage.made, stage.took, stage.since = 2, 6.0, 100.0
    assert stage.left(101) == 11 and stage.said(101) == "11 s left"
    assert stage.left(200) == 0
    stage.made = 6
    assert stage.said(200) == "done, 6 s"
    assert [duration(s) for s in (9, 240, 9000)] == ["9 s", "4 min", "2 h 30 min"]


def test_what_is_kept_is_counted(tmp_path):
    assert _kept(tmp_path, KEPT).startswith("nothing is kept yet")
    for name, n in (("shapes", 10), ("pairs", 15), ("maps", 1)):
        (tmp_path / name).mkdir()
        for i in range(n):
            (tmp_path / name / f"{i}.npz").touch()
    said = "10 shapes, 15 pairs and 1 map are kept; run the same command to go on"
    assert _kept(tmp_path, KEPT) == said


XLA_LOGS = "TF_CPP_MIN_LOG_LEVEL"  # 3: nothing but what ends the process
# In place of a shell: Ctrl-C on its terminal reaches all that it starts.
RUN = """
import fcntl, signal, termios
if __name__ == "__main__":
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    from jfsf.__main__ import main
    main()
"""


def test_control_c_ends_a_run_with_one_line(scans, tmp_path):
    pty = pytest.importorskip("pty")
    import psutil

    (script := tmp_path / "run.py").write_text(RUN)
    out, (shown, terminal) = tmp_path / "out", pty.openpty()
    args = "collection", scans, "--out", out, "--workers", "1"
    env = {name: v for name, v in os.environ.items() if name != XLA_LOGS}
    env |= {"JFSF_CACHE": str(tmp_path / "cache"), "TERM": "xterm"}
    running = subprocess.Popen(
        [sys.executable, script, *args],
        stdin=terminal,
        stdout=terminal,
        stderr=terminal,
        start_new_session=True,
        env=env | {"PYTHONPATH": str(Path(__file__).parents[1])},
    )
    os.close(terminal)
    seen, reader = read_all(shown)
    try:
        while len(list(out.glob("shapes/[!.]*.npz"))) < 4:
            assert running.poll() is None, b"".join(seen)
            time.sleep(0.1)
        workers = psutil.Process(running.pid).children(recursive=True)
        assert all(one.environ()[XLA_LOGS] == "3" for one in workers)
        os.write(shown, b"\x03")
        assert running.wait(timeout=60) == 130
    finally:
        running.kill()
    reader.join()
    # A character that was being written when it was interrupted may be cut.
    text = b"".join(seen).decode(errors="replace")
    said = "stopped; 4 shapes are kept; run the same command to go on"
    assert text.endswith(f"{said}\r\n") and "Traceback" not in text
    assert "distributed" not in text and "warn" not in text.lower()
    assert workers and not psutil.wait_procs(workers, timeout=60)[1]
    assert not list(out.rglob("*.tmp"))


def files_of(folder):
    """Bytes and date of all files, by name."""
    files = (path for path in folder.rglob("*") if path.is_file())
    of = lambda path: (path.read_bytes(), path.stat().st_mtime_ns)
    return {str(path.relative_to(folder)): of(path) for path in files}


@pytest.fixture(scope="module")
def model(collected, scans, tmp_path_factory):
    """A finished collection with landmarks, curves and patches."""
    folder = tmp_path_factory.mktemp("model")
    marks, lines = folder / "marks.csv", folder / "lines.csv"
    rows = [f"m{i},{x},{y},{z}" for i, (x, y, z) in enumerate(BLOB.vertices[:4])]
    marks.write_text("\n".join(["name,x,y,z", *rows, ""]))
    lines.write_text("curve,edge,3,m0,m1\npatch,face,4,1,m1,m2\n")
    np.save(folder / "heights.npy", BLOB.vertices[:, 2])
    (folder / "scans").mkdir()
    for i in range(3):
        (folder / "scans" / f"{i}.ply").symlink_to(scans / f"{i}.ply")
    args = ["collection", folder / "scans", "--out", folder / "model"]
    args += ["--template", folder / "scans" / "0.ply", "--landmarks", marks]
    args += ["--values", folder / "heights.npy", "--semilandmarks", lines]
    done = CliRunner().invoke(app, [*map(str, args), *collected[1][-2:]])
    assert done.exit_code == 0, done.output
    return folder / "model"


def test_semilandmarks_follow_on_landmarks(model):
    with (model / "landmarks.csv").open() as file:
        rows = list(csv.reader(file))
    titles = [name[:-2] for name in rows[0][1::3]]
    edge, face = (
        [f"{n}_{i}" for i in range(1, k)] for n, k in (("edge", 4), ("face", 5))
    )
    assert titles == ["m0", "m1", "m2", "m3", *edge, *face]
    table = np.array(rows[1:], float)[:, 1:].reshape(3, -1, 3)
    np.testing.assert_allclose(table[0, :4], BLOB.vertices[:4], atol=1e-6)
    # The deformation is linear, and points on faces go along.
    np.testing.assert_allclose(table[2], table[0] * [1, 1.04, 0.98], atol=1e-6)
    slide = (model / "curveslide.csv").read_text().split()
    assert slide == ["before,slide,after", "1,5,6", "5,6,7", "6,7,2"]
    assert (model / "surfslide.csv").read_text().split() == [
        "surface",
        *"89",
        "10",
        "11",
    ]


def onto(model, client, folder, out, numbers, *more):
    folder.mkdir(exist_ok=True)
    for i in numbers:
        if not (path := folder / f"new{i}.ply").exists():
            write(path, blob(i))
    args = "collection", folder, "--onto", model, "--out", out, *more, *client
    return CliRunner().invoke(app, list(map(str, args)))


def test_new_shapes_join_a_frozen_model_each_by_itself(collected, model, tmp_path):
    client, before = collected[1][-2:], files_of(model)
    one, two = tmp_path / "one", tmp_path / "two"
    done = onto(model, client, tmp_path / "a", one, [6])
    assert done.exit_code == 0, done.output
    done = onto(model, client, tmp_path / "b", two, [5, 6])
    assert done.exit_code == 0, done.output
    assert files_of(model) == before  # bytes and dates
    alone, together = files_of(one), files_of(two)
    mine = [name for name in alone if "new6" in name]
    assert {"registered/new6.npz", "maps/new6.npz", "landmarks/new6.fcsv"} < set(mine)
    assert all(together[name][0] == alone[name][0] for name in mine)
    for name in ("summary.csv", "scores.csv", "landmarks.csv"):
        rows = [text[name][0].splitlines() for text in (alone, together)]
        assert rows[0][0] == rows[1][0] and set(rows[0]) < set(rows[1])
    for name in ("curveslide.csv", "surfslide.csv"):
        assert alone[name][0] == before[name][0]
    # The scores are those of the shape as it lies; those of an old one are its own.
    from jfsf.apps.model import read_model, scores_of

    with np.load(one / "registered" / "new6.npz") as file:
        np.testing.assert_allclose(file["vertices"], blob(6).vertices, atol=1e-6)
    known = read_model(model / "model.npz")
    row = (one / "scores.csv").read_text().splitlines()[1].split(",")
    own = blob(6).vertices - blob(6).vertices.mean(0)
    np.testing.assert_allclose(
        np.array(row[1:], float), scores_of(known, own), atol=1e-5
    )
    heights = np.load(one / "values" / "new6.npy")
    np.testing.assert_allclose(heights, BLOB.vertices[:, 2], atol=1e-6)
    # What is there counts, and what is lost is made again, to the byte.
    (one / "registered" / "new6.npz").unlink()
    dates = {name: date for name, (_, date) in files_of(one).items()}
    assert onto(model, client, tmp_path / "a", one, [6]).exit_code == 0
    again = files_of(one)
    assert {n: text for n, (text, _) in again.items()} == {
        n: text for n, (text, _) in alone.items()
    }
    for name in ("pairs/0__new6.npz", "maps/new6.npz", "placed/new6.npz"):
        assert again[name][1] == dates[name]


def test_what_no_trusted_map_reaches_is_left_out_of_a_frozen_model(
    collected, model, tmp_path, monkeypatch
):
    sure = same_vertices

    def doubtful(x, y, **options):
        found, new = sure(x, y), np.allclose(y.vertices, blob(7).vertices, atol=1e-5)
        low = found.certificate._replace(confidence=jnp.asarray(0.05))
        return found._replace(certificate=low) if new else found

    monkeypatch.setattr("jfsf.matching.match", doubtful)
    done = onto(model, collected[1][-2:], tmp_path / "a", tmp_path / "out", [6, 7])
    said = " ".join(done.output.split())
    assert done.exit_code == 1
    assert "new7.ply: no trusted map leads to it" in said and "0 (0." in said
    with (tmp_path / "out" / "summary.csv").open() as file:
        rows = {row["name"]: row["reason"] for row in csv.DictReader(file)}
    assert rows["new6"] == "" and rows["new7"].startswith("no trusted map")
    assert (tmp_path / "out" / "registered" / "new6.ply").exists()
    assert not (tmp_path / "out" / "registered" / "new7.ply").exists()


def test_what_is_no_finished_collection_is_refused(collected, model, scans, tmp_path):
    client, out = collected[1][-2:], tmp_path / "out"
    refused = lambda *args: " ".join(onto(*args).output.split())
    assert "settings.json: No such file" in refused(scans, client, scans, out, [])
    begun = tmp_path / "begun"
    for name in ("settings.json", "summary.csv"):
        begun.mkdir(exist_ok=True)
        (begun / name).write_bytes((model / name).read_bytes())
    said = refused(begun, client, tmp_path / "a", out, [6])
    assert "is no finished collection (3 shapes without maps" in said
    (begun / "summary.csv").write_text("name\n0\n")
    assert "is damaged" in refused(begun, client, tmp_path / "a", out, [6])
    write(tmp_path / "a" / "1.ply", blob(6))
    said = refused(model, client, tmp_path / "a", out, [6])
    assert "1.ply:" in said and "has a shape of this name" in said
    (tmp_path / "a" / "1.ply").unlink()
    said = refused(model, client, tmp_path / "a", model, [6])
    assert "stays as it is" in said
    options = (("--orientation", "any"), "made with --orientation preserve")
    options = [options, (("--scale",), "omit --scale")]
    other = tmp_path / "a" / "new6.ply"
    options.append((("--template", other), "is not the file of 0, the template"))
    for more, words in options:
        assert words in refused(model, client, tmp_path / "a", out, [6], *more)
    assert not out.exists()


def test_landmarks_are_paired_by_the_symmetry_of_the_template(
    collected, model, tmp_path, monkeypatch
):
    asked = []

    def mirrored(mesh):
        asked.append(mesh)
        order = np.arange(N)  # the first two are exchanged, the third goes astray
        order[[0, 1, 2]] = 1, 0, BLOB.vertices[:, 2].argmin()
        return SimpleNamespace(T_xy=order, certificate=SimpleNamespace(confidence=0.9))

    monkeypatch.setattr("jfsf.matching.symmetry", mirrored)
    client, folder, out = collected[1][-2:], model.parent, tmp_path / "out"
    args = ["collection", folder / "scans", "--out", out, "--symmetric"]
    done = CliRunner().invoke(app, list(map(str, args)))
    assert done.exit_code == 1 and "give --landmarks too" in done.output
    args += ["--template", folder / "scans" / "0.ply"]
    args += ["--landmarks", folder / "marks.csv", *client]
    for _ in range(2):
        done = CliRunner().invoke(app, list(map(str, args)))
        assert done.exit_code == 0, done.output
        said = " ".join(done.output.split())
        assert "confidence 0.90: 1 pair of landmarks, 1 on the midline, 1" in said
        assert ": 'm2'; write their partners in landmark_pairs.csv" in said
        rows = (out / "landmark_pairs.csv").read_text().split()
        assert rows[0] == "left,right" and rows[1] in ("1,2", "2,1")
        assert rows[2:] == ["3,"]
    assert len(asked) == 1  # the second run reads what the first one found
    args.remove("--symmetric")
    assert CliRunner().invoke(app, list(map(str, args))).exit_code == 0
    assert not (out / "landmark_pairs.csv").exists()


def test_few_sketches_are_held_whatever_the_number_of_shapes():
    class Sketch:
        pass

    class Shapes(dict):
        def __getitem__(self, name):
            return SimpleNamespace(sketch=Sketch())

    sketches = Sketches(Shapes.fromkeys(range(3 * RECENT)))
    first = weakref.ref(sketches[0])
    assert sketches[0] is first() and len(sketches) == 3 * RECENT
    held = [weakref.ref(one) for one in sketches]
    gc.collect()
    assert first() is None and sum(one() is not None for one in held) == RECENT

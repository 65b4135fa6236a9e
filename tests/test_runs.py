"""Long runs: results are kept, failures are reported, the other jobs are done."""

import io
import json
import os
import re
import signal
import subprocess
import sys
import time
import zipfile
from functools import partial
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from shapes import write_off
from typer.testing import CliRunner

from jfsf import testing
from jfsf.apps.cli import _batch_jobs
from jfsf.apps.cli._app import app
from jfsf.apps.cli._pair import pages_of
from jfsf.apps.cli._runs import DRAWING, note_drawing
from jfsf.apps.mapfiles import read_match, read_notes
from jfsf.batch._cluster import connect
from jfsf.batch._jobs import Job, run_jobs
from jfsf.batch._pair_list import PairOptions, read_pairs
from jfsf.types import STAGES, Certificate, Match, MatchInfo, Mesh

dask = pytest.importorskip("dask")
distributed = pytest.importorskip("distributed")
ROOT = Path(__file__).parents[1]


# The work in place of matching, slow enough to be killed in the middle.
def prepare(path):
    with (path.parent / "prepared.log").open("a") as log:
        log.write(path.name + "\n")
    if path.read_text() == "bad":
        raise ValueError(f"{path}: is bad")


def work(job):
    time.sleep(0.1)
    text = "".join(path.read_text() for path in job.inputs)
    if text == "crash":
        raise ZeroDivisionError("by zero")
    if "deadly" in text:
        os._exit(1)
    if "fragile" in text and not (mark := job.out.with_suffix(".mark")).exists():
        mark.touch()
        os._exit(1)
    part = job.out.with_suffix(".tmp")
    part.write_text(text)
    part.replace(job.out)


@pytest.fixture(scope="module")
def client():
    """Workers that are threads of this process."""
    with distributed.Client(
        processes=False, n_workers=1, threads_per_worker=2, dashboard_address=":0"
    ) as client:
        yield client


def jobs_of(folder, pairs, **texts):
    for name in sorted(set("".join(pairs))):
        if not (path := folder / name).exists():
            path.write_text(texts.get(name, name))
    return [
        Job(tuple(folder / name for name in pair), folder / f"{pair}.out")
        for pair in pairs
    ]


def outcomes(jobs, client):
    found = {
        o.job.out.stem: o for o in run_jobs(jobs, client, prepare=prepare, work=work)
    }
    assert len(found) == len(jobs)
    return found


def test_each_input_is_prepared_once(client, tmp_path):
    steps = []
    jobs = jobs_of(tmp_path, ["ab", "bc", "ca", "aa"])
    found = list(
        run_jobs(
            jobs,
            client,
            prepare=prepare,
            work=work,
            progress=lambda *step: steps.append(step),
        )
    )
    assert {o.job for o in found} == set(jobs)
    assert all(o.reason is None and not o.earlier and o.seconds > 0 for o in found)
    assert [job.out.read_text() for job in jobs] == ["ab", "bc", "ca", "aa"]
    log = (tmp_path / "prepared.log").read_text().split()
    assert sorted(log) == ["a", "b", "c"]
    assert steps == [(0, 3), (1, 3), (2, 3), (3, 3)]


def test_failures_are_reported_and_the_other_jobs_done(client, tmp_path):
    jobs = jobs_of(tmp_path, ["ab", "bc", "cd", "de"], b="bad", d="crash", e="")
    (tmp_path / "c").unlink()
    found = outcomes([*jobs, *jobs_of(tmp_path, ["fg"])], client)
    assert found["ab"].reason == found["bc"].reason == f"{tmp_path / 'b'}: is bad"
    assert "No such file" in found["cd"].reason and str(tmp_path / "c") in (
        found["cd"].reason
    )
    assert found["de"].reason == "ZeroDivisionError: by zero"
    assert found["fg"].reason is None
    assert [path.name for path in tmp_path.glob("*.out")] == ["fg.out"]


def test_only_what_is_not_done_is_done(client, tmp_path):
    jobs = jobs_of(tmp_path, ["ab", "bc", "cd", "ef"])
    outcomes(jobs, client)
    for job in jobs:
        os.utime(job.out, (2e9, 2e9))
    os.utime(tmp_path / "d", (3e9, 3e9))  # edited since
    (tmp_path / "a").unlink()
    (tmp_path / "prepared.log").unlink()
    found = outcomes(jobs, client)
    assert found["bc"].earlier and found["ef"].earlier and not found["cd"].earlier
    assert "No such file" in found["ab"].reason
    assert (tmp_path / "bc.out").stat().st_mtime == 2e9
    assert sorted((tmp_path / "prepared.log").read_text().split()) == list("abcd")


def test_two_jobs_want_one_file(client, tmp_path):
    one, two = jobs_of(tmp_path, ["ab", "cd"])
    with pytest.raises(ValueError, match="ab.out is the file of .*a and .*b and of"):
        list(
            run_jobs(
                [one, two._replace(out=one.out)], client, prepare=prepare, work=work
            )
        )


DRIVER = """
import sys
from pathlib import Path
from jfsf.batch._cluster import connect
from test_runs import outcomes, jobs_of
if __name__ == "__main__":
    with connect(workers=2) as client:
        found = outcomes(jobs_of(Path(sys.argv[1]), sys.argv[2:]), client)
        assert all(o.reason is None for o in found.values()), found
        print(sum(o.earlier for o in found.values()))
"""


def process(*command, **env):
    paths = os.pathsep.join([str(ROOT), str(ROOT / "tests")])
    return subprocess.Popen(
        [sys.executable, *map(str, command)],
        env={**os.environ, "PYTHONPATH": paths, "JAX_PLATFORMS": "cpu", **env},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def kill_when(process, there, count, seconds):
    """SIGKILL once `there()` counts that many."""
    try:
        for _ in range(10 * seconds):
            if there() >= count:
                break
            assert process.poll() is None, process.communicate()
            time.sleep(0.1)
        process.send_signal(signal.SIGKILL)
    finally:
        process.kill()
        process.communicate()


@pytest.mark.slow
def test_a_killed_run_goes_on_where_it_was(tmp_path):
    (driver := tmp_path / "driver.py").write_text(DRIVER)
    pairs = [a + b for a in "abcdefgh" for b in "abcd"]
    folder = tmp_path / "run"
    folder.mkdir()
    made = lambda: len(list(folder.glob("*.out")))
    kill_when(process(driver, folder, *pairs), made, 3, 300)
    before = {path: path.stat().st_mtime_ns for path in folder.glob("*.out")}
    assert 3 <= len(before) < len(pairs)
    again = process(driver, folder, *pairs)
    output, errors = again.communicate(timeout=400)
    assert again.returncode == 0, errors
    assert made() == len(pairs) and int(output) == len(before)
    for pair in pairs:
        assert (folder / f"{pair}.out").read_text() == pair
    assert all(path.stat().st_mtime_ns == then for path, then in before.items())


@pytest.mark.slow
def test_a_killed_worker_is_replaced(tmp_path):
    texts = {"b": "deadly", "c": "fragile"}
    jobs = jobs_of(tmp_path, ["ab", "ac", "ad", "dd"], **texts)
    # Each death costs seconds: one is enough to suspect a job.
    once = dask.config.set({"distributed.scheduler.allowed-failures": 0})
    with once, connect(workers=2) as client:
        found = outcomes(jobs, client)
    assert "KilledWorker: Attempted to run" in str(found["ab"].reason)
    for name in ("ac", "ad", "dd"):
        assert found[name].reason is None, found[name]
        assert (tmp_path / f"{name}.out").exists()


def test_connect_refuses():
    with pytest.raises(ValueError, match="workers is 0"), connect(workers=0):
        pass
    with (
        pytest.raises(ValueError, match="those of here:1"),
        connect("here:1", workers=1),
    ):
        pass


def test_a_scheduler_that_is_not_there():
    with pytest.raises(OSError, match="no dask scheduler answers at tcp://127"):
        with connect("tcp://127.0.0.1:9", timeout=1):
            pass


def test_dask_is_optional(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ImportError, match=r"pip install 'jfsf\[batch\]'"), connect():
        pass


def test_pairs_are_read(tmp_path):
    path = tmp_path / "pairs.csv"
    path.write_text(
        '\ufeffX, Y\n# both of one person\na.off, sub/b.off\n\n"c,d.off",/e/f.obj\n'
        "a.off,sub/b.off\n../g.off,a.off\n"
        f"{tmp_path}/sub/b.off,{tmp_path.parent}/other/g.off\n",
        encoding="utf-8",
    )
    found = read_pairs(path)
    assert [(pair.x, pair.y) for pair in found] == [
        (tmp_path / "a.off", tmp_path / "sub/b.off"),
        (tmp_path / "c,d.off", Path("/e/f.obj")),
        (tmp_path / "../g.off", tmp_path / "a.off"),
        (tmp_path / "sub/b.off", tmp_path.parent / "other/g.off"),
    ]
    assert [pair.name for pair in found] == [
        "a.off__sub-b.off",
        "c,d.off__e-f.obj",
        "g.off__a.off",
        "sub-b.off__other-g.off",
    ]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize(
    "text",
    [
        "# of both\nx;y;partial\n\na,1.off;sub/b.off;yes\n",
        '# of both\nx\ty\tpartial\n\na,1.off\tsub/b.off\t"yes"\n',
        "sep=;\r\nx;y;partial\r\n\r\na,1.off;sub/b.off;yes\r\n",
        'sep=,\n\ny,x,partial\nsub/b.off,"a,1.off",yes\n',
    ],
)
def test_pairs_of_spreadsheets_are_read(tmp_path, text, encoding):
    (path := tmp_path / "pairs.csv").write_bytes(text.encode(encoding))
    (pair,) = read_pairs(path)
    assert (pair.x, pair.y) == (tmp_path / "a,1.off", tmp_path / "sub/b.off")
    assert pair.options == PairOptions(partial=True)
    path.write_bytes(b"x,y\na;1.off,b.off\n")
    assert read_pairs(path)[0].x == tmp_path / "a;1.off"
    path.write_bytes(b"a.off;b.off\n\n# c\nd.off\n")
    with pytest.raises(ValueError, match="line 4 is 'd.off'"):
        read_pairs(path)


def test_pairs_have_options(tmp_path):
    path = tmp_path / "pairs.csv"
    path.write_text(
        "target,Source,orientation,partial,repair,landmarks_x,landmarks_y,\n"
        "a.off,b.off,Any,yes,0,b.pp,/c/a.csv\n"
        "c.off,b.off,,,,\n"
    )
    first, second = read_pairs(path)
    assert (first.x, first.y) == (tmp_path / "b.off", tmp_path / "a.off")
    assert first.name == "b.off__a.off"
    assert first.options == PairOptions(
        orientation="any",
        partial=True,
        repair=False,
        landmarks_x=tmp_path / "b.pp",
        landmarks_y=Path("/c/a.csv"),
    )
    assert second.options == PairOptions()


@pytest.mark.parametrize(
    "text, message",
    [
        ("", "has no pairs"),
        ("x,y,landmark\na,b,c\n", "line 1: there is no column 'landmark'; they are x"),
        ("x,y,repair,repair\na,b,1,1\n", "line 1: two columns are repair"),
        ("x,repair\na,1\n", "line 1: no column is x or none is y"),
        ("x,y,repair\na,b,maybe\n", "line 2: repair is 'maybe'; write yes or no"),
        ("x,y,orientation\na,b,left\n", "line 2: orientation is 'left'; write one of"),
        ("x,y,repair\na,b,1,1\n", "line 2 is 'a,b,1,1'; a line holds x, y, repair"),
        ("x,y,repair\na,b,1\na,b,0\n", "lines 2 and 3 would both be named"),
        ("x,y\n", "has no pairs"),
        ("a.off,b.off\nc.off;d.off\n", "line 2 is 'c.off;d.off'"),
        ("a.off,\n", "line 1 is 'a.off,'"),
        ("sep=;\na.off,b.off\n", "line 2 is 'a.off,b.off'; .* a semicolon or a tab"),
        ("sep=;\n", "has no pairs"),
        ("<!DOCTYPE html>\n<html>", "it is a web page, not the file itself; download"),
        ("a.off,b.off,c.off\n", "line 1 is"),
        ("a.off,b\0.off\n", "line 1 is"),
        ("a/b.off,c\nd,e\na-b.off,c\n", "lines 1 and 3 would both be named"),
    ],
)
def test_bad_lists(tmp_path, text, message):
    (path := tmp_path / "pairs.csv").write_text(text)
    with pytest.raises(ValueError, match=f"{path}: .*{message}"):
        read_pairs(path)


def test_not_text(tmp_path):
    (path := tmp_path / "pairs.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ValueError, match="is not UTF-8 .*; save it as that"):
        read_pairs(path)


def blobs(folder, count):
    for i in range(count):
        write_off(folder / f"{i}.off", testing.blob(i))
    (folder / "bad.off").write_text("OFF\n1 1 0\n0 0 0\n3 0 1 2\n")


def batch(pairs, out, *args):
    args = "batch", pairs, "--out", out, *args
    return CliRunner().invoke(app, [str(arg) for arg in args])


def fake_match(mesh_x, mesh_y, **_):
    values = {"orientation": 0.9, "finite": True, "gap": 0.5, "bijectivity_x": 0.5}
    values |= {"landmarks": np.zeros(0), "region_cost": np.nan}
    certificate = Certificate(
        *(jnp.asarray(values.get(name, 0.0)) for name in Certificate._fields)
    )
    n_x, n_y = len(mesh_x.vertices), len(mesh_y.vertices)
    seconds = np.where(np.array(STAGES) == "search", 1.5, np.nan)
    tried = np.array([1, 3], np.int32), np.array([np.nan, 0.9]), np.array(1)
    T_xy, T_yx = np.arange(n_x) % n_y, np.arange(n_y) % n_x
    return Match(T_xy, T_yx, jnp.eye(3), certificate, info=MatchInfo(*tried, seconds))


def test_the_command(client, tmp_path, monkeypatch):
    monkeypatch.setenv("JFSF_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("jfsf.matching.match", fake_match)
    blobs(tmp_path, 2)
    (pairs := tmp_path / "pairs.csv").write_text("x,y\n0.off,1.off\n1.off,bad.off\n")
    out, at = tmp_path / "maps", ("--scheduler", client.scheduler.address)
    result = batch(pairs, out, *at)
    assert result.exit_code == 1, result.output
    assert "2 pairs: 1 matched, 1 failed, 1 with warnings" in _words(result.stdout)
    assert re.search(r"failed: .*1.off, .*bad.off: .*bad.off: ", result.stdout)
    assert read_match(out / "0.off__1.off.npz").T_xy.shape == (162,)
    record = json.loads((out / "summary.json").read_text())
    bad, good = record["pairs"]  # the doubtful first
    assert good["x"] == str(tmp_path / "0.off") and good["n_y"] == 162
    assert good["orientation"] == 0.9 and good["reason"] == "" and good["warnings"]
    assert bad["file"] == "" and bad["coverage_xy"] is None
    assert good["start"] == "coarse copies" and good["attempts"] == 2
    assert good["confidences"] == [None, 0.9] and bad["confidences"] is None
    assert good["seconds_search"] == 1.5 and good["seconds_coarse_copies"] is None
    lines = (out / "summary.csv").read_text().splitlines()
    assert len(lines) == 3 and lines[0].startswith("x,y,file,reason,")
    # One spectrum a good mesh.
    assert len(list((tmp_path / "cache").glob("*.npz"))) == 2

    # Without the bad mesh. Unfinished and damaged files of a killed run are replaced.
    pairs.write_text("0.off,1.off\n1.off,0.off\n")
    assert batch(pairs, out, *at).exit_code == 0
    (out / f".{'0af1' * 8}.tmp").touch()
    (out / "1.off__0.off.npz").write_bytes(b"PK")
    result = batch(pairs, out, *at)
    assert result.exit_code == 0, result.output
    assert "2 pairs: 2 matched (1 of them earlier), 2 with warnings" in _words(
        result.stdout
    )
    assert not list(out.glob(".*.tmp"))
    assert read_match(out / "1.off__0.off.npz").T_xy.shape == (162,)
    (listed := out / "summary.csv").write_text("0.off,1.off\n")
    result = batch(listed, out, *at)
    assert result.exit_code == 1 and "would be overwritten" in result.stderr
    assert listed.read_text() == "0.off,1.off\n"

    result = batch(pairs, out, *at, "--orientation", "any")
    assert result.exit_code == 1 and "name another folder" in result.stderr
    assert batch(tmp_path / "none.csv", out, *at).exit_code == 1


def test_parts_of_damaged_meshes(client, tmp_path, monkeypatch):
    likely = iter([0.9, 0.25])

    def match_of_parts(mesh_x, mesh_y, *, partial, **_):
        assert partial and len(mesh_x.vertices) == len(mesh_y.vertices) == 162
        found = fake_match(mesh_x, mesh_y)
        certificate = found.certificate._replace(
            confidence=jnp.asarray(next(likely)),
            region_cost=jnp.asarray(-19.0),
            gap=jnp.asarray(jnp.inf),
        )
        inside = np.arange(162) < 100
        return found._replace(
            certificate=certificate, matched_x=inside, matched_y=inside, info=None
        )

    monkeypatch.setenv("JFSF_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("jfsf.matching.match", match_of_parts)
    for i in range(2):
        vertices, faces = testing.blob(i)
        stray = np.concatenate([vertices, [[9.0, 9, 9]]])  # which no face has
        write_off(tmp_path / f"{i}.off", Mesh(stray, faces))
    (pairs := tmp_path / "pairs.csv").write_text("0.off,1.off\n1.off,0.off\n")
    out, at = tmp_path / "maps", ("--scheduler", client.scheduler.address)
    result = batch(pairs, out, *at, "--partial", "--repair")
    assert result.exit_code == 0, result.output
    assert "2 pairs: 2 matched" in _words(result.stdout)
    settings = json.loads((out / "settings.json").read_text())
    assert settings["partial"] and settings["repair"]
    text = (out / "summary.json").read_text()
    assert "Infinity" not in text and "NaN" not in text
    record = json.loads(text)
    assert [row["confidence"] for row in record["pairs"]] == pytest.approx([0.25, 0.9])
    assert {row["region_cost"] for row in record["pairs"]} == {-19.0}
    said = [[w for w in row["warnings"] if "region" in w] for row in record["pairs"]]
    assert len(said[0]) == 1 and not said[1]
    (first, _) = record["pairs"]
    found = read_match(out / first["file"])
    assert found.T_xy.shape == found.matched_x.shape == (163,)
    result = batch(pairs, out, *at, "--partial")
    assert result.exit_code == 1 and "name another folder" in result.stderr


def test_options_of_pairs_by_column(client, tmp_path, monkeypatch):
    asked = {}

    def match_of_pair(mesh_x, mesh_y, **given):
        rows = given.get("landmarks")
        asked[len(mesh_x.vertices)] = given["orientation"], rows
        found = fake_match(mesh_x, mesh_y)
        likely = [jnp.full(len(mesh.vertices), 0.5) for mesh in (mesh_x, mesh_y)]
        far = jnp.asarray([] if rows is None else [0.0, 0.9])
        certificate = found.certificate._replace(landmarks=far)
        one, two = likely
        return found._replace(
            certificate=certificate, confidence_x=one, confidence_y=two
        )

    monkeypatch.setenv("JFSF_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("jfsf.matching.match", match_of_pair)
    blobs(tmp_path, 2)
    vertices, faces = testing.blob(0, subdivisions=3)
    flake = np.array([[9.0, 9, 9], [9.1, 9, 9], [9, 9.1, 9], [7, 7, 7]])
    stray = Mesh(np.concatenate([vertices, flake[3:]]), faces)
    write_off(tmp_path / "stray.off", stray)
    more = np.concatenate([faces, [[0, 1, 2] + np.full(3, len(vertices), np.int32)]])
    write_off(tmp_path / "pieces.off", Mesh(np.r_[vertices, flake[:3]], more))
    (tmp_path / "a.csv").write_text("nose,3\n鼻尖,8\n", encoding="utf-8")
    (tmp_path / "b.csv").write_text("鼻尖,5\nnose,4\n", encoding="utf-8")
    lines = [
        "x,y,orientation,landmarks_x,repair",
        "0.off,1.off,any,a.csv,",
        "stray.off,1.off,,a.csv,",
        "pieces.off,1.off,,a.csv,yes",
        "pieces.off,0.off,,,",
    ]
    (pairs := tmp_path / "pairs.csv").write_text("\n".join(lines))
    out, at = tmp_path / "maps", ("--scheduler", client.scheduler.address)
    at += "--landmarks-y", tmp_path / "b.csv"
    result = batch(pairs, out, *at)
    assert result.exit_code == 1, result.output  # two pieces, and no repair
    assert "4 pairs: 3 matched, 1 failed" in _words(result.stdout)
    assert "keep one with match --largest-component" in _words(result.stdout)
    assert set(asked) == {162, 642}
    assert asked[162][0] == "any" and asked[162][1].tolist() == [[3, 4], [8, 5]]
    assert asked[642][0] == "preserve"
    said = _words(result.stdout)
    assert f"{tmp_path / 'stray.off'}: 1 vertex without a face left out" in said
    assert "1 small component removed" in said
    assert "landmarks: 2 paired by name: nose, 鼻尖" in said
    rows = json.loads((out / "summary.json").read_text(encoding="utf-8"))["pairs"]
    (row,) = (row for row in rows if row["x"].endswith("stray.off"))
    assert any("without a face" in note for note in row["notes"])
    assert any("landmark 2 (鼻尖) ends far" in line for line in row["warnings"])
    names = [f"{name}.off__1.off.npz" for name in ("0", "stray", "pieces")]
    assert any("left out" in note for note in read_notes(out / names[1]))

    # A line that has changed is matched again, and only that; the rest is exported.
    asked.clear()
    lines = [*lines[:1], lines[1].replace("any", "reverse"), *lines[2:4]]
    pairs.write_text("\n".join(lines))
    made = [(out / name).stat().st_mtime_ns for name in names]
    result = batch(pairs, out, *at, "--export", "ply")
    assert result.exit_code == 0, result.output
    assert set(asked) == {162} and asked[162][0] == "reverse"
    now = [(out / name).stat().st_mtime_ns for name in names]
    assert [a == b for a, b in zip(made, now, strict=True)] == [False, True, True]
    assert (out / "stray.off__1.off.ply").exists()
    asked.clear()
    assert batch(pairs, out, *at, "--export", "ply").exit_code == 0 and not asked
    # So is one whose landmarks are newer.
    os.utime(tmp_path / "a.csv", (3e9, 3e9))
    assert batch(pairs, out, *at).exit_code == 0 and set(asked) == {162, 642}

    for line, why in (
        ("x,y,landmarks\n0.off,1.off,b.csv\n", None),
        ("x,y,gt_x,gt_y\n0.off,1.off,a.vts,b.vts\n", "add --report"),
        ("x,y\n0.off,1.off\n", "b.csv, and no line names landmarks_x"),
    ):
        pairs.write_text(line)
        result = batch(pairs, tmp_path / "other", *at)
        assert result.exit_code == 1
        assert why is None or why in _words(result.stderr), result.output


def test_damaged_results_are_made_again(client, tmp_path, monkeypatch):
    monkeypatch.setenv("JFSF_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("jfsf.matching.match", fake_match)
    blobs(tmp_path, 5)
    names = [f"{i}.off" for i in range(5)]
    (pairs := tmp_path / "pairs.csv").write_text(
        "".join(f"0.off,{name}\n" for name in names)
    )
    out, at = tmp_path / "maps", ("--scheduler", client.scheduler.address)
    assert batch(pairs, out, *at).exit_code == 0
    sound, *damaged = (out / f"0.off__{name}.npz" for name in names)
    whole = sound.read_bytes()
    with np.load(sound) as file:
        arrays = dict(file)
    # What numpy and zipfile do not know as damage.
    at_method = whole.index(b"PK\x01\x02") + 10
    damaged[0].write_bytes(whole[:at_method] + b"\x63" + whole[at_method + 1 :])
    with zipfile.ZipFile(damaged[1], "w") as file:
        for name, array in arrays.items():
            written = io.BytesIO()
            np.save(written, array)
            header = written.getvalue().replace(b"(162,)", b"(9e9,)")
            file.writestr(f"{name}.npy", header)
    np.savez(damaged[2], **arrays | {"certificate_gap": np.array(["a", "b"])})
    np.savez(damaged[3], **arrays | {"C_yx": np.array("a")})
    result = batch(pairs, out, *at)
    assert result.exit_code == 0, result.output
    assert "5 pairs: 5 matched (1 of them earlier), 5 with warnings" in _words(
        result.stdout
    )
    assert all(read_match(path).C_yx.shape == (3, 3) for path in damaged)


def test_what_is_drawn_in_another_way_is_drawn_again(tmp_path, monkeypatch):
    monkeypatch.setattr(_batch_jobs, "is_matched", lambda job: True)
    truth = tmp_path / "gt.vts"
    job = Job((), tmp_path / "a.npz", (), PairOptions(gt_x=truth, gt_y=truth))
    ask = partial(_batch_jobs.is_complete, job, {"report": True})
    clock = iter(range(10**9, 2 * 10**9, 10**8))

    def touch(*paths):
        now = next(clock)
        for path in paths:
            path.parent.mkdir(exist_ok=True)
            path.touch()
            os.utime(path, ns=(now, now))

    how = {"up": "y", "base": None}
    note_drawing(tmp_path, how)
    touch(truth, job.out, tmp_path / DRAWING)
    assert not ask()
    touch(*pages_of(job.out))
    assert ask()
    note_drawing(tmp_path, how)
    assert ask()
    note_drawing(tmp_path, how | {"base": 0})
    assert not ask()
    touch(tmp_path / DRAWING)
    touch(*pages_of(job.out))
    assert ask()
    touch(truth)
    assert not ask()


def _words(text):
    return " ".join(text.split())


def test_help_has_an_example():
    assert "Example: jfsf batch" in CliRunner().invoke(app, ["batch", "--help"]).stdout


@pytest.mark.slow  # matches in earnest: two compilations, 40 pairs twice
def test_forty_pairs_killed_in_the_middle(tmp_path):
    blobs(tmp_path, 10)
    pairs = [(i, j) for i in range(10) for j in range(i)][:40]
    (listed := tmp_path / "pairs.csv").write_text(
        "".join(f"{i}.off,{j}.off\n" for i, j in pairs) + "0.off,bad.off\n"
    )
    command = "-m", "jfsf", "batch", listed, "--workers", 2, "--out"
    cache = str(tmp_path / "cache")

    whole = process(*command, tmp_path / "whole", JFSF_CACHE=cache)
    output, errors = whole.communicate(timeout=1500)
    assert whole.returncode == 1 and "40 matched" in _words(output), output + errors
    assert "bad.off" in output

    made = lambda: len(list((tmp_path / "cut").glob("*__*.npz")))
    cut = process(*command, tmp_path / "cut", JFSF_CACHE=cache)
    kill_when(cut, made, 10, 600)
    assert 10 <= made() < 40
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "cut").glob("*_*")}
    again = process(*command, tmp_path / "cut", JFSF_CACHE=cache)
    kill_one_worker(again, lambda: made() >= 15)
    output, errors = again.communicate(timeout=1500)
    assert again.returncode == 1 and "40 matched" in _words(output), output + errors
    assert all(path.stat().st_mtime_ns == then for path, then in before.items())
    for i, j in pairs:
        name = f"{i}.off__{j}.off.npz"
        with np.load(tmp_path / "whole" / name) as one:
            with np.load(tmp_path / "cut" / name) as two:
                assert one.files == two.files
                for key in set(one.files) - {"info_seconds"}:
                    np.testing.assert_array_equal(one[key], two[key], key)


def kill_one_worker(process, ready):
    import psutil

    while not ready():
        assert process.poll() is None, process.communicate()
        time.sleep(0.1)
    busy = lambda child: sum(child.cpu_times()[:2])
    max(psutil.Process(process.pid).children(), key=busy).kill()

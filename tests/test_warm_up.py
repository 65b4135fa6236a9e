"""Programs compiled before there are shapes are those that a match asks for."""

import jax
import numpy as np
import pytest
import trimesh
from shapes import small
from typer.testing import CliRunner

import jfsf
from jfsf import matching
from jfsf.apps.cli._app import app
from jfsf.matching import _attempted
from jfsf.runtime import _programs
from jfsf.runtime._sizes import common_size
from jfsf.storage._cache import PROGRAM, stored_files


@pytest.mark.slow  # all programs of a match
@pytest.mark.usefixtures("run_once")
def test_a_pair_in_doubt_compiles_nothing_more(tmp_path, monkeypatch):
    monkeypatch.setenv("JFSF_CACHE", str(tmp_path))
    monkeypatch.setattr(_programs, "known", {})
    number = matching.warm_up([576])
    programs = lambda: {f.path for f in stored_files() if f.path.suffix == PROGRAM}
    before = programs()
    assert len(before) == number
    (body, _), ring = small("man_walk", 1200), trimesh.creation.torus(1, 0.3, 24, 24)
    other = jfsf.Mesh(np.asarray(ring.vertices), np.asarray(ring.faces))
    stages = []
    jfsf.match(body, other, progress=stages.append)
    assert "further starts" in stages
    assert programs() == before


def test_sizes_that_match_refuses_are_refused():
    with pytest.raises(ValueError, match="100 vertices; matching needs 160"):
        matching.warm_up([5000, 100])


def test_devices_whose_programs_are_not_kept_are_named(monkeypatch):
    class Device:
        platform = "gpu"

    monkeypatch.setattr(jax, "devices", lambda: [Device()])
    with pytest.raises(ValueError, match="JAX_PLATFORMS=cpu"):
        matching.warm_up()


def test_the_command_says_how_many_and_where(tmp_path, monkeypatch):
    asked = []

    def made(vertices, *, progress):
        asked.extend(vertices)
        progress("programs")
        return 7

    monkeypatch.setenv("JFSF_CACHE", str(tmp_path))
    monkeypatch.setattr(matching, "warm_up", made)
    for given, meant in (["1000", "5000"], [1000, 5000]), ([], [5000]):
        asked.clear()
        done = CliRunner().invoke(app, ["warm-up", *given])
        assert done.exit_code == 0 and asked == meant
        assert "7 programs in" in done.output and str(tmp_path) in done.output


def test_small_shapes_have_the_eigenpairs_of_a_match(monkeypatch):
    asked = []
    first, further = (
        lambda pair, runner, *, settings, kind=kind: asked.append(
            (kind, len(pair.spectra[0].mass), len(pair.spectra[0].evals))
        )
        for kind in ("first", "copies")
    )
    monkeypatch.setattr(_attempted, "compile_first_attempt", first)
    monkeypatch.setattr(_attempted, "compile_copies", further)
    few = jfsf.Settings(k=32, ks=(20, 32))
    for settings, n in ((jfsf.Settings(), 300), (jfsf.Settings(), 5000), (few, 5000)):
        asked.clear()
        matching.warm_up([n], settings=settings)
        k = settings.eigenpairs(n)
        copies = min(common_size(n), common_size(settings.coarse_vertices))
        assert asked == [("first", common_size(n), k), ("copies", copies, k)]

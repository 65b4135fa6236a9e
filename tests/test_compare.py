"""The tables' runner: a killed run goes on, and nothing is lost or counted twice."""

import json
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

from experiments.paper import compare
from jfsf.mesh import validate
from jfsf.types import Maps

PAIRS = "man_walk man_up\nman_up man_walk\n"


@pytest.fixture
def args(tmp_path):
    listed = tmp_path / "pairs.txt"
    listed.write_text(PAIRS)
    return SimpleNamespace(
        data=None,
        embedded=True,
        pairs=listed,
        spread=None,
        within=None,
        identity=False,
        every=500,
        methods=["first", "second"],
        out=tmp_path / "table.json",
    )


def run(args, calls, stop_at=None):
    def method(name):
        def maps(pair):
            calls.append(name)
            if len(calls) == stop_at:
                raise KeyboardInterrupt
            sizes = [len(spec.mass) for spec in pair[2:]]
            to = 0 if name == "first" else 1
            return Maps(*(jnp.full(n, to, jnp.int32) for n in sizes))

        return maps

    methods = {name: method(name) for name in ("first", "second")}
    options = {"k": 6, "functional": True, "quick": 0.0}  # one call each
    compare.run(args, methods, lambda _, pair: pair, **options)


@pytest.mark.slow
def test_a_killed_run_goes_on(args):
    calls = []
    with pytest.raises(KeyboardInterrupt):
        run(args, calls, stop_at=4)
    lines = args.out.with_suffix(".jsonl")
    assert not args.out.exists()
    with lines.open("a") as file:
        file.write('{"x": "man_up", "y": "ma')  # torn by the kill
    run(args, calls)
    assert calls == ["first", "second"] * 2 + ["second"]
    record = json.loads(args.out.read_text())
    keys = [(row["x"], row["y"], row["method"]) for row in record["rows"]]
    assert len(keys) == len(set(keys)) == 4 and record["pairs"] == 2
    for name in args.methods:
        errors = [row["error"] for row in record["rows"] if row["method"] == name]
        assert np.isclose(record["means"][name]["error"], np.mean(errors))
        assert all(np.isfinite(row["chamfer"]) for row in record["rows"])
    table = args.out.with_suffix(".md").read_text().splitlines()
    assert table[0].startswith("| method | error x1000 |") and len(table) == 4
    # Nothing is left to do, and the result does not change.
    run(args, calls)
    assert len(calls) == 5 and json.loads(args.out.read_text()) == record


@pytest.mark.slow
def test_other_settings_are_not_mixed(args):
    run(args, [])
    args.every = 400
    with pytest.raises(SystemExit, match="other settings .every."):
        run(args, [])


def test_a_mesh_put_into_the_pose_of_another(args):
    x, y = (compare.datasets.load(args, name) for name in ("man_walk", "man_up"))
    args.identity = True
    same, moved = compare.datasets.load_pair(args, "man_walk", "man_up")
    assert np.array_equal(same.truth, moved.truth)
    assert np.array_equal(moved.mesh.faces, x.mesh.faces)
    validate(moved.mesh, k=100)
    # Within an edge of where each template point is on Y, and no copy of X.
    gap = moved.mesh.vertices[moved.truth] - y.mesh.vertices[y.truth]
    one, two, _ = y.mesh.vertices[y.mesh.faces.T]
    edge = np.linalg.norm(one - two, axis=1).mean()
    assert np.linalg.norm(gap, axis=1).mean() < edge
    assert np.linalg.norm(moved.mesh.vertices - x.mesh.vertices, axis=1).mean() > edge

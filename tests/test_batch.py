"""Batches of pairs: the results of a loop, from a handful of programs."""

import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jfsf import SearchSettings, Settings, batch, testing
from jfsf.convert import nearest, sinkhorn
from jfsf.matching import match_spectra
from jfsf.refine import zoomout
from jfsf.runtime._sizes import common_size, pad, padded_pair
from jfsf.spectral import truncate_pair
from jfsf.types import Maps, Spectrum

ROOT = Path(__file__).parents[1]
SIZES = [(60, 75), (300, 41), (75, 60), (257, 300), (41, 41)]  # two sizes of programs


def embeddings(sizes, k=6):
    """Aligned embeddings of the same curved surface, float32."""

    def sample(n, seed):
        rng = np.random.default_rng(seed)
        points = np.sin(
            rng.uniform(-1, 1, (n, 2)) @ np.linspace(-3, 3, 2 * k).reshape(2, k)
        )
        return points.astype(np.float32)

    pairs = [(sample(n, 2 * i), sample(m, 2 * i + 1)) for i, (n, m) in enumerate(sizes)]
    return [x for x, _ in pairs], [y for _, y in pairs]


@cache
def spectra():
    """Blobs of 162 and 642 vertices in turn, 40 eigenpairs."""
    return [testing.blob_spectrum(i, 40, 2 + i % 2) for i in range(3)]


def same(found, wanted, share=1.0):
    assert len(found) == len(wanted)
    for ours, theirs in zip(found, wanted, strict=True):
        for name in ("T_xy", "T_yx"):
            mine, other = getattr(ours, name), np.asarray(getattr(theirs, name))
            assert isinstance(mine, np.ndarray) and mine.dtype == np.int32
            assert mine.shape == other.shape and mine.max() >= 0
            assert (mine == other).mean() >= share


def by_hand(xs, ys):
    """Nearest neighbours both ways."""
    for x, y in zip(xs, ys, strict=True):
        gap = ((x[:, None].astype(float) - y[None]) ** 2).sum(2)
        yield Maps(gap.argmin(1), gap.argmin(0))


@pytest.mark.parametrize("batch_size", [1, 3])
def test_convert_is_the_loop_unpadded(batch_size):
    xs, ys = embeddings(SIZES)
    found = batch.convert(xs, ys, converter=nearest, pairs=4, batch_size=batch_size)
    assert all(isinstance(maps, Maps) for maps in found)
    same(found, list(by_hand(xs, ys)))


@pytest.mark.parametrize("batch_size", [pytest.param(1, marks=pytest.mark.slow), 2])
def test_the_filter_is_the_loop_up_to_ties(batch_size):
    pairs = embeddings([SIZES[0]] * 2)
    found = batch.convert(*pairs, batch_size=batch_size)
    # Sums over padding round otherwise, and ties follow.
    same(found, [sinkhorn(x, y) for x, y in zip(*pairs, strict=True)], 0.95)


def test_refine_is_the_loop():
    small, large, other = spectra()
    xs, ys, ks = [small, other], [large, large], (4, 6, 8)
    starts = [jnp.eye(4)] * 2
    found = batch.refine(xs, ys, starts, ks=ks, converter=nearest, bidirectional=True)
    for x, y, start, C_yx in zip(xs, ys, starts, found, strict=True):
        alone = zoomout(x, y, start, ks=ks, converter=nearest, bidirectional=True)
        assert C_yx.shape == (8, 8) and np.allclose(C_yx, alone, atol=1e-8)


def compilations():
    counted = []

    def count(event, seconds, **_):
        if event == "/jax/core/compile/backend_compile_duration":
            counted.append(seconds)

    jax.monitoring.register_event_duration_secs_listener(count)
    return counted


def test_a_hundred_mixed_pairs_take_few_compilations():
    rng = np.random.default_rng(0)
    sizes = rng.integers(300, 901, (100, 2))
    assert len({tuple(pair) for pair in sizes}) == 100
    xs, ys = embeddings(sizes, 3)
    counted = compilations()
    found = batch.convert(xs, ys, converter=nearest)
    once = len(counted)
    assert 1 < once <= 6
    assert [(len(m.T_xy), len(m.T_yx)) for m in found] == [tuple(s) for s in sizes]
    # Other sizes and other numbers of pairs: the same programs.
    xs, ys = embeddings(rng.integers(300, 901, (37, 2)), 3)
    batch.convert(xs, ys, converter=nearest)
    assert len(counted) == once


def test_spectra_of_mixed_sizes_take_few_compilations():
    """Faces, too, vary from shape to shape."""
    rng = np.random.default_rng(0)

    def some(n):
        m = 2 * n - int(rng.integers(4, 40))
        return Spectrum(
            np.arange(5.0),
            rng.normal(size=(n, 5)),
            np.full(n, 1 / n),
            rng.integers(0, n, (m, 3), np.int32),
            rng.normal(size=(n, 3)),
        )

    xs, ys = ([some(n) for n in rng.integers(300, 901, 100)] for _ in range(2))
    counted = compilations()
    found = batch.map_pairs(
        _mean, (padded_pair(*pair) for pair in zip(xs, ys, strict=True))
    )
    assert 1 < len(counted) <= 6
    wanted = [x.evecs.sum() + y.evecs.sum() for x, y in zip(xs, ys, strict=True)]
    assert np.allclose(found, wanted)


def _mean(spec_x, spec_y):
    return spec_x.evecs.sum() + spec_y.evecs.sum()


@pytest.mark.parametrize("count, pairs, batch_size", [(1, 8, 3), (7, 2, 2), (9, 9, 4)])
def test_any_number_of_inputs_fills_any_batch(count, pairs, batch_size):
    inputs = [(np.full(3, float(i)),) for i in range(count)]
    found = batch.map_pairs(jnp.cumsum, inputs, pairs=pairs, batch_size=batch_size)
    assert np.array_equal(found, [np.cumsum(x) for (x,) in inputs])


def test_no_pairs():
    assert batch.convert([], []) == [] and batch.match_spectra([], []) == []


def test_what_does_not_fit_is_named():
    xs, ys = embeddings(SIZES)
    with pytest.raises(ValueError, match="convert: .*'embs_x': 5, 'embs_y': 4"):
        batch.convert(xs, ys[:4])
    ys[3] = ys[3][:, :2]
    with pytest.raises(ValueError, match="pair 3: nearest: emb_x has 6 columns"):
        batch.convert(xs, ys, converter=nearest)
    for wrong in ({"pairs": 0}, {"batch_size": 0}):
        with pytest.raises(ValueError, match="map_pairs: pairs and batch_size"):
            batch.convert(xs, ys, **wrong)
        with pytest.raises(ValueError, match="map_pairs: pairs and batch_size"):
            batch.match_spectra(spectra(), spectra(), **wrong)
    few = spectra()[0]._replace(evals=spectra()[0].evals[:9])
    with pytest.raises(ValueError, match="pair 1: match_spectra: .* 9 eigenpairs"):
        batch.match_spectra(spectra()[:2], [spectra()[1], few], batch_size=2)
    with pytest.raises(ValueError, match="pair 0: zoomout: ks"):
        batch.refine(spectra(), spectra(), [np.eye(4)] * 3, ks=(9, 4))
    with pytest.raises(ValueError, match="pair 0: search: .* 40"):
        few = [spectra()[0]._replace(evals=spectra()[0].evals[:9])]
        batch.search(few, few, [np.ones((162, 2))], [np.ones((162, 2))])


def test_join_wants_all_or_nothing():
    with pytest.raises(ValueError, match="join: give coordinator, .*'here:1', 2, None"):
        batch.join("here:1", 2)
    assert batch.local_shard(range(5)) == [0, 1, 2, 3, 4]


SHARDED = """
import jax
from test_batch import *
assert len(jax.local_devices()) == 4
xs, ys = embeddings(SIZES)
loop = list(by_hand(xs, ys))
same(batch.convert(xs, ys, converter=nearest, pairs=6), loop)
same(batch.convert(xs, ys, converter=nearest, pairs=16, batch_size=2), loop)

seen = []
def device_of(x):
    jax.debug.callback(lambda i: seen.append(int(i)), jax.lax.axis_index("pairs"))
    return x + 1
found = batch.map_pairs(device_of, [(np.full(2, float(i)),) for i in range(6)], pairs=8)
jax.effects_barrier()
assert np.array_equal(found, [[i + 1, i + 1] for i in range(6)])
# Dealt out evenly, and nothing is computed for the copies that fill the batch.
assert sorted(seen) == [0, 0, 1, 1, 2, 3], seen
"""

HOST = """
import sys
from jfsf import batch
batch.join(f"127.0.0.1:{sys.argv[1]}", 2, int(sys.argv[2]))
from test_batch import *
assert jax.process_count() == 2
xs, ys = embeddings(SIZES)
found = batch.convert(batch.local_shard(xs), batch.local_shard(ys), converter=nearest)
np.savez(sys.argv[3], **{f"xy{i}": m.T_xy for i, m in enumerate(found)},
         **{f"yx{i}": m.T_yx for i, m in enumerate(found)})
"""


def start(code, *args, **env):
    paths = os.pathsep.join([str(ROOT), str(ROOT / "tests")])
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, args)],
        env={**os.environ, "PYTHONPATH": paths, "JAX_PLATFORMS": "cpu", **env},
        stderr=subprocess.PIPE,
        text=True,
    )


def ends(process):
    try:
        errors = process.communicate(timeout=200)[1]
    finally:
        process.kill()
    assert process.returncode == 0, errors


@pytest.mark.slow
def test_four_devices_share_the_pairs():
    ends(start(SHARDED, XLA_FLAGS="--xla_force_host_platform_device_count=4"))


@pytest.mark.slow
def test_two_processes_share_the_pairs(tmp_path):
    port = free_port()
    both = [start(HOST, port, i, tmp_path / f"{i}.npz") for i in range(2)]
    for process in both:
        ends(process)
    xs, ys = embeddings(SIZES)
    found: list = [None] * len(SIZES)
    for i in range(2):
        with np.load(tmp_path / f"{i}.npz") as file:
            places = range(i, len(SIZES), 2)
            assert len(file.files) == 2 * len(places)
            for at, place in enumerate(places):
                found[place] = Maps(file[f"xy{at}"], file[f"yx{at}"])
    same(found, list(by_hand(xs, ys)))


def free_port():
    import socket

    with socket.socket() as any_port:
        any_port.bind(("127.0.0.1", 0))
        return any_port.getsockname()[1]


def edge(spec):
    """Mean length."""
    one, two, _ = np.asarray(spec.vertices)[np.asarray(spec.faces).T]
    return np.linalg.norm(one - two, axis=1).mean()


@pytest.mark.slow  # the whole search, compiled for two sizes, twice
@pytest.mark.parametrize("batch_size", [1, 3])
def test_match_spectra_is_the_loop(batch_size):
    specs = spectra()
    xs, ys = specs, specs[1:] + specs[:1]
    # One attempt each, as `jfsf.match_spectra` makes, which knows no motions.
    search = SearchSettings(hypotheses=61)
    quick = Settings(search=search, retry_below=0, rigid_below=0)
    found = batch.match_spectra(xs, ys, settings=quick, batch_size=batch_size)
    for x, y, ours in zip(xs, ys, found, strict=True):
        size = common_size(max(len(x.mass), len(y.mass)))
        padded = (pad(spec, size, 2 * size) for spec in truncate_pair(x, y))
        theirs = match_spectra(*padded, settings=quick)
        # Sums under vmap round otherwise, which decides ties between near vertices.
        coarse = max(edge(x), edge(y))
        for name, source, target in (("T_xy", x, y), ("T_yx", y, x)):
            mine, other = getattr(ours, name), getattr(theirs, name)
            assert len(mine) == len(source.mass)
            apart = target.vertices[mine] - target.vertices[other[: len(mine)]]
            assert np.linalg.norm(apart, axis=1).mean() < coarse / 2
        assert np.allclose(
            ours.certificate.orientation, theirs.certificate.orientation, atol=0.01
        )

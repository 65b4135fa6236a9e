"""ZoomOut against the plain loop, and what must not change it."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import oracles
import pytest
from hypothesis import given, settings

from jfsf import testing
from jfsf.convert import nearest, sinkhorn
from jfsf.refine import zoomout
from jfsf.refine._zoomout import MIN_SCAN_STEPS, _scans
from jfsf.runtime._sizes import pad
from jfsf.spectral import embeddings, farthest_points, functional_map, restrict
from jfsf.spectral._orientation import bracket_fields

N, K = 162, 40
KS = (6, 10, 10, 20, 36, 40)  # a size twice
spectra = testing.spectra(K)
run = partial(zoomout, ks=KS, converter=nearest)
filtered = partial(sinkhorn, k0=5, num_iters=5)


def close_to_identity(seed):
    """The identity of a blob with some rows of the map spoilt."""
    rng = np.random.default_rng(seed)
    T, at = np.arange(N), rng.choice(N, 20, replace=False)
    T[at] = rng.integers(N, size=20)
    return jnp.asarray(T, jnp.int32)


def start(spec_x, spec_y, seed=0):
    return functional_map(close_to_identity(seed), spec_x, spec_y)


def pair(seed):
    return testing.blob_spectrum(seed, K), testing.blob_spectrum(seed + 1, K)


@pytest.mark.parametrize("bidirectional", [False, True])
@settings(max_examples=5)
@given(spec_x=spectra, spec_y=spectra, seed=testing.seeds)
def test_the_plain_loop_agrees(bidirectional, spec_x, spec_y, seed):
    C = start(spec_x, spec_y, seed)
    ours = run(spec_x, spec_y, C, bidirectional=bidirectional)
    np.testing.assert_allclose(
        ours, oracles.zoomout(spec_x, spec_y, C, KS, bidirectional), atol=1e-8
    )


def test_several_widths_agree_with_the_plain_loop():
    specs = [testing.blob_spectrum(seed, 80) for seed in (3, 4)]
    ks = (10,) + (20,) * (MIN_SCAN_STEPS - 1) + (60, 70, 80)
    steps = zip(ks[:-1], ks[1:], strict=True)
    sizes = [(width, len(s)) for width, s in _scans(steps, 80)]
    assert sizes == [(64, MIN_SCAN_STEPS), (80, 2)]
    C = start(*specs)
    ours = zoomout(*specs, C, ks=ks, converter=nearest)
    np.testing.assert_allclose(ours, oracles.zoomout(*specs, C, ks), atol=1e-8)


@pytest.mark.parametrize(
    "bidirectional", [pytest.param(False, marks=pytest.mark.slow), True]
)
def test_the_plain_loop_agrees_on_samples(bidirectional):
    # Eigenvectors at samples are not orthonormal: each size has a least squares
    # problem of its own.
    whole = pair(3)
    some_x, some_y = (
        restrict(spec, farthest_points(spec, num=num))
        for spec, num in zip(whole, (90, 110), strict=True)
    )
    C = start(*whole)
    ours = run(some_x, some_y, C, bidirectional=bidirectional)
    gram = (some_x.evecs.T * some_x.mass[None]) @ some_x.evecs
    assert abs(gram - np.eye(K)).max() > 0.1
    np.testing.assert_allclose(
        ours, oracles.zoomout(some_x, some_y, C, KS, bidirectional), atol=1e-8
    )


@settings(max_examples=5)
@given(spec_x=spectra, spec_y=spectra, seed=testing.seeds)
def test_weighted_columns_match_the_plain_loop(spec_x, spec_y, seed):
    C = start(spec_x, spec_y, seed)
    extra = [np.random.default_rng(seed + i).normal(size=(N, 3)) for i in (0, 1)]
    options = {"weighted": True, "extra_weight": 0.5}
    ours = run(spec_x, spec_y, C, *map(jnp.asarray, extra), **options)
    truth = oracles.zoomout(spec_x, spec_y, C, KS, extra=extra, extra_weight=0.5)
    np.testing.assert_allclose(ours, truth, atol=1e-8)


def test_one_size_converts_nothing():
    spec_x, spec_y = pair(0)
    C = start(spec_x, spec_y)
    ours = zoomout(spec_x, spec_y, C, ks=(7,), converter=nearest)
    assert np.array_equal(ours, C[:7, :7])


both_ways = partial(zoomout, ks=KS, converter=filtered, bidirectional=True)


@pytest.mark.parametrize("refine, converter", [(run, nearest), (both_ways, filtered)])
def test_a_known_permutation_is_recovered(refine, converter):
    spec_x = testing.blob_spectrum(2, K)
    order = np.random.default_rng(0).permutation(N)
    spec_y = testing.relabel_spectrum(spec_x, order)
    truth = jnp.asarray(np.argsort(order), jnp.int32)
    rough = functional_map(truth[close_to_identity(0)], spec_x, spec_y)
    C = refine(spec_x, spec_y, rough)
    maps = converter(*embeddings(C, spec_x.evecs, spec_y.evecs, space="direct"))
    assert np.array_equal(maps.T_xy, truth) and np.array_equal(maps.T_yx, order)


def oriented(spec_x, spec_y, C, sign=1):
    fields = sign * bracket_fields(spec_x), bracket_fields(spec_y)
    return run(spec_x, spec_y, C, None, None, *fields, weighted=True)


@pytest.mark.parametrize("refine", [run, oriented])
@settings(max_examples=5)
@given(
    spec_x=spectra,
    spec_y=spectra,
    order=testing.permutations(N),
    by_x=testing.signs(K),
    by_y=testing.signs(K),
)
def test_labels_and_signs_change_nothing_but_C(
    refine, spec_x, spec_y, order, by_x, by_y
):
    C = start(spec_x, spec_y)
    other_x = testing.flip_signs(testing.relabel_spectrum(spec_x, order), by_x)
    other_y = testing.flip_signs(spec_y, by_y)
    moved = refine(other_x, other_y, testing.flip_map(C, by_x, by_y))
    plain = testing.flip_map(refine(spec_x, spec_y, C), by_x, by_y)
    np.testing.assert_allclose(moved, plain, atol=1e-8)


def test_padding_is_invisible():
    spec_x, spec_y = pair(3)
    C = start(spec_x, spec_y)
    padded = both_ways(pad(spec_x, N + 5, 330), pad(spec_y, N + 9, 340), C)
    np.testing.assert_allclose(padded, both_ways(spec_x, spec_y, C), atol=1e-8)


def test_a_mirrored_shape_wants_the_other_sign():
    spec_x, spec_y = pair(0)
    C = start(spec_x, spec_y)
    mirrored = spec_y._replace(faces=spec_y.faces[:, ::-1])
    plain = oriented(spec_x, spec_y, C)
    np.testing.assert_allclose(oriented(spec_x, mirrored, C, -1), plain, atol=1e-8)
    assert np.abs(oriented(spec_x, mirrored, C) - plain).max() > 1e-3


def test_vmap_equals_the_loop():
    pairs = [pair(seed) for seed in (0, 2, 4)]
    starts = [start(*p) for p in pairs]
    batch = [testing.stack(list(s)) for s in zip(*pairs, strict=True)]
    found = jax.vmap(run)(*batch, jnp.stack(starts))
    for i, (p, C) in enumerate(zip(pairs, starts, strict=True)):
        np.testing.assert_allclose(found[i], run(*p, C), atol=1e-8)


def test_pairs_of_equal_size_compile_once():
    run(*pair(0), start(*pair(0)))
    before = zoomout._jitted._cache_size()
    for seed in (1, 2, 3):
        run(*pair(seed), start(*pair(seed)))
    assert zoomout._jitted._cache_size() == before


def test_float32_agrees_but_for_near_ties():
    spec_x = testing.blob_spectrum(2, K)
    order = np.random.default_rng(0).permutation(N)
    spec_y = testing.relabel_spectrum(spec_x, order)
    low = [testing.cast(s, jnp.float32) for s in (spec_x, spec_y)]
    truth = jnp.asarray(np.argsort(order), jnp.int32)
    rough = functional_map(truth[close_to_identity(0)], *low)
    C = run(*low, rough)
    assert C.dtype == jnp.float32
    np.testing.assert_allclose(C, np.eye(K), atol=1e-4)


@pytest.mark.parametrize(
    "ks, message",
    [
        ((), r"ks must not be empty or decrease, got \(\)"),
        ((9, 8), r"ks must not be empty or decrease, got \(9, 8\)"),
        ((9, 41), "ks ends at 41, there are 40 eigenpairs"),
        ((21, 30), r"C_yx is \(20, 30\), ks starts at 21"),
        ((0, 30), r"C_yx is \(20, 30\), ks starts at 0"),
    ],
)
def test_errors(ks, message):
    with pytest.raises(ValueError, match="zoomout: " + message):
        zoomout(*pair(0), jnp.ones((20, 30)), ks=ks, converter=nearest)


@pytest.mark.parametrize("one", ["extra", "field"])
def test_one_of_a_pair_is_an_error(one):
    with pytest.raises(ValueError, match=f"give both {one}_x and {one}_y, or neither"):
        alone = {f"{one}_x": jnp.ones((N, 3, 3)[: 2 if one == "extra" else 3])}
        zoomout(*pair(0), jnp.ones((20, 30)), **alone, ks=(9,), converter=nearest)


def test_fewer_points_than_functions_are_an_error():
    few = restrict(testing.blob_spectrum(0, K), jnp.arange(25))
    with pytest.raises(ValueError, match="ks ends at 40, and 25 points"):
        run(few, few, jnp.eye(K))

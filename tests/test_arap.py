"""Deformation as rigid as possible: dense solves, invariances, recovery of a map."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import oracles
import pytest
from hypothesis import given

from jfsf import testing
from jfsf.convert import nearest, sinkhorn
from jfsf.geometry._surface import surface
from jfsf.refine import ArapSettings, arap, deform
from jfsf.refine._arap import rotations
from jfsf.runtime._sizes import pad
from jfsf.types import Bent, Maps

N, K = 162, 4
spectra = testing.spectra(K)
run = partial(arap, rounds=3, converter=nearest)
EXACT = ArapSettings(tolerance=1e-12, max_steps=1000)  # solves that go on to the end


def posed(spec, seed=0):
    """The shape with its far end bent to one side, rotated and shifted."""
    v = np.asarray(spec.vertices)
    aside = v + np.maximum(v[:, 2:], 0) ** 2 * [[1.5, 0.0, 0.0]]
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    return spec._replace(vertices=jnp.asarray(aside @ turn.T + [[1.0, 2.0, 3.0]]))


def at_rest(spec, sign=1.0):
    return surface(spec.vertices, spec.faces, spec.mass, sign)


def slid(spec, seed=0):
    """The identity, but for a third of the vertices, which go to a neighbour."""
    rng = np.random.default_rng(seed)
    T, faces = np.arange(N), np.asarray(spec.faces)
    for i in rng.choice(N, N // 3, replace=False):
        T[i] = rng.choice(faces[(faces == i).any(1)].ravel())
    return jnp.asarray(T, jnp.int32)


def rough(spec, seed=0):
    return Maps(slid(spec, seed), slid(spec, seed + 1))


# With seeds 2, 4 and 6 two rotations are nearly equally good at some vertex.
@pytest.mark.parametrize("seed", [0, 1, 3, 5, 7])
def test_the_dense_deformation_agrees(seed):
    spec = testing.blob_spectrum(seed, K)
    target = posed(spec, seed).vertices[slid(spec, seed)]
    ours = deform(at_rest(spec), target, target, settings=EXACT)
    arrays = map(np.asarray, (spec.vertices, spec.faces, spec.mass, target))
    truth = oracles.deform(*arrays, EXACT.reach, EXACT.rotation_updates)
    np.testing.assert_allclose(ours, truth, atol=1e-7)
    assert np.abs(truth - np.asarray(target)).max() > 0.01
    from_smooth = deform(at_rest(spec), target, target, spec, settings=EXACT)
    np.testing.assert_allclose(from_smooth, truth, atol=1e-7)


@pytest.mark.parametrize("seed", [0, 1])
def test_eigenfunctions_shorten_the_solves(seed):
    spec = testing.blob_spectrum(seed, 60)
    target = posed(spec, seed).vertices[slid(spec, seed)]
    # A weak pull, as of a fine mesh, takes many steps.
    one = replace(EXACT, reach=0.3, rotation_updates=1)
    truth = deform(at_rest(spec), target, target, settings=one)
    few = replace(one, max_steps=2)

    def away(eigenpairs):
        moved = deform(at_rest(spec), target, target, eigenpairs, settings=few)
        return np.linalg.norm(moved - truth)

    assert away(spec) < 0.5 * away(None)
    # Functions that are not eigenfunctions do no harm.
    order = np.random.default_rng(seed).permutation(N)
    assert away(spec._replace(evecs=spec.evecs[order])) < 1.05 * away(None)


@pytest.mark.parametrize("sign", [1.0, pytest.param(-1.0, marks=pytest.mark.slow)])
def test_shapes_that_are_bent_already_go_on(sign):
    spec = testing.blob_spectrum(0, K)
    maps, target = rough(spec), posed(spec)
    options = {"converter": nearest}
    in_one = arap(spec, target, maps, sign, rounds=3, **options)
    x, y = arap(spec, target, maps, sign, rounds=1, **options)
    bent = Bent(x[:, :3], y[:, 3:6])
    then = arap(spec, target, bent, sign, rounds=2, **options)
    for ours, theirs in zip(then, in_one, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-10)
    for ours, theirs in zip(
        arap(spec, target, bent, sign, rounds=0, **options), (x, y), strict=True
    ):
        np.testing.assert_allclose(ours, theirs, atol=1e-12)


@given(seed=testing.seeds)
def test_rotations_are_those_of_the_svd(seed):
    rng = np.random.default_rng(seed)
    covariance = rng.normal(size=(50, 3, 3))
    covariance[:10, 2] = 0  # around a flat vertex
    u, s, vt = np.linalg.svd(covariance.swapaxes(1, 2))
    sign = np.linalg.det(u @ vt)
    u[:, :, 2] *= sign[:, None]
    # Two rotations do equally well where the two smaller values cancel.
    clear = s[:, 1] + sign * s[:, 2] > 0.3 * s[:, 0]
    found = np.asarray(rotations(jnp.asarray(covariance)))
    np.testing.assert_allclose(found[clear], (u @ vt)[clear], atol=1e-9)
    assert clear.sum() > 20


def test_a_vertex_without_faces_does_not_rotate():
    assert np.array_equal(rotations(jnp.zeros((2, 3, 3))), [np.eye(3)] * 2)


@given(spec=spectra, motion=testing.motions())
def test_a_motion_costs_nothing(spec, motion):
    turn, shift = motion
    moved = jnp.asarray(np.asarray(spec.vertices) @ turn.T + shift)
    np.testing.assert_allclose(deform(at_rest(spec), moved, moved), moved, atol=1e-9)
    mirrored = moved * jnp.array([[-1.0, 1.0, 1.0]])
    ours = deform(at_rest(spec, -1.0), mirrored, mirrored)
    np.testing.assert_allclose(ours, mirrored, atol=1e-9)
    # To the end: a solve stops at a residual relative to targets, far from the origin
    # at once.
    bent = deform(at_rest(spec), mirrored, mirrored, settings=EXACT)
    assert np.abs(bent - mirrored).max() > 3e-3


@pytest.mark.parametrize("converter", [nearest, partial(sinkhorn, k0=10)])
@pytest.mark.parametrize("seed", [0, 3])
def test_sliding_is_undone(converter, seed):
    spec_x = testing.blob_spectrum(seed, K)
    order = np.random.default_rng(seed).permutation(N)
    spec_y = testing.relabel_spectrum(posed(spec_x), order)
    maps = testing.relabel_maps(rough(spec_x), np.arange(N), order)
    maps = Maps(*(jnp.asarray(T, jnp.int32) for T in maps))
    found = nearest(*run(spec_x, spec_y, maps, converter=converter))
    truth = np.argsort(order), order
    wrong = lambda maps: [
        np.mean(np.asarray(T) != t) for T, t in zip(maps, truth, strict=True)
    ]
    assert max(wrong(found)) < 0.02 < 0.2 < min(wrong(maps))


def test_a_mirror_image_is_followed():
    spec_x = testing.blob_spectrum(0, K)
    other = posed(spec_x)
    flip = jnp.array([[-1.0, 1.0, 1.0]])
    spec_y = other._replace(vertices=other.vertices * flip, faces=other.faces[:, ::-1])
    plain_x, plain_y = run(spec_x, other, rough(spec_x))
    ours_x, ours_y = run(spec_x, spec_y, rough(spec_x), -1.0)
    gaps = lambda a, b: np.linalg.norm(
        np.asarray(a)[:, None] - np.asarray(b)[None], axis=2
    )
    np.testing.assert_allclose(gaps(ours_x, ours_y), gaps(plain_x, plain_y), atol=1e-6)


def test_swapping_the_shapes_swaps_the_columns():
    spec_x, spec_y = testing.blob_spectrum(0, K), testing.blob_spectrum(1, K)
    maps = rough(spec_x)
    emb_x, emb_y = run(spec_x, spec_y, maps)
    back_y, back_x = run(spec_y, spec_x, Maps(maps.T_yx, maps.T_xy))
    swap = [3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8]
    np.testing.assert_allclose(back_x[:, swap], emb_x, atol=1e-9)
    np.testing.assert_allclose(back_y[:, swap], emb_y, atol=1e-9)


def test_padding_is_invisible():
    spec_x, spec_y = testing.blob_spectrum(0, K), posed(testing.blob_spectrum(0, K))
    maps = rough(spec_x)
    plain = run(spec_x, spec_y, maps)
    wide = pad(spec_x, N + 5, 330), pad(spec_y, N + 9, 340)
    padded = Maps(jnp.pad(maps.T_xy, (0, 5)), jnp.pad(maps.T_yx, (0, 9)))
    for ours, truth in zip(run(*wide, padded), plain, strict=True):
        np.testing.assert_allclose(ours[:N], truth, atol=1e-9)


def test_vmap_equals_the_loop():
    xs = [testing.blob_spectrum(seed, K) for seed in (0, 2)]
    ys, maps = [posed(x, seed) for seed, x in enumerate(xs)], [rough(x) for x in xs]
    orientation_sign = jnp.array([1.0, -1.0])
    found = jax.vmap(run)(*map(testing.stack, (xs, ys, maps)), orientation_sign)
    for i, args in enumerate(zip(xs, ys, maps, orientation_sign, strict=True)):
        for ours, truth in zip(found, run(*args), strict=True):
            np.testing.assert_allclose(ours[i], truth, atol=1e-9)


def test_float32_agrees():
    spec_x = testing.blob_spectrum(0, K)
    spec_y = posed(spec_x)
    low = [testing.cast(s, jnp.float32) for s in (spec_x, spec_y)]
    for ours, truth in zip(
        run(*low, rough(spec_x)), run(spec_x, spec_y, rough(spec_x)), strict=True
    ):
        assert ours.dtype == jnp.float32
        np.testing.assert_allclose(ours, truth, atol=2e-3)


@pytest.mark.slow
def test_the_gradient_is_that_of_small_steps():
    spec_x = pad(testing.blob_spectrum(0, K), N + 3, 330)
    spec_y, maps = (
        posed(testing.blob_spectrum(0, K)),
        rough(testing.blob_spectrum(0, K)),
    )
    maps = Maps(jnp.pad(maps.T_xy, (0, 3)), maps.T_yx)
    rng = np.random.default_rng(0)
    weight, along = (jnp.asarray(rng.normal(size=(N + 3, 3))) for _ in range(2))

    def value(vertices):
        moved = spec_x._replace(vertices=vertices)
        options = {"rounds": 1, "converter": nearest, "settings": EXACT}
        emb_x, _ = arap(moved, spec_y, maps, **options)
        return jnp.sum(weight * emb_x[:, :3])

    slope = jnp.sum(jax.grad(value)(spec_x.vertices) * along)
    ahead, back = (value(spec_x.vertices + by * along) for by in (1e-5, -1e-5))
    np.testing.assert_allclose(slope, (ahead - back) / 2e-5, rtol=1e-4)


def test_errors():
    spec = testing.blob_spectrum(0, K)
    with pytest.raises(ValueError, match="arap: rounds is 0, it must be 1 or more"):
        arap(spec, spec, rough(spec), rounds=0, converter=nearest)
    cloud = spec._replace(faces=spec.faces[:0])
    with pytest.raises(
        ValueError, match="arap: X has 320 faces and Y 0; a point cloud"
    ):
        run(spec, cloud, rough(spec))

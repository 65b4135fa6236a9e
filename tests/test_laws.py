"""The laws, from spectra to maps: ZoomOut and conversion."""

from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings

from jfsf import testing
from jfsf.convert import sinkhorn
from jfsf.mesh import largest_component
from jfsf.refine import zoomout
from jfsf.runtime._sizes import pad
from jfsf.spectral import embeddings, functional_map, spectrum, uniform
from jfsf.types import Maps, Mesh

K = 20
# Sharper kernels leave ties in the plan, which rounding decides.
filtered = partial(sinkhorn, lam=5.0, k0=8, num_iters=10)
few = settings(max_examples=6)


@jax.jit
def refined(spec_x, spec_y, C_yx) -> Maps:
    C = zoomout(spec_x, spec_y, C_yx, ks=(6, 12, K), converter=filtered)
    emb_x, emb_y = embeddings(C, spec_x.evecs, spec_y.evecs, space="direct")
    found = filtered(emb_x, emb_y, uniform(spec_x.mass), uniform(spec_y.mass))
    return Maps(found.T_xy, found.T_yx)


def smaller(mesh: Mesh) -> Mesh:
    """Cut open: without the last vertices."""
    kept = mesh.faces[(mesh.faces < 150).all(1)]
    return largest_component(Mesh(mesh.vertices, kept)).mesh


def shapes(seed, motion=None, unit=1.0):
    mesh_x, mesh_y = testing.blob(seed), smaller(testing.blob(seed))
    if motion is not None:
        mesh_x = testing.move(mesh_x, motion, unit=unit)
    return [
        testing.cast(spectrum(m, K, tol=1e-9, cache=False), jnp.float64)
        for m in (mesh_x, mesh_y)
    ]


def start(spec_x, spec_y):
    return functional_map(jnp.asarray(TRUTH, jnp.int32), spec_x, spec_y)


def equal(ours, theirs):
    assert np.array_equal(ours.T_xy, theirs.T_xy)
    assert np.array_equal(ours.T_yx, theirs.T_yx)


WHOLE = testing.blob(0).vertices
PART = smaller(testing.blob(0)).vertices
N_X, N_Y = len(WHOLE), len(PART)
# Vertex numbers are those of the sphere, whatever the seed.
TRUTH = np.argmin(np.linalg.norm(WHOLE[:, None] - PART[None], axis=2), 1)


@cache
def pair():
    return shapes(0)


@cache
def plain():
    return refined(*pair(), start(*pair()))


def test_the_map_is_near_the_truth():
    assert 100 < N_Y < N_X
    gap = np.linalg.norm(PART[plain().T_xy] - WHOLE, axis=1)
    assert gap.mean() < 0.2  # edges are 0.4 long


@few
@given(testing.permutations(N_X), testing.permutations(N_Y))
def test_relabelling_the_vertices_relabels_the_map(order_x, order_y):
    moved = [
        testing.relabel_spectrum(s, o)
        for s, o in zip(pair(), (order_x, order_y), strict=True)
    ]
    found = refined(*moved, start(*pair()))
    equal(found, testing.relabel_maps(plain(), order_x, order_y))


@few
@given(testing.permutations(N_X))
def test_relabelling_the_mesh_relabels_its_spectrum(order):
    mesh = testing.relabel(testing.blob(0), order)
    found = testing.cast(spectrum(mesh, K, tol=1e-9, cache=False), jnp.float64)
    truth = testing.relabel_spectrum(pair()[0], order)
    np.testing.assert_allclose(found.evals, truth.evals, atol=1e-6)
    overlap = (found.evecs.T * found.mass[None]) @ truth.evecs
    np.testing.assert_allclose(jnp.abs(overlap), np.eye(K), atol=1e-5)


@few
@given(testing.motions(), testing.seeds)
def test_rigid_motion_and_scaling_change_nothing(motion, seed):
    moved = shapes(0, motion, unit=(1e-3, 1.0, 1e3)[seed % 3])
    equal(refined(*moved, start(*moved)), plain())


@few
@given(testing.signs(K), testing.signs(K))
def test_flipping_eigenvectors_changes_nothing(by_x, by_y):
    flipped = [
        testing.flip_signs(s, b) for s, b in zip(pair(), (by_x, by_y), strict=True)
    ]
    equal(refined(*flipped, testing.flip_map(start(*pair()), by_x, by_y)), plain())
    # The start changes with the eigenvectors by itself.
    equal(refined(*flipped, start(*flipped)), plain())


# Programs of their own; each of their parts is tested so, too.
@pytest.mark.slow
def test_padding_is_invisible():
    wide = pad(pair()[0], N_X + 20, 400), pad(pair()[1], N_Y + 7, 400)
    found = refined(*wide, start(*pair()))
    equal(Maps(found.T_xy[:N_X], found.T_yx[:N_Y]), plain())


@pytest.mark.slow
def test_vmap_equals_the_loop():
    pairs = [shapes(seed) for seed in range(3)]
    starts = [start(*p) for p in pairs]
    stacked = [
        testing.stack([s._replace(faces=s.faces[:1]) for s in side])
        for side in zip(*pairs, strict=True)
    ]
    found = jax.vmap(refined)(*stacked, jnp.stack(starts))
    for i, (own, C) in enumerate(zip(pairs, starts, strict=True)):
        equal(Maps(found.T_xy[i], found.T_yx[i]), refined(*own, C))


@pytest.mark.slow
def test_float32_agrees_but_for_near_ties():
    low = [testing.cast(s, jnp.float32) for s in pair()]
    found = refined(*low, start(*low))
    assert (np.asarray(found.T_xy) != np.asarray(plain().T_xy)).mean() < 0.03
    assert (np.asarray(found.T_yx) != np.asarray(plain().T_yx)).mean() < 0.03


def test_the_mirror_image_is_wound_outward():
    volume = lambda m: np.linalg.det(m.vertices[m.faces]).sum() / 6
    mesh = testing.blob(3)
    assert volume(mesh) > 0 and np.isclose(volume(testing.mirror(mesh)), volume(mesh))


@pytest.mark.parametrize("subdivisions, n", [(1, 42), (2, 162)])
def test_blobs_have_the_promised_size(subdivisions, n):
    assert testing.blob(1, subdivisions=subdivisions).vertices.shape == (n, 3)

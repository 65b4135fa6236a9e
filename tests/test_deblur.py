"""Deblurring: points on triangles, nearer to the truth than vertices; maps denoised."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh

from experiments.paper.baselines import deblur
from experiments.paper.baselines._deblur import deblur_precise
from jfsf import testing
from jfsf.convert import nearest, pull_back_precise
from jfsf.spectral import embeddings, functional_map, spectrum
from jfsf.types import Maps, Mesh

# Methods of others, for a table of the experiments: they seldom change.
pytestmark = pytest.mark.slow

K = 20


def spec(mesh, k=K):
    return jax.tree.map(jnp.asarray, spectrum(mesh, k, cache=False))


def bumpy(subdivisions):
    """Samples of one surface: a coarse one's vertices come first in a finer one."""
    ball = trimesh.creation.icosphere(subdivisions=subdivisions)
    v = np.array(ball.vertices)
    height = (
        1 + 0.25 * np.sin(2 * v[:, :1] + 1) + 0.2 * np.cos(3 * v[:, 1:2] * v[:, 2:])
    )
    return Mesh(v * height * [1.0, 1.3, 1.8], np.array(ball.faces, np.int32))


FINE, COARSE = bumpy(3), bumpy(2)
SPEC_X, SPEC_Y = spec(FINE), spec(COARSE)
N_X, N_Y = 642, 162


def closest(a, b):
    return np.linalg.norm(a[:, None] - b[None], axis=2).argmin(1).astype(np.int32)


T_XY = closest(FINE.vertices, COARSE.vertices)
T_YX = np.arange(N_Y, dtype=np.int32)


def off(pmap):
    """Mean distance from the recovered points to the truth, in space."""
    points = np.asarray(pull_back_precise(pmap, jnp.asarray(COARSE.vertices)))
    return np.linalg.norm(points - FINE.vertices, axis=1).mean()


@pytest.mark.parametrize(
    "space", [pytest.param("adjoint", marks=pytest.mark.slow), "direct"]
)
def test_points_lie_on_triangles(space):
    found = deblur_precise(SPEC_X, SPEC_Y, T_XY, num_iters=2, space=space)
    for pmap, mesh, n in zip(found, (COARSE, FINE), (N_X, N_Y), strict=True):
        bary, known = np.asarray(pmap.bary), {tuple(face) for face in mesh.faces}
        assert bary.shape == (n, 3) and (bary >= 0).all()
        np.testing.assert_allclose(bary.sum(1), 1, atol=1e-9)
        assert all(tuple(corner) in known for corner in np.asarray(pmap.corners))


def test_points_are_nearer_to_the_truth_than_vertices():
    found = deblur_precise(SPEC_X, SPEC_Y, T_XY)[0]
    best = np.linalg.norm(FINE.vertices - COARSE.vertices[T_XY], axis=1).mean()
    assert off(found) < 0.5 * best


def test_recovers_from_a_functional_map():
    C = functional_map(jnp.asarray(T_XY), SPEC_X, SPEC_Y)
    plain = nearest(*embeddings(C, SPEC_X.evecs, SPEC_Y.evecs)).T_xy
    points = off(deblur_precise(SPEC_X, SPEC_Y, C[:, :15], num_iters=1)[0])
    vertices = COARSE.vertices[np.asarray(plain)] - FINE.vertices
    assert points < 0.6 * np.linalg.norm(vertices, axis=1).mean()
    # A vertex map is seen through its functional map.
    one = deblur_precise(SPEC_X, SPEC_Y, T_XY, k=K, num_iters=1)
    two = deblur_precise(SPEC_X, SPEC_Y, C, k=3, num_iters=1)
    np.testing.assert_allclose(one[0].bary, two[0].bary, atol=1e-6)


def test_denoises_both_ways_and_more_rounds_help():
    rng = np.random.default_rng(0)
    noisy_xy, noisy_yx = T_XY.copy(), T_YX.copy()
    for noisy, n in ((noisy_xy, N_Y), (noisy_yx, N_X)):
        at = rng.choice(len(noisy), len(noisy) // 4, replace=False)
        noisy[at] = rng.integers(n, size=len(at))
    noisy = Maps(noisy_xy, noisy_yx)
    errors = []
    for num_iters in (1, 5):
        maps = deblur(SPEC_X, SPEC_Y, noisy, num_iters=num_iters)
        assert maps.T_xy.shape == (N_X,) and maps.T_xy.dtype == jnp.int32
        assert maps.T_yx.shape == (N_Y,) and maps.T_yx.dtype == jnp.int32
        there = COARSE.vertices[np.asarray(maps.T_xy)] - FINE.vertices
        back = FINE.vertices[np.asarray(maps.T_yx)] - COARSE.vertices
        errors.append([np.linalg.norm(d, axis=1).mean() for d in (there, back)])
    there = np.linalg.norm(COARSE.vertices[noisy_xy] - FINE.vertices, axis=1).mean()
    back = np.linalg.norm(FINE.vertices[noisy_yx] - COARSE.vertices, axis=1).mean()
    assert errors[0][0] < 0.8 * there and errors[0][1] < 0.8 * back
    assert errors[1][0] < errors[0][0] and errors[1][1] < errors[0][1]


@pytest.mark.parametrize("space", ["adjoint", "direct"])
def test_a_shape_with_itself_gives_the_identity(space):
    own = testing.blob_spectrum(3, K)
    for start in (jnp.eye(K), jnp.arange(162)):
        maps = deblur(own, own, start, num_iters=2, space=space)
        assert np.array_equal(maps.T_xy, np.arange(162))
        assert np.array_equal(maps.T_yx, np.arange(162))


def test_relabelling_follows_and_the_file_order_does_not_matter():
    order = np.random.default_rng(1).permutation(N_Y)
    plain = deblur(SPEC_X, SPEC_Y, T_XY, num_iters=2)
    place = np.argsort(order).astype(np.int32)
    other = testing.relabel_spectrum(SPEC_Y, order)
    found = deblur(SPEC_X, other, place[T_XY], num_iters=2)
    assert (np.asarray(found.T_xy) == place[np.asarray(plain.T_xy)]).mean() > 0.99
    assert (np.asarray(found.T_yx) == np.asarray(plain.T_yx)[order]).mean() > 0.99


def test_errors():
    for start, message in (
        (T_YX, "deblur: start has 162 entries, its shape has 642"),
        (T_XY + 1, "deblur: start holds 162, the mesh has 162 vertices"),
        (Maps(T_XY, T_XY), "start.T_yx has 642 entries"),
        (np.eye(K + 1), r"start is \(21, 21\), the spectra have \(20, 20\) eigenpairs"),
        (np.zeros((2, 2, 2)), r"start has shape \(2, 2, 2\)"),
        (T_XY.astype(float), "start is float64, expected integers"),
    ):
        with pytest.raises(ValueError, match=message):
            deblur(SPEC_X, SPEC_Y, start)
    with pytest.raises(ValueError, match="k and num_iters must be 1 or more, got 0"):
        deblur(SPEC_X, SPEC_Y, T_XY, k=0)
    with pytest.raises(ValueError, match="num_iters must be 1 or more, got 50 and 0"):
        deblur(SPEC_X, SPEC_Y, T_XY, num_iters=0)
    with pytest.raises(ValueError, match="space is 'adjoint' or 'direct', not 'x'"):
        deblur(SPEC_X, SPEC_Y, T_XY, space="x")
    with pytest.raises(ValueError, match="spec_y has 0 faces"):
        deblur(SPEC_X, SPEC_Y._replace(faces=SPEC_Y.faces[:0]), T_XY)

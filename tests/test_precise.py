"""Nearest points on triangles against all triangles one by one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from jfsf import data
from jfsf.convert import functional_map_precise, precise, pull_back_precise, to_vertex
from jfsf.spectral import functional_map, spectrum, truncate
from jfsf.types import Mesh, PreciseMap

BALL = trimesh.creation.icosphere(subdivisions=2)
FACES = np.asarray(BALL.faces, np.int32)
N_Y, N_X, K = 162, 45, 6


def distance(queries, emb, faces):
    """(n, m) distance to each triangle: every corner, edge and inside, one by one."""
    found = np.full((len(queries), len(faces)), np.inf)
    for f, face in enumerate(faces):
        for corners in ([0], [1], [2], [0, 1], [0, 2], [1, 2], [0, 1, 2]):
            p = emb[face[corners]]
            edges = (p[1:] - p[0]).T
            weight = (queries - p[0]) @ np.linalg.pinv(edges).T
            inside = (weight >= 0).all(1) & (weight.sum(1) <= 1)
            apart = np.linalg.norm(queries - p[0] - weight @ edges.T, axis=1)
            found[inside, f] = np.minimum(found[inside, f], apart[inside])
    return found


def embedded(seed, noise=0.5):
    """A ball in K dimensions, and queries near its surface."""
    rng = np.random.default_rng(seed)
    emb_y = np.asarray(BALL.vertices) @ rng.normal(size=(3, K))
    emb_y += 0.05 * rng.normal(size=(N_Y, K))
    bary = rng.dirichlet(np.ones(3), N_X)
    on = FACES[rng.integers(0, len(FACES), N_X)]
    point = (bary[:, :, None] * emb_y[on]).sum(1)
    return point + noise * rng.normal(size=(N_X, K)), emb_y


def reached(found, queries, emb_y):
    points = (
        np.asarray(found.bary)[:, :, None] * emb_y[np.asarray(found.corners)]
    ).sum(1)
    return np.linalg.norm(points - queries, axis=1)


def check(found, queries, emb_y, faces: np.ndarray = FACES, rtol=1e-9):
    bary = np.asarray(found.bary)
    assert (bary >= 0).all()
    np.testing.assert_allclose(bary.sum(1), 1, atol=1e-6)
    known = {tuple(face) for face in np.asarray(faces)}
    assert all(tuple(corner) in known for corner in np.asarray(found.corners))
    truth = distance(queries, emb_y, faces).min(1)
    np.testing.assert_allclose(reached(found, queries, emb_y), truth, rtol, 1e-7)


@settings(max_examples=8)
@given(st.integers(0, 99), st.sampled_from([0.0, 0.05, 0.5, 5.0]))
def test_nearest_of_all_points(seed, noise):
    emb_x, emb_y = embedded(seed, noise)
    check(precise(emb_x, emb_y, FACES), emb_x, emb_y)


@pytest.mark.parametrize("k0, degree", [(1, 1), (24, 2)])
def test_options_change_the_time_alone(k0, degree):
    emb_x, emb_y = embedded(0)
    check(precise(emb_x, emb_y, FACES, k0=k0, degree=degree), emb_x, emb_y)


def test_soups_and_flat_triangles():
    rng = np.random.default_rng(0)
    emb_y, emb_x = rng.normal(size=(30, 4)), 2 * rng.normal(size=(200, 4))
    emb_y[9] = (emb_y[7] + emb_y[8]) / 2
    emb_y[12] = emb_y[13]
    emb_x[:99] = np.repeat(emb_y[[7, 13, 3]], 33, 0) + 0.1 * emb_x[:99]
    some = rng.integers(0, 29, (25, 3))
    faces = np.concatenate([some, [[7, 8, 9], [12, 13, 14], [3, 3, 4]]]).astype("i4")
    faces = faces[np.ptp(faces, 1) > 0]
    check(precise(emb_x, emb_y, faces, k0=2), emb_x, emb_y, faces)


def test_float32():
    emb_x, emb_y = (x.astype(np.float32) for x in embedded(1))
    found = precise(emb_x, emb_y, FACES)
    assert found.bary.dtype == jnp.float32
    assert found.corners.dtype == jnp.int32
    wide = (x.astype(np.float64) for x in (emb_x, emb_y))
    check(found, *wide, rtol=1e-6)


def test_on_the_surface():
    emb_x, emb_y = embedded(2, noise=0.0)
    for dtype, atol in ((np.float64, 1e-9), (np.float32, 1e-4)):
        x, y = emb_x.astype(dtype), emb_y.astype(dtype)
        assert reached(precise(x, y, FACES), x, y).max() < atol
    corners = precise(emb_y[:N_X], emb_y, FACES)
    np.testing.assert_array_equal(to_vertex(corners), np.arange(N_X))
    np.testing.assert_allclose(corners.bary.max(1), 1, rtol=1e-9)


@pytest.mark.slow
def test_embedded_shapes():
    """Spectra of two meshes whose vertices differ; k0 does not settle all rows."""
    x, y = data.load("man_walk"), data.load("man_up")
    spec_x, spec_y = (spectrum(s.mesh, 20) for s in (x, y))
    seen, first = np.unique(x.template_to_vertex, return_index=True)
    image = spec_y.evecs[y.template_to_vertex[first]]
    C_yx = np.linalg.lstsq(spec_x.evecs[seen], image)[0]
    emb_x, emb_y = (spec_x.evecs @ C_yx)[::97], spec_y.evecs
    faces = np.asarray(spec_y.faces)
    found = precise(emb_x, emb_y, faces)
    nearest = np.linalg.norm(emb_x[:, None] - emb_y, axis=2).min(1)
    far = reached(found, emb_x, emb_y)
    assert (far < nearest).mean() > 0.9
    # The oracle is slow: only triangles that reach into the ball, a corner at least
    # within its longest side.
    side = np.linalg.norm(emb_y[faces] - emb_y[faces[:, [1, 2, 0]]], axis=2).max(1)
    corner = np.linalg.norm(emb_x[:8, None] - emb_y[faces][:, 0], axis=2)
    for i in range(8):
        near = faces[corner[i] <= far[i] + side]
        truth = distance(emb_x[i : i + 1], emb_y, near).min()
        np.testing.assert_allclose(far[i], truth, rtol=1e-9)


def test_padding_is_invisible():
    emb_x, emb_y = embedded(3)
    plain = precise(emb_x, emb_y, FACES)
    faces = np.concatenate([FACES, np.zeros((50, 3), np.int32)])
    wide = np.concatenate([emb_y, np.zeros((7, K))])
    tall = np.concatenate([emb_x, np.zeros((9, K))])
    padded = precise(tall, wide, faces)
    np.testing.assert_array_equal(padded.corners[:N_X], plain.corners)
    np.testing.assert_allclose(padded.bary[:N_X], plain.bary)


def test_relabelling():
    emb_x, emb_y = embedded(4)
    rng = np.random.default_rng(4)
    new, row = rng.permutation(N_Y), rng.permutation(N_X)
    moved = np.empty_like(emb_y)
    moved[new] = emb_y
    faces = rng.permutation(new[FACES].astype(np.int32))
    found = precise(emb_x[row], moved, faces)
    plain = precise(emb_x, emb_y, FACES)
    # Points on an edge may name either triangle.
    points = pull_back_precise(plain, emb_y)[row]
    np.testing.assert_allclose(pull_back_precise(found, moved), points, atol=1e-9)


def test_vmap_is_the_loop():
    pairs = [embedded(seed) for seed in range(3)]
    emb_x, emb_y = (jnp.stack([pair[i] for pair in pairs]) for i in (0, 1))
    faces = jnp.stack([jnp.asarray(np.roll(FACES, i, 0)) for i in range(3)])
    many = jax.vmap(lambda *args: precise(*args, k0=3))(emb_x, emb_y, faces)
    for i in range(3):
        one = PreciseMap(many.corners[i], many.bary[i])
        points = pull_back_precise(precise(*pairs[i], FACES), emb_y[i])
        np.testing.assert_allclose(pull_back_precise(one, emb_y[i]), points, atol=1e-9)


def test_rows_that_are_not_finite():
    emb_x, emb_y = embedded(5)
    plain = precise(emb_x, emb_y, FACES)
    emb_x[3], emb_x[5, 0] = np.nan, np.inf
    found = precise(emb_x, emb_y, FACES)
    bad = np.isin(np.arange(N_X), [3, 5])
    assert jnp.isnan(found.bary[bad]).all()
    np.testing.assert_array_equal(found.bary[~bad], plain.bary[~bad])


def test_pull_back_and_to_vertex():
    emb_x, emb_y = embedded(6, noise=0.0)
    found = precise(emb_x, emb_y, FACES)
    np.testing.assert_allclose(pull_back_precise(found, emb_y), emb_x, atol=1e-9)
    ones = pull_back_precise(found, jnp.ones((N_Y, 2)))
    np.testing.assert_allclose(ones, np.ones((N_X, 2)))
    given = PreciseMap(
        jnp.array([[4, 2, 7], [1, 0, 3]]), jnp.array([[0.2, 0.5, 0.3]] * 2)
    )
    np.testing.assert_array_equal(to_vertex(given), [2, 0])


def test_functional_map_of_a_vertex_map():
    x = Mesh(np.asarray(BALL.vertices) * [1, 1.5, 2], FACES)
    small = trimesh.creation.icosphere(subdivisions=1)
    y = Mesh(np.asarray(small.vertices) * [1, 1.5, 2], np.asarray(small.faces, "i4"))
    spec_x, spec_y = (
        jax.tree.map(jnp.asarray, spectrum(mesh, 12, cache=False)) for mesh in (x, y)
    )
    spec_x = truncate(spec_x, 9)
    T_xy = np.random.default_rng(0).integers(0, 42, N_Y)
    corners = np.stack([T_xy, (T_xy + 1) % 42, (T_xy + 2) % 42], 1)
    as_points = PreciseMap(jnp.asarray(corners), jnp.array([[1.0, 0, 0]] * N_Y))
    found = functional_map_precise(as_points, spec_x, spec_y)
    np.testing.assert_allclose(found, functional_map(T_xy, spec_x, spec_y), atol=1e-12)


def test_errors():
    emb_x, emb_y = embedded(0)
    with pytest.raises(ValueError, match=r"emb_x is \(45, 5\), emb_y is \(162, 6\)"):
        precise(emb_x[:, :5], emb_y, FACES)
    with pytest.raises(ValueError, match=r"faces_y is \(0, 3\)"):
        precise(emb_x, emb_y, FACES[:0])
    with pytest.raises(ValueError, match="positive, got 0 and 10"):
        precise(emb_x, emb_y, FACES, k0=0)
    with pytest.raises(ValueError, match="positive, got 24 and 0"):
        precise(emb_x, emb_y, FACES, degree=0)
    found = precise(emb_x, emb_y, FACES)
    with pytest.raises(ValueError, match=r"values_y is \(162,\)"):
        pull_back_precise(found, np.ones(N_Y))
    spec = spectrum(Mesh(np.asarray(BALL.vertices), FACES), 9, cache=False)
    with pytest.raises(ValueError, match="pmap has 45 rows, X has 162"):
        functional_map_precise(found, spec, spec)

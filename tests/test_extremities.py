"""Geodesics between samples, extremities and their assignments, against plain numpy."""

from itertools import permutations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from jfsf import testing
from jfsf.initial import SearchSettings, nonisometric_candidates
from jfsf.initial._extremities import assignments, extremities
from jfsf.initial._hypotheses import SamplePair
from jfsf.initial._proportions import log_stretch_std
from jfsf.initial._samples import sample_cells, sample_geodesics, search_samples
from jfsf.runtime._sizes import pad
from jfsf.spectral import farthest_points, features, wks
from jfsf.spectral._sampling import biharmonic

DEFAULT = SearchSettings()
FEW = SearchSettings(assignments=20, nonisometric_candidates=3)
SPEC = testing.blob_spectrum(0, DEFAULT.eigenpairs)
OTHER = testing.blob_spectrum(1, DEFAULT.eigenpairs)
DESC, OTHER_DESC = (wks(spec, num=5) for spec in (SPEC, OTHER))
SAMPLES = farthest_points(SPEC, num=40)


def geodesics(spec):
    return sample_geodesics(spec, SAMPLES, sample_cells(spec, SAMPLES))


def oracle(spec, samples):
    points, faces = np.asarray(biharmonic(spec)), np.asarray(spec.faces)
    gap = np.linalg.norm(points[:, None] - points[np.asarray(samples)][None], axis=2)
    near = np.argsort(gap, axis=1)[:, :2]
    at = np.asarray(spec.vertices)[np.asarray(samples)]
    pairs = {tuple(pair) for pair in near}
    for i, j, k in faces:
        pairs |= {(near[a, 0], near[b, 0]) for a, b in ((i, j), (j, k), (k, i))}
    i, j = np.array([pair for pair in pairs if pair[0] != pair[1]]).T
    length = np.linalg.norm(at[i] - at[j], axis=1)
    graph = coo_matrix((length, (i, j)), shape=(len(at), len(at))).tocsr()
    graph = graph.maximum(graph.T)
    mass = np.bincount(near[:, 0], np.asarray(spec.mass), len(at))
    share = mass / mass.sum()
    found = dijkstra(graph, directed=False)
    return found / (share @ found @ share)


def test_geodesics_are_those_of_dijkstra():
    found = geodesics(SPEC)
    np.testing.assert_allclose(found, oracle(SPEC, SAMPLES), rtol=1e-5, atol=1e-6)


def test_geodesics_of_a_point_cloud():
    cloud = SPEC._replace(faces=SPEC.faces[:0])
    found = geodesics(cloud)
    np.testing.assert_allclose(found, oracle(cloud, SAMPLES), rtol=1e-5, atol=1e-6)


def test_geodesics_ignore_padding_signs_and_units():
    found = geodesics(SPEC)
    n, m = len(SPEC.mass), len(SPEC.faces)
    padded = jax.tree.map(jnp.asarray, pad(SPEC, n + 9, m + 5))
    flipped = SPEC._replace(evecs=-SPEC.evecs, vertices=3 * SPEC.vertices)
    for other in (padded, flipped):
        again = geodesics(other)
        np.testing.assert_allclose(again, found, rtol=1e-5, atol=1e-6)


def test_extremities_of_a_star_are_its_tips():
    # Arms of unequal length from one middle: the tips, whatever their order.
    lengths = (5, 4, 4, 3, 6)
    length = np.concatenate([[0], *(np.arange(1, n + 1) for n in lengths)])
    arm = np.concatenate([[-1], np.repeat(range(5), lengths)])
    same = arm[:, None] == arm[None]
    apart = length[:, None] + length[None]
    geodesics = np.where(same, abs(length[:, None] - length[None]), apart)
    mass = np.full(len(length), 1 / len(length))
    found = extremities(jnp.asarray(geodesics, float), jnp.asarray(mass), num=5)
    assert set(np.asarray(found)) == set(np.cumsum(lengths))
    assert found[0] == len(length) - 1


def test_every_assignment_is_listed_once():
    of_x, of_y = assignments(4, 3)
    found = [
        frozenset(zip(*pair, strict=True)) for pair in zip(of_x, of_y, strict=True)
    ]
    partial_maps = {
        frozenset((i, j) for i, j in enumerate(order) if i != left)
        for order in permutations(range(4))
        for left in range(4)
    }
    assert len(found) == len(set(found)) and set(found) == partial_maps


def test_the_identity_is_the_least_uneven():
    few = search_samples(features(SPEC), settings=FEW)
    pair = SamplePair(few.search_points, few.search_points, False)
    flipped = jnp.diag(jnp.where(jnp.arange(30) % 3 == 1, -1.0, 1.0))
    maps = jnp.stack([jnp.eye(30), flipped]).astype(SPEC.evecs.dtype)
    found = log_stretch_std(pair, few.geodesics, few.geodesics, maps)
    assert found[0] < 1e-3 < found[1]


def far(spec_x, spec_y, **options):
    """Candidates of two spectra that share the columns of `columns_of`."""
    x, y = (
        search_samples(features(spec, desc), settings=FEW)
        for spec, desc in (spec_x, spec_y)
    )
    return nonisometric_candidates(x, y, settings=FEW, **options)


@pytest.mark.slow
def test_starts_from_extremities_find_the_identity():
    found = far((SPEC, DESC), (SPEC, DESC))
    size = FEW.final_ks[0]
    lead = np.asarray(found.C_yx[:, :size, :size])
    assert np.abs(lead - np.eye(size)).max((1, 2)).min() < 0.1
    assert found.C_yx.shape == (3, FEW.final_ks[-1], FEW.final_ks[-1])


@pytest.mark.slow
def test_candidates_ignore_padding_and_units():
    (x, desc), y = (SPEC, DESC), (OTHER, OTHER_DESC)
    found = far((x, desc), y)
    padded = jax.tree.map(jnp.asarray, pad(x, len(x.mass) + 9, len(x.faces) + 5))
    rows = jnp.pad(desc, ((0, 9), (0, 0)))
    # A shape of area 1 has no unit left in its spectrum, only in its vertices.
    for side in ((padded, rows), (x._replace(vertices=3 * x.vertices), desc)):
        np.testing.assert_allclose(far(side, y).C_yx, found.C_yx, atol=1e-4)


def mirrored(spec):
    image = spec.vertices * jnp.array([-1.0, 1.0, 1.0])[None]
    return spec._replace(vertices=image, faces=spec.faces[:, ::-1])


@given(testing.permutations(162), testing.permutations(162))
@settings(max_examples=3)
def test_candidates_ignore_the_order_of_vertices(by_x, by_y):
    sides = (SPEC, DESC, by_x), (OTHER, OTHER_DESC, by_y)
    turned = [(testing.relabel_spectrum(s, by), d[by]) for s, d, by in sides]
    plain = far((SPEC, DESC), (OTHER, OTHER_DESC)).C_yx
    np.testing.assert_allclose(far(*turned).C_yx, plain, atol=1e-6)


@pytest.mark.slow
@given(testing.signs(DEFAULT.eigenpairs), testing.signs(DEFAULT.eigenpairs))
@settings(max_examples=3)
def test_candidates_follow_the_signs_of_eigenvectors(by_x, by_y):
    flipped = testing.flip_signs(SPEC, by_x), testing.flip_signs(OTHER, by_y)
    plain = far((SPEC, DESC), (OTHER, OTHER_DESC)).C_yx
    found = far((flipped[0], DESC), (flipped[1], OTHER_DESC)).C_yx
    wanted = jax.vmap(lambda C: testing.flip_map(C, by_x, by_y))(plain)
    np.testing.assert_allclose(found, wanted, atol=1e-6)


@pytest.mark.slow
@given(testing.motions())
@settings(max_examples=3)
def test_candidates_ignore_motion(motion):
    turn, shift = map(jnp.asarray, motion)
    moved = SPEC._replace(vertices=SPEC.vertices @ turn.T + shift[None])
    plain = far((SPEC, DESC), (OTHER, OTHER_DESC)).C_yx
    found = far((moved, DESC), (OTHER, OTHER_DESC)).C_yx
    np.testing.assert_allclose(found, plain, atol=1e-5)


@pytest.mark.slow
def test_candidates_of_mirror_images():
    x, y = (SPEC, DESC), (OTHER, OTHER_DESC)
    image_x, image_y = (mirrored(SPEC), DESC), (mirrored(OTHER), OTHER_DESC)
    for plain, same in (
        (far(x, y), far(image_x, image_y)),
        (far(x, y), far(image_x, y, sign=-1)),
        (far(x, y, sign=-1), far(x, image_y)),
    ):
        np.testing.assert_allclose(same.C_yx, plain.C_yx, atol=1e-6)
        np.testing.assert_allclose(same.energy, plain.energy, atol=1e-6)


@pytest.mark.slow
def test_candidates_under_vmap():
    pairs = ((SPEC, DESC), (OTHER, OTHER_DESC)), ((OTHER, OTHER_DESC), (SPEC, DESC))
    together = jax.vmap(far)(
        *(testing.stack(list(sides)) for sides in zip(*pairs, strict=True))
    )
    for i, pair in enumerate(pairs):
        np.testing.assert_allclose(together.C_yx[i], far(*pair).C_yx, atol=1e-5)


def test_exchanged_shapes_have_transposed_candidates():
    """Each way finds the other's best map, if shapes are alike."""
    near = testing.blob_spectrum(0, DEFAULT.eigenpairs)
    near = near._replace(vertices=near.vertices * jnp.array([1.0, 1.0, 1.02])[None])
    there, back = far((SPEC, DESC), (near, DESC)), far((near, DESC), (SPEC, DESC))
    best_there, best_back = (
        found.C_yx[jnp.argmin(found.energy), :20, :20] for found in (there, back)
    )
    np.testing.assert_allclose(best_there, best_back.T, atol=0.05)

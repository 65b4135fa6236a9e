"""Coarse copies: shapes at few vertices, on which further starts are tried."""

from functools import cache

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import KDTree
from shapes import small

import jfsf
from jfsf import testing
from jfsf.arguments import MatchInputs
from jfsf.coarse import coarse_copy, padded_copies
from jfsf.evaluate import geodesic_error
from jfsf.initial import SearchSettings
from jfsf.runtime import pad
from jfsf.settings import Settings
from jfsf.spectral import functional_map

NAMES = "man_walk", "man_up"
FEW = Settings(coarse_vertices=300)


@cache
def whole(name):
    mesh, vertex = small(name, 2000)
    return jfsf.basis(mesh, cache=False), vertex


@cache
def copy(name):
    return coarse_copy(whole(name)[0], settings=FEW)


@pytest.mark.parametrize("name", NAMES)
def test_a_copy_has_the_eigenfunctions_of_the_whole(name):
    (spec, _), (own, on_whole, on_copy) = whole(name), copy(name)
    n = len(own.mass)
    assert 250 < n < 350 < len(spec.mass)
    assert on_whole.shape == (n,) and on_copy.shape == spec.mass.shape
    np.testing.assert_array_equal(own.evals, spec.evals)
    np.testing.assert_array_equal(own.evecs, np.asarray(spec.evecs)[on_whole])
    assert own.mass.min() > 0
    np.testing.assert_allclose(own.mass.sum(), 1)
    assert own.faces.min() == 0 and own.faces.max() == n - 1


@pytest.mark.parametrize("name", NAMES)
def test_a_copy_lies_on_the_whole(name):
    spec, (own, on_whole, on_copy) = whole(name)[0], copy(name)
    points = np.asarray(spec.vertices)
    near, at = KDTree(points).query(own.vertices)
    np.testing.assert_array_equal(at, on_whole)
    assert near.max() < 0.05
    np.testing.assert_array_equal(KDTree(own.vertices).query(points)[1], on_copy)


def test_a_functional_map_of_the_copies_is_one_of_the_whole_shapes():
    k = 20
    (spec_x, at_x), (spec_y, at_y) = map(whole, NAMES)
    own_x, own_y = (copy(name).spectrum for name in NAMES)
    # The true map, as the template says it.
    near = KDTree(np.asarray(spec_x.vertices)[at_x]).query(spec_x.vertices)[1]
    T_xy = at_y[near]
    T_copies = copy("man_up").on_copy[T_xy[copy("man_walk").on_whole]]
    cut = lambda spec: spec._replace(evals=spec.evals[:k], evecs=spec.evecs[:, :k])
    there, here = (
        np.asarray(functional_map(jnp.asarray(T), cut(x), cut(y)))
        for T, x, y in ((T_xy, spec_x, spec_y), (T_copies, own_x, own_y))
    )
    assert np.linalg.norm(there - here) < 0.2 * np.linalg.norm(there)


def test_padding_is_left_out():
    spec = testing.blob_spectrum(0, 40, 3)
    n, m = len(spec.mass), len(spec.faces)
    plain = coarse_copy(spec, settings=FEW)
    padded = coarse_copy(pad(spec, n + 7, m + 9), settings=FEW)
    for ours, theirs in zip(padded.spectrum, plain.spectrum, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    np.testing.assert_array_equal(padded.on_copy, plain.on_copy)


def test_a_shape_of_few_vertices_is_its_own_copy():
    spec = testing.blob_spectrum(0, 40)
    own, on_whole, on_copy = coarse_copy(spec, settings=FEW)
    n = len(spec.mass)
    np.testing.assert_array_equal(own.evecs, spec.evecs)
    np.testing.assert_array_equal(own.faces, spec.faces)
    np.testing.assert_array_equal(on_whole, np.arange(n))
    np.testing.assert_array_equal(on_copy, np.arange(n))


def test_a_shape_that_falls_apart_is_its_own_copy():
    spec = testing.blob_spectrum(0, 40, 3)
    # Of its surface a small piece is left.
    torn = spec._replace(faces=spec.faces[:20])
    assert len(coarse_copy(torn, settings=FEW).spectrum.mass) == len(spec.mass)


def test_arguments_move_to_the_copies():
    specs = [whole(name)[0] for name in NAMES]
    landmarks = np.array([3, 70]), np.array([8, 20])
    descriptors = tuple(np.asarray(spec.vertices) for spec in specs)
    given = MatchInputs(landmarks, descriptors, np.eye(30), sign=-1)
    pair, found = padded_copies([copy(name) for name in NAMES], given)
    assert found.initial is None and found.sign == -1
    for spec, own, at, there in zip(
        specs, pair, landmarks, found.landmarks, strict=True
    ):
        away = np.asarray(own.vertices)[there] - np.asarray(spec.vertices)[at]
        assert np.linalg.norm(away, axis=1).max() < 0.1
    for own, values in zip(pair, found.descriptors, strict=True):
        real = np.asarray(own.mass) > 0
        assert len(values) == len(real) > real.sum()
        assert np.linalg.norm(values - own.vertices, axis=1)[real].max() < 0.05


@pytest.fixture(scope="module")
def by_copies(all_run_once):
    # No first map is sure enough. Small programs: the way is under test. The copies are
    # padded to the size of the whole shapes.
    search = SearchSettings(samples=60, final_samples=100, assignments=20)
    doubtful = Settings(
        k=40,
        ks=(30, 40),
        search=search,
        bend_rounds=3,
        retry_below=1.0,
        coarse_vertices=200,
        nonisometric_attempts=2,
    )
    names = []
    (x, _), (y, _) = small("man_walk", 620), small("man_up", 600)
    found = jfsf.match(x, y, settings=doubtful, cache=False, progress=names.append)
    return found, names


def test_a_doubtful_pair_is_matched_by_its_copies(by_copies):
    found, names = by_copies
    candidates = Settings().search.nonisometric_candidates
    assert names.count("further starts") == 1 and names.count("spectra") == 1
    # Those of the first map, those of all on the copies, and no other.
    assert names.count("refinement") == 2 and candidates > 1
    tried = len(found.info.source)
    assert found.info.sources == ["search", *["coarse copies"] * (tried - 1)]
    assert 1 <= tried <= 3 and names.count("bending and conversion") == 2 + tried - 1
    assert 0 <= found.certificate.share <= 1
    assert found.info.confidence.shape == (tried,)


def test_the_right_map_stays_the_best(by_copies):
    (_, gt_x), (y, gt_y) = small("man_walk", 620), small("man_up", 600)
    at = slice(None, None, 20)
    assert geodesic_error(by_copies[0].T_xy, y, gt_x[at], gt_y[at]).mean() < 0.05


def test_few_coarse_vertices_are_an_error():
    with pytest.raises(ValueError, match="coarse_vertices is 100; give 160 or more"):
        Settings(coarse_vertices=100)

"""`jfsf.learned`: what the network reads, what it says, and what it is asked."""

import hashlib
import json
from importlib.resources import files

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from precisions import FLOATS
from scipy.spatial.transform import Rotation
from shapes import sphere

import jfsf
from experiments import command_line
from jfsf import Mesh, data
from jfsf.geometry import GeodesicSolver
from jfsf.learned import (
    agreement,
    best_agreement,
    place_chances,
    places_on_person,
)
from jfsf.learned._inputs import EIGENPAIRS, HEAT_TIMES, network_input
from jfsf.learned._network import WEIGHTS
from jfsf.learned._places import PEOPLE, likeness, likeness_of_both
from jfsf.mesh import decimate, surface_area
from jfsf.mesh._closest import nearest_vertices
from jfsf.mesh._geometry import boundary_edges
from jfsf.runtime._sizes import pad
from jfsf.testing import cast, mirror, move

VERTICES = 700
NAMES = "man_walk", "woman_up"


@pytest.fixture(scope="module")
def bodies():
    """Two people in other poses, at few vertices."""
    return [decimate(data.load(name).mesh, VERTICES) for name in NAMES]


@pytest.fixture(scope="module")
def spectra(bodies):
    return [jfsf.spectrum(mesh, EIGENPAIRS, cache=False) for mesh in bodies]


def cut_open(mesh: Mesh) -> Mesh:
    """Without what lies above its middle."""
    height = mesh.vertices[:, 1]
    kept = (height < np.quantile(height, 0.7))[mesh.faces].all(1)
    return jfsf.mesh.largest_component(Mesh(mesh.vertices, mesh.faces[kept])).mesh


def test_heat_and_the_rim_are_read_as_their_formulas_say(bodies):
    spec = jfsf.spectrum(cut_open(bodies[0]), EIGENPAIRS, cache=False)
    found = np.asarray(network_input(spec).inputs)
    times = np.array(HEAT_TIMES)
    heat = spec.evecs**2 @ np.exp(-spec.evals[:, None] * times)
    expected = np.log(heat) - np.log(1 + 1 / (4 * np.pi * times))
    np.testing.assert_allclose(found[:, : len(times)], expected, rtol=1e-4, atol=1e-4)

    rim = np.zeros(len(spec.mass))
    for edge in boundary_edges(spec.faces):
        rim[edge] += np.linalg.norm(np.diff(spec.vertices[edge], axis=0)) / 2
    assert rim.any()
    for column, time in zip(found[:, -3:].T, (1e-3, 8e-3, 6e-2), strict=True):
        spread = spec.evecs @ (np.exp(-time * spec.evals) * (spec.evecs.T @ rim))
        np.testing.assert_allclose(column, np.arcsinh(spread), rtol=1e-3, atol=1e-3)


def test_slopes_are_gradients_of_the_eigenvectors():
    """The integral of |grad u|^2 is the eigenvalue of u."""
    mesh = sphere(4)
    spec = jfsf.spectrum(mesh, EIGENPAIRS, cache=False)
    slopes = np.asarray(network_input(spec).slopes)[..., 1:9]
    energy = spec.mass @ (slopes**2).sum(1)
    np.testing.assert_allclose(energy, spec.evals[1:9], rtol=0.02)


def test_a_motion_and_another_size_change_nothing(bodies, spectra):
    turn = Rotation.from_euler("xyz", [0.4, 1.2, -0.7]).as_matrix()
    moved = move(bodies[0], (turn, np.array([3.0, -1.0, 2.0])), unit=40.0)
    again = jfsf.spectrum(moved, EIGENPAIRS, cache=False)
    first, second = (np.asarray(place_chances(s)) for s in (spectra[0], again))
    # Signs of eigenvectors and frames of the tangent planes differ.
    np.testing.assert_allclose(first, second, atol=2e-3)


def test_left_is_not_right(bodies, spectra):
    """Of the mirror image the chances are those of the other side."""
    spec = jfsf.spectrum(mirror(bodies[0]), EIGENPAIRS, cache=False)
    first, second = (np.asarray(place_chances(s)) for s in (spectra[0], spec))
    assert np.abs(first - second).sum(1).mean() > 0.5


def test_padding_jit_and_vmap_change_nothing(spectra):
    alone = [np.asarray(place_chances(spec)) for spec in spectra]
    padded = [jax.tree.map(jnp.asarray, pad(spec, 1024, 2048)) for spec in spectra]
    both = jax.vmap(place_chances)(jax.tree.map(lambda *a: jnp.stack(a), *padded))
    for spec, one, found in zip(spectra, alone, np.asarray(both), strict=True):
        n = len(spec.mass)
        assert one.shape[0] == n and one.dtype == np.float32
        np.testing.assert_allclose(one.sum(1), 1, rtol=1e-5)
        np.testing.assert_allclose(found[:n], one, atol=1e-3)


@pytest.mark.parametrize("dtype", FLOATS)
def test_both_precisions_say_the_same(spectra, dtype):
    found = np.asarray(place_chances(cast(spectra[0], dtype)))
    expected = np.asarray(place_chances(spectra[0]))
    np.testing.assert_allclose(found, expected, atol=5e-3)


def test_two_people_are_matched_by_the_places_alone(bodies, spectra):
    chances = [np.asarray(place_chances(spec)) for spec in spectra]
    places = places_on_person((chances[0], chances[1]), tuple(spectra))
    assert places is not None
    T_xy = best_agreement(*places)
    samples = [data.load(name) for name in NAMES]
    at_x, at_y = (
        nearest_vertices(body, own.mesh)[own.template_to_vertex[::50]]
        for body, own in zip(bodies, samples, strict=True)
    )
    far = GeodesicSolver(bodies[1]).rows(at_y) / np.sqrt(surface_area(bodies[1]))
    errors = far[np.arange(len(far)), T_xy[at_x]]
    assert np.median(errors) < 0.05 and errors.mean() < 0.1


def test_a_sphere_is_no_person(spectra):
    spec = jfsf.spectrum(sphere(4), EIGENPAIRS, cache=False)
    body = spectra[0]
    assert likeness(place_chances(spec), spec) < PEOPLE / 2
    assert likeness(place_chances(body), body) > 2 * PEOPLE
    chances = place_chances(body), place_chances(spec)
    assert likeness_of_both(chances, (body, spec)) < PEOPLE
    assert places_on_person(chances, (body, spec)) is None


def test_two_shapes_are_as_like_people_as_both_are(spectra):
    chances = place_chances(spectra[0]), place_chances(spectra[1])
    x, y = map(likeness, chances, spectra)
    both = likeness_of_both(chances, (spectra[0], spectra[1]))
    assert min(x, y) < both < max(x, y)
    assert both**2 == pytest.approx(x * y)


def test_too_few_eigenpairs_are_an_error(bodies):
    spec = jfsf.spectrum(bodies[0], EIGENPAIRS - 1, cache=False)
    with pytest.raises(ValueError, match=f"{EIGENPAIRS - 1} eigenpairs.* {EIGENPAIRS}"):
        place_chances(spec)


def test_agreement_is_the_overlap_of_chances():
    rng = np.random.default_rng(0)
    x, y = (rng.dirichlet(np.ones(5), size=n) for n in (7, 4))
    T_xy = rng.integers(0, 4, 7)
    expected = [
        sum(np.sqrt(p * q) for p, q in zip(x[i], y[T_xy[i]], strict=True))
        for i in range(7)
    ]
    np.testing.assert_allclose(agreement(T_xy, x, y), expected)
    best = [max(range(4), key=lambda j: np.sqrt(x[i] * y[j]).sum()) for i in range(7)]
    np.testing.assert_array_equal(best_agreement(x, y), best)
    np.testing.assert_allclose(agreement(np.arange(7), x, x), 1)


def test_the_weights_are_those_that_the_script_made():
    known = json.loads((command_line.RESULTS / "learn_people.json").read_text())
    weights = files("jfsf.learned") / WEIGHTS
    assert (
        hashlib.sha256(weights.read_bytes()).hexdigest() == known["weights"]["sha256"]
    )
    assert len(weights.read_bytes()) < 2_000_000

"""Small holes are closed as the surface was, and nothing else is."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.distance import pdist
from shapes import frozen

from jfsf import data, testing
from jfsf.mesh import check, largest_component, surface_area, without_holes
from jfsf.mesh._geometry import edges
from jfsf.spectral import spectrum
from jfsf.types import Mesh

BLOB = testing.blob(2, subdivisions=4)
N = len(BLOB.vertices)
SIDES = np.diff(BLOB.vertices[edges(BLOB.faces).ends], axis=1)
LONGEST = np.linalg.norm(SIDES, axis=2).max() / np.sqrt(surface_area(BLOB))


def without_balls(mesh, centres, radius):
    """The faces that are not within a radius, in sqrt(area), of some vertices."""
    radius *= np.sqrt(surface_area(mesh))
    near = np.zeros(len(mesh.vertices), bool)
    for centre in mesh.vertices[centres]:
        near |= np.linalg.norm(mesh.vertices - centre, axis=1) < radius
    return largest_component(Mesh(mesh.vertices, mesh.faces[~near[mesh.faces].any(1)]))


@given(st.integers(1, 4), testing.seeds)
def test_small_holes_are_closed(number, seed):
    centres = np.random.default_rng(seed).choice(N, number, replace=False)
    apart = pdist(BLOB.vertices[centres]) / np.sqrt(surface_area(BLOB))
    assume((apart > 0.06 + 2 * LONGEST).all())  # else two may be one large hole
    holed = frozen(without_balls(BLOB, centres, 0.03).mesh)
    before = check(holed)
    assert not before.closed and not before.nonmanifold_vertices
    found = without_holes(holed)
    assert found.vertices is holed.vertices
    m = len(holed.faces)
    assert np.array_equal(found.faces[:m], holed.faces)
    report = check(found)
    assert report.closed and report.outward and report.components == 1
    assert len(found.faces) == 2 * len(found.vertices) - 4  # still a sphere
    # The strip runs between jagged rims, so it is not as flat as it could be.
    area, gone = surface_area(holed), surface_area(BLOB) - surface_area(holed)
    assert area < surface_area(found) < area + 2 * gone


@pytest.mark.parametrize("name", [*data.names(), "blob"])
def test_closed_meshes_stay(name):
    mesh = BLOB if name == "blob" else data.load(name).mesh
    assert without_holes(mesh) is mesh


def test_large_holes_stay():
    upper = BLOB.faces[BLOB.vertices[BLOB.faces, 2].mean(1) > 0]
    mesh = largest_component(Mesh(BLOB.vertices, upper)).mesh
    assert without_holes(mesh) is mesh
    both = without_balls(mesh, [int(mesh.vertices[:, 2].argmax())], 0.03).mesh
    found = without_holes(both)
    assert check(found).boundary_edges == check(mesh).boundary_edges
    cloud = Mesh(BLOB.vertices, BLOB.faces[:0])
    assert without_holes(cloud) is cloud


def test_a_rim_that_touches_itself_stays():
    # Two faces that share one vertex only leave a hole like an eight.
    one = int(BLOB.faces[0, 0])
    around = np.flatnonzero((BLOB.faces == one).any(1))
    ring = edges(BLOB.faces[around]).ends
    order = [around[0]]
    while len(order) < len(around):
        last = BLOB.faces[order[-1]]
        order.append(
            next(
                f
                for f in around
                if f not in order and len(np.intersect1d(BLOB.faces[f], last)) == 2
            )
        )
    assert len(ring) and len(order) >= 5
    mesh = Mesh(BLOB.vertices, np.delete(BLOB.faces, [order[0], order[2]], 0))
    assert check(mesh).nonmanifold_vertices == 1
    assert without_holes(mesh) is mesh


def test_units_do_not_matter():
    holed = without_balls(BLOB, [5, 700], 0.03).mesh
    found = without_holes(holed)
    for unit in (1e-6, 1e6):
        other = without_holes(Mesh(unit * holed.vertices, holed.faces))
        assert np.array_equal(other.faces, found.faces)


def test_the_spectrum_is_nearly_that_of_the_whole():
    mesh = testing.blob(2, subdivisions=4)
    holed = without_balls(mesh, np.arange(0, N, 250), 0.035).mesh
    true, open_, closed = (
        spectrum(m, 20, cache=False).evals[1:]
        for m in (mesh, holed, without_holes(holed))
    )
    away = lambda found: np.abs(np.log(found / true)).mean()
    assert away(closed) < 0.5 * away(open_)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint32, np.uint64])
def test_faces_without_a_sign(dtype):
    ball = testing.blob(0, subdivisions=1)
    whole, few = (
        without_holes(Mesh(ball.vertices, ball.faces[4:].astype(kind)))
        for kind in (np.int32, dtype)
    )
    np.testing.assert_array_equal(whole.faces, few.faces)

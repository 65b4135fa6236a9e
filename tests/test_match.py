"""Two meshes to a map, and what must not change it. One size: one compilation."""

import sys
from functools import cache

import fast_simplification
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import KDTree

import jfsf
import jfsf.data
from jfsf import compiling, pipeline, testing
from jfsf.metrics import geodesic_error
from jfsf.search import HYPOTHESES
from jfsf.types import Mesh


@cache
def small(name, faces):
    """A decimated shape, and its vertex for each template point."""
    mesh, vertex = jfsf.data.load(name)
    points, corners = fast_simplification.simplify(
        mesh.vertices.astype(np.float32), mesh.faces, target_count=faces
    )
    near = np.asarray(KDTree(points).query(mesh.vertices)[1])
    return Mesh(points.astype(np.float64), corners.astype(np.int32)), near[vertex]


@cache
def template():
    """Points of the template in T pose, and each one's mirror image."""
    rest, vertex = jfsf.data.load("man_t")
    points = rest.vertices[vertex]
    return points, KDTree(points).query(points * (-1, 1, 1))[1]


@cache
def plain():
    (mesh_x, _), (mesh_y, _) = shapes()
    return jfsf.match(mesh_x, mesh_y, cache=False)


def shapes():
    return small("man_walk", 1000), small("man_up", 900)


def error(found, mesh_y=None):
    (_, gt_x), (own_y, gt_y) = shapes()
    at = slice(None, None, 20)
    return geodesic_error(found.T_xy, mesh_y or own_y, gt_x[at], gt_y[at]).mean()


def same(found, share=1.0):
    for ours, theirs in ((found.T_xy, plain().T_xy), (found.T_yx, plain().T_yx)):
        assert (np.asarray(ours) == np.asarray(theirs)).mean() >= share


def nearly_same(found):
    """Up to rounding: it decides ties, which a dozen rounds carry on."""
    same(found, 0.8)
    (mesh, _) = shapes()[1]
    one, two, _ = mesh.vertices[mesh.faces.T]
    edge = np.linalg.norm(one - two, axis=1).mean()
    apart = mesh.vertices[found.T_xy] - mesh.vertices[plain().T_xy]
    assert np.linalg.norm(apart, axis=1).mean() < edge / 5


def test_the_truth_is_found():
    (mesh_x, _), (mesh_y, _) = shapes()
    found = plain()
    n_x, n_y = len(mesh_x.vertices), len(mesh_y.vertices)
    assert n_x != n_y
    assert found.T_xy.shape == (n_x,) and found.T_yx.shape == (n_y,)
    assert 0 <= found.T_xy.min() and found.T_xy.max() < n_y
    assert 0 <= found.T_yx.min() and found.T_yx.max() < n_x
    assert error(found) < 0.05


@pytest.mark.slow  # the whole of match, compiled once more
def test_large_meshes_are_matched_through_tiles_and_samples(monkeypatch):
    for name, value in (("TILED", 200), ("LARGE", 300), ("REFINED", 250)):
        monkeypatch.setattr(pipeline, name, value)
    module = sys.modules[jfsf.match.__module__]
    specs = module.common(*(module.basis(mesh, cache=False) for mesh, _ in shapes()))
    specs = jax.tree.map(jnp.asarray, specs)
    # Compiled afresh: the limits are constants of a program.
    found = jax.jit(
        lambda x, y: pipeline._match_spectra.__wrapped__(
            x, y, None, 1, False, hypotheses=HYPOTHESES
        )
    )(*specs)
    assert found.T_xy.shape == (len(shapes()[0][0].vertices),)
    # Samples of a mesh of 500 vertices are few.
    assert error(found) < 1.3 * error(plain())


def test_the_certificate_says_so():
    found = plain().certificate
    assert found.finite and found.empty == 0
    assert found.orientation > 0.8
    assert 0.7 < found.coverage_xy <= 1 and 0.7 < found.coverage_yx <= 1
    assert 0 <= found.bijectivity_x < 0.1 and 0 <= found.bijectivity_y < 0.1
    assert 0.3 < found.nn_agreement <= 1 and 0 <= found.marginal_error < 0.5
    assert 0 <= found.orthogonality < 2
    assert all(np.shape(field) == () for field in found)


def test_units_motion_and_winding_change_nothing():
    (mesh_x, _), (mesh_y, _) = shapes()
    moved = testing.move(mesh_x, turned(), unit=1000.0)
    inside_out = mesh_y._replace(faces=mesh_y.faces[:, ::-1])
    # Coordinates and faces given otherwise sum up otherwise.
    for other in (mesh_y, inside_out):
        nearly_same(jfsf.match(moved, other, cache=False))


def as_match_does(*specs):
    """Padded as `match` pads: the same program."""
    module = sys.modules[jfsf.match.__module__]
    sizes = module._sizes(*(mesh for mesh, _ in shapes()))
    given = *map(module._padded, specs, sizes), None, 1, False
    return module._program(*given)(*given)


@pytest.mark.parametrize("x64", [False, True])
def test_the_program_is_compiled_for_what_it_gets(x64):
    module = sys.modules[jfsf.match.__module__]
    (mesh_x, _), (mesh_y, _) = shapes()
    cloud = mesh_x._replace(faces=mesh_x.faces[:0])
    with jax.enable_x64(x64):
        for meshes in ((mesh_x, mesh_y), (cloud, mesh_y), (mesh_x,)):
            for mesh, size in zip(meshes, module._sizes(*meshes), strict=True):
                spec = module._padded(module.basis(mesh, cache=False), size)
                like = jax.tree.map(jax.typeof, module._like(*size))
                assert jax.tree.map(jax.typeof, spec) == like


def test_signs_of_eigenvectors_change_nothing():
    module = sys.modules[jfsf.match.__module__]
    specs = module.common(*(module.basis(mesh, cache=False) for mesh, _ in shapes()))
    rng = np.random.default_rng(0)
    by = [rng.choice((-1.0, 1.0), len(spec.evals)) for spec in specs]
    for one in by:
        one[0] = 1
    flipped = map(testing.flip_signs, specs, by)
    found = as_match_does(*flipped)
    n_x, n_y = (len(mesh.vertices) for mesh, _ in shapes())
    same(found._replace(T_xy=found.T_xy[:n_x], T_yx=found.T_yx[:n_y]), 0.97)
    C_yx = testing.flip_map(found.C_yx, *by)
    np.testing.assert_allclose(C_yx[:30, :30], plain().C_yx[:30, :30], atol=0.1)


def test_turns_of_repeated_eigenvectors_change_nothing():
    module = sys.modules[jfsf.match.__module__]
    specs = module.common(*(module.basis(mesh, cache=False) for mesh, _ in shapes()))

    def repeated(spec, angle):
        """Eigenvalues 4 and 5 become one, and its eigenvectors turn."""
        evals, evecs, at = np.array(spec.evals), np.array(spec.evecs), slice(4, 6)
        c, s = np.cos(angle), np.sin(angle)
        evals[at] = evals[at].mean()
        evecs[:, at] = evecs[:, at] @ [[c, -s], [s, c]]
        return spec._replace(evals=evals, evecs=evecs)

    (mesh_x, gt_x), (mesh_y, gt_y) = shapes()
    n_x, some = len(mesh_x.vertices), slice(None, None, 20)
    maps, errors = [], []
    for angles in ((0, 0), (0.7, -2)):
        turned = map(repeated, specs, angles)
        found = as_match_does(*turned)
        maps.append(np.asarray(found.T_xy[:n_x]))
        error = geodesic_error(maps[-1], mesh_y, gt_x[some], gt_y[some])
        errors.append(error.mean())
    # Other starts and another course, which rounding ends on near vertices.
    apart = mesh_y.vertices[maps[0]] - mesh_y.vertices[maps[1]]
    size = np.linalg.norm(np.ptp(mesh_y.vertices, 0))
    assert np.linalg.norm(apart, axis=1).mean() < size / 100
    assert max(errors) < 1.1 * min(errors) and max(errors) < 0.05


def test_both_mirrored_is_neither_mirrored():
    (mesh_x, _), (mesh_y, _) = shapes()
    found = jfsf.match(testing.mirror(mesh_x), testing.mirror(mesh_y), cache=False)
    nearly_same(found)


def test_swapping_the_shapes_swaps_the_maps():
    (mesh_x, gt_x), (mesh_y, gt_y) = shapes()
    found = jfsf.match(mesh_y, mesh_x, cache=False)
    at = slice(None, None, 20)
    forth = geodesic_error(found.T_yx, mesh_y, gt_x[at], gt_y[at]).mean()
    back = geodesic_error(found.T_xy, mesh_x, gt_y[at], gt_x[at]).mean()
    assert forth < 1.2 * error(plain()) and back < 0.05
    # Maps are read off T_xy on the way, so the two ways round differ in detail.
    moved = mesh_y.vertices[found.T_yx] - mesh_y.vertices[plain().T_xy]
    size = np.linalg.norm(np.ptp(mesh_y.vertices, 0))
    assert np.linalg.norm(moved, axis=1).mean() < size / 50


def compiled():
    return compiling._ready.cache_info().currsize


def turned():
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    return turn * np.sign(np.linalg.det(turn)), np.array([1.0, -2.0, 3.0])


def test_reverse_asks_for_the_mirror_image():
    (mesh_x, _), (mesh_y, _) = shapes()
    found = jfsf.match(mesh_x, mesh_y, orientation="reverse", cache=False)
    assert found.certificate.orientation < -0.5
    # Against the mirror image of Y it is the right map.
    other = jfsf.match(
        mesh_x, testing.mirror(mesh_y), orientation="reverse", cache=False
    )
    assert other.certificate.orientation < -0.5 and error(other) < 0.05


def test_left_goes_to_right():
    _, (mesh, vertex) = shapes()
    _, opposite = template()
    found = jfsf.symmetry(mesh, cache=False)
    at = slice(None, None, 20)
    for T in (found.T_xy, found.T_yx):
        assert geodesic_error(T, mesh, vertex[at], vertex[opposite][at]).mean() < 0.06
        assert geodesic_error(T, mesh, vertex[at], vertex[at]).mean() > 0.3
    assert found.certificate.orientation < -0.8
    # It undoes itself.
    size = np.linalg.norm(np.ptp(mesh.vertices, 0))
    twice = mesh.vertices[found.T_xy[found.T_xy]] - mesh.vertices
    assert np.linalg.norm(twice, axis=1).mean() < size / 50


def test_the_orientation_may_be_traced():
    # One program for all: its sizes are those of the other tests.
    before = compiled()
    (mesh_x, _), (mesh_y, _) = shapes()
    plain()
    jfsf.match(mesh_x, mesh_y, orientation="any", cache=False)
    jfsf.match(mesh_x, mesh_y, orientation="reverse", cache=False)
    assert compiled() <= before + 1


def test_a_cloud_has_no_left_and_right():
    cloud = testing.blob(0)._replace(faces=np.zeros((0, 3), np.int32))
    with pytest.raises(jfsf.MeshError, match="symmetry: mesh has 162 vertices and no"):
        jfsf.symmetry(cloud, cache=False)


def test_one_landmark_decides_a_flip():
    (mesh_x, gt_x), (mesh_y, gt_y) = shapes()
    points, opposite = template()
    hand = points[:, 0].argmax()
    for truth, way in ((gt_y, 1), (gt_y[opposite], -1)):
        known = np.array([[gt_x[hand], truth[hand]]])
        found = jfsf.match(
            mesh_x, mesh_y, orientation="any", landmarks=known, cache=False
        )
        assert way * found.certificate.orientation > 0.8
        at = slice(None, None, 20)
        assert geodesic_error(found.T_xy, mesh_y, gt_x[at], truth[at]).mean() < 0.05


@pytest.mark.slow
def test_point_clouds():
    (mesh_x, _), (mesh_y, _) = shapes()
    cloud = mesh_x._replace(faces=np.zeros((0, 3), np.int32))
    found = jfsf.match(cloud, mesh_y, cache=False)
    assert found.T_xy.shape == (len(mesh_x.vertices),)
    assert np.isnan(found.certificate.orientation) and found.certificate.finite


@pytest.mark.parametrize("side", ["mesh_x", "mesh_y"])
def test_a_bad_mesh_is_named(side):
    good = testing.blob(0)
    twice = Mesh(
        np.concatenate([good.vertices, good.vertices + 9]),
        np.concatenate([good.faces, good.faces + len(good.vertices)]),
    )
    pair = {"mesh_x": good, "mesh_y": good} | {side: twice}
    with pytest.raises(jfsf.MeshError, match=f"{side}: has 2 connected components"):
        jfsf.match(**pair, cache=False)
    pair[side] = testing.blob(0, subdivisions=0)
    with pytest.raises(jfsf.MeshError, match=f"{side}: has 12 vertices, fewer than"):
        jfsf.match(**pair, cache=False)
    # Found before the faces are wound, which would trip over it.
    pair[side] = good._replace(faces=good.faces + 9)
    with pytest.raises(jfsf.MeshError, match=f"{side}: a face names vertex"):
        jfsf.match(**pair, cache=False)


@pytest.mark.parametrize(
    "landmarks, message",
    [
        ([1, 2], r"landmarks have shape \(2,\)"),
        (np.zeros((0, 2), int), r"landmarks have shape \(0, 2\)"),
        ([[0, 0, 0]], r"landmarks have shape \(1, 3\)"),
        ([[0.5, 1.0]], "landmarks are float64; give vertex numbers"),
        ([[0, 0], [162, 0]], "0 to 162 of mesh_x, which has vertices 0 to 161"),
        ([[0, -1]], "-1 to -1 of mesh_y, which has vertices 0 to 161"),
    ],
)
def test_bad_landmarks(landmarks, message):
    good = testing.blob(0)
    with pytest.raises(ValueError, match="match: .*" + message):
        jfsf.match(good, good, landmarks=landmarks, cache=False)


def test_an_unknown_orientation():
    good = testing.blob(0)
    with pytest.raises(ValueError, match="'preserve', 'reverse' or 'any', not 'left'"):
        jfsf.match(good, good, orientation="left", cache=False)  # type: ignore

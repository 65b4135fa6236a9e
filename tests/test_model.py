"""Shape models: against numpy and scipy, laws, and shapes made of known modes."""

import csv
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.spatial
from scipy.spatial.transform import Rotation

from jfsf import testing
from jfsf.apps import model as room
from jfsf.apps.model._align import align_onto, nearest_rotation
from jfsf.mesh import MeshError, read, surface_area
from jfsf.mesh._geometry import vertex_areas
from jfsf.types import Mesh

RNG = np.random.default_rng(0)
MEAN, FACES = testing.blob(0)
N, S = len(MEAN), 8
SDS = np.array([4e-3, 2e-3, 1e-3])
WEIGHTS = vertex_areas(MEAN, FACES) / surface_area(Mesh(MEAN, FACES))


def orthonormal(fields):
    """Fields (k, n, 3), in order, made orthonormal under the weights."""
    flat = (fields * np.sqrt(WEIGHTS)[:, None]).reshape(len(fields), -1)
    q = np.linalg.qr(flat.T)[0].T
    return q.reshape(fields.shape) / np.sqrt(WEIGHTS)[:, None]


def rigid_fields():
    """Three shifts and three turns of the mean shape."""
    shifts = [np.tile(axis, (N, 1)) for axis in np.eye(3)]
    turns = [np.cross(axis, MEAN - WEIGHTS @ MEAN) for axis in np.eye(3)]
    return np.array(shifts + turns)


# Without shifts and turns: what alignment takes away is no variance.
WAVES = np.sin(MEAN[None] @ RNG.normal(size=(3, 3, 3)))
MODES = orthonormal(np.concatenate([rigid_fields(), WAVES]))[6:]
SCORES = RNG.normal(size=(S, 3))
SCORES = np.linalg.qr(SCORES - SCORES.mean(0))[0] * np.sqrt(S - 1) * SDS
SHAPES = MEAN + np.einsum("sk,kna->sna", SCORES, MODES)
TURNS, SHIFTS = Rotation.random(S, rng=1).as_matrix(), RNG.normal(size=(S, 1, 3))
MOVED = np.einsum("sab,snb->sna", TURNS, SHAPES) + SHIFTS
POINTS = jnp.asarray(MOVED)


def assert_slope(loss, at):
    """That the derivative of a loss is that of its values, in some direction."""
    way = np.random.default_rng(0).normal(size=at.shape)
    evaluate = jax.jit(jax.value_and_grad(loss))
    step = 1e-5
    there, back = (evaluate(jnp.asarray(at + s * step * way))[0] for s in (1, -1))
    slope = np.sum(np.asarray(evaluate(jnp.asarray(at))[1]) * way)
    np.testing.assert_allclose(slope, (there - back) / (2 * step), rtol=1e-4)


@cache
def fitted():
    return room.fit_model(POINTS, FACES)


# Rotations


def test_the_nearest_rotation_is_that_of_scipy_and_never_mirrors():
    nearest = jax.jit(nearest_rotation)
    source, target = RNG.normal(size=(2, 30, 3))
    for sign in (1, -1):
        target = target * [sign, 1, 1]
        truth = Rotation.align_vectors(target, source)[0].as_matrix()
        np.testing.assert_allclose(nearest(target.T @ source), truth, atol=1e-8)


@pytest.mark.parametrize("matrix", [*RNG.normal(size=(2, 3, 3)), np.diag([1, 1, 2.0])])
def test_slopes_of_the_nearest_rotation(matrix):
    # The last has a singular value twice: there the SVD has no derivative.
    weights = np.random.default_rng(1).normal(size=(3, 3))
    assert_slope(lambda m: jnp.sum(nearest_rotation(m) * weights), matrix)


# Alignment


def test_two_shapes_are_aligned_as_scipy_does():
    # Of eight shapes, so that there is one program: the others are the first again.
    both = np.concatenate([MOVED[:1].repeat(S - 1, 0), MOVED[-1:]])
    found = room.align(jnp.asarray(both), scale=True, weights=np.ones(N))
    plain, moved, disparity = scipy.spatial.procrustes(both[0], both[-1])
    # The mean of all has the pose of the first but for rounding and the last's share.
    aligned = np.asarray(found.positions)[[0, -1]]
    onto = np.asarray(align_onto(aligned[0], aligned[1], np.ones(N)))
    unit = np.stack([aligned[0], onto]) - aligned.mean(1, keepdims=True)
    unit /= np.linalg.norm(unit, axis=(1, 2), keepdims=True)
    # scipy also shrinks the second by the cosine between both.
    cosine = np.sqrt(1 - disparity)
    np.testing.assert_allclose(np.sum(unit[0] * unit[1]), cosine, atol=1e-9)
    np.testing.assert_allclose(unit[0], plain, atol=1e-9)
    np.testing.assert_allclose(unit[1] * cosine, moved, atol=1e-6)


def plain_alignment(shapes, weights):
    """Generalised Procrustes analysis in numpy, from the first shape."""
    share = weights / weights.sum()
    offsets = shapes - np.einsum("n,sna->sa", share, shapes)[:, None]
    mean = offsets[0]
    for _ in range(50):
        turned = []
        for shape in offsets:
            u, _, vt = np.linalg.svd(mean.T @ (share[:, None] * shape))
            u[:, 2] *= np.linalg.det(u @ vt)
            turned.append(shape @ (u @ vt).T)
        mean = np.mean(turned, 0)
    return np.array(turned)


def test_alignment_against_numpy():
    found = room.align(POINTS, weights=WEIGHTS)
    positions, rotation, translation, _, mean, _ = map(np.asarray, found)
    # Distances know nothing of the pose of all.
    apart = lambda p: np.linalg.norm(p[1:] - p[:1], axis=2)
    truth = plain_alignment(MOVED, WEIGHTS)
    np.testing.assert_allclose(apart(positions), apart(truth), atol=1e-9)
    np.testing.assert_allclose(positions[0], MOVED[0], atol=1e-9)
    moved = np.einsum("sab,snb->sna", rotation, MOVED) + translation[:, None]
    np.testing.assert_allclose(positions, moved, atol=1e-9)
    np.testing.assert_allclose(mean, positions.mean(0), atol=1e-9)
    # A thousand times its size away.
    far = room.align(POINTS + 1e3, weights=WEIGHTS)
    np.testing.assert_allclose(far.positions, positions + 1e3, atol=1e-9)


@pytest.mark.parametrize("scale", [False, True])
def test_laws_of_alignment(scale):
    sizes = np.linspace(0.5, 2, S) if scale else np.ones(S)
    shapes = MOVED * sizes[:, None, None]

    def aligned(shapes, weights=WEIGHTS):
        found = room.align(jnp.asarray(shapes), scale=scale, weights=weights)
        return np.asarray(found.positions), np.asarray(found.scale)

    known, scales = aligned(shapes)
    np.testing.assert_allclose(np.prod(scales), 1, atol=1e-9)
    equal = scales * sizes
    np.testing.assert_allclose(equal, np.full(S, equal[0]), rtol=0.01)
    # Other motions of all but the first change nothing.
    again = np.concatenate([shapes[:1], shapes[1:] @ TURNS[0] + 5])
    for one, two in zip(aligned(again), (known, scales), strict=True):
        np.testing.assert_allclose(one, two, atol=1e-9)
    # Another order turns all together.
    order = np.roll(np.arange(S), 3)
    turned, other = aligned(shapes[order])
    np.testing.assert_allclose(other, scales[order], atol=1e-9)
    onto = Rotation.align_vectors(
        *(p.reshape(-1, 3) - WEIGHTS @ p[0] for p in (known[order], turned))
    )[0]
    moved = onto.apply((turned - WEIGHTS @ turned[0]).reshape(-1, 3)).reshape(S, N, 3)
    np.testing.assert_allclose(moved + WEIGHTS @ known[0], known[order], atol=1e-7)
    # Other names of the vertices change the names only.
    names = RNG.permutation(N)
    renamed, _ = aligned(shapes[:, names], WEIGHTS[names])
    np.testing.assert_allclose(renamed, known[:, names], atol=1e-9)


# Models


def test_known_modes_are_recovered():
    model = jax.tree.map(np.asarray, fitted())
    np.testing.assert_allclose(np.sqrt(model.variance[:3]), SDS, rtol=1e-2)
    assert model.variance[:3].sum() / model.total_variance > 0.999
    # In the pose of the first shape, as the mean is.
    modes = np.einsum("kna,ba->knb", MODES, TURNS[0])
    overlap = np.einsum("n,kna,lna->kl", model.weights, model.modes[:3], modes)
    np.testing.assert_allclose(np.abs(overlap), np.eye(3), atol=0.03)
    onto = Rotation.align_vectors(
        MEAN - model.weights @ MEAN, model.mean - model.weights @ model.mean
    )
    assert onto[1] / np.sqrt(N) < 1e-3


@pytest.mark.parametrize("dtype, atol", [(np.float64, 1e-9), (np.float32, 1e-5)])
def test_components_against_numpy(dtype, atol):
    shapes = jnp.asarray(MOVED, dtype)
    model = room.fit_model(shapes, FACES, weights=WEIGHTS, modes=3)
    assert all(a.dtype == dtype for a in model if a is not model.faces)
    model = jax.tree.map(np.asarray, model)
    aligned = plain_alignment(MOVED, WEIGHTS)
    rows = ((aligned - aligned.mean(0)) * np.sqrt(WEIGHTS)[:, None]).reshape(S, -1)
    u, sizes, _ = np.linalg.svd(rows, full_matrices=False)
    variance = sizes**2 / (S - 1)
    np.testing.assert_allclose(model.variance, variance[:3], atol=atol)
    np.testing.assert_allclose(model.total_variance, variance.sum(), atol=atol)
    scores = np.abs(u * sizes)[:, :3]
    np.testing.assert_allclose(np.abs(model.scores), scores, atol=10 * atol)
    gram = np.einsum("n,kna,lna->kl", WEIGHTS, model.modes, model.modes)
    np.testing.assert_allclose(gram, np.eye(3), atol=1e-5)
    flat = model.modes.reshape(3, -1)
    assert (flat[range(3), np.abs(flat).argmax(1)] > 0).all()


def test_shapes_and_scores_are_inverse():
    model = fitted()
    found = jax.vmap(room.scores_of, (None, 0))(model, POINTS)
    np.testing.assert_allclose(found, model.scores, atol=1e-8)
    back = jax.vmap(room.shape_at, (None, 0))(model, model.scores)
    aligned = room.align(POINTS, weights=model.weights).positions
    np.testing.assert_allclose(back, aligned, atol=1e-8)
    np.testing.assert_allclose(room.shape_at(model, model.scores[1]), back[1])
    np.testing.assert_array_equal(room.shape_at(model, jnp.zeros(0)), model.mean)
    assert_slope(lambda x: jnp.sum(room.shape_at(model, x) ** 2), np.asarray(found[0]))
    assert_slope(lambda x: jnp.sum(jnp.sin(room.scores_of(model, x))), MOVED[1])


def test_a_scaled_model_scales_what_it_is_given():
    shapes = jnp.asarray(MOVED * np.linspace(0.5, 2, S)[:, None, None])
    model = room.fit_model(shapes, FACES, scale=True)
    found = jax.vmap(room.scores_of, (None, 0))(model, 3 * shapes)
    np.testing.assert_allclose(found, model.scores, atol=1e-8)
    assert model.total_variance < 1e-4


def test_vertices_without_a_face_move_with_the_others():
    # Faces of vertex 3 become another one again.
    without = np.where((FACES == 3).any(1, keepdims=True), FACES[-1], FACES)
    model = room.fit_model(POINTS, without)
    assert model.weights[3] == 0
    back = jax.vmap(room.shape_at, (None, 0))(model, model.scores)
    aligned = room.align(POINTS, weights=model.weights).positions
    np.testing.assert_allclose(back, aligned, atol=1e-8)


@pytest.mark.slow
def test_shapes_far_away_are_centred_without_loss():
    away = MOVED + 5.6e6
    away = away - away.mean(1, keepdims=True)
    model = room.fit_model(np.float32(away), FACES)
    np.testing.assert_allclose(model.variance, fitted().variance, rtol=1e-3, atol=1e-9)


# What a model is worth


def test_compactness_sums_to_one():
    found = room.compactness(fitted())
    np.testing.assert_allclose(found.variance[-1], fitted().total_variance, rtol=1e-9)
    np.testing.assert_allclose(found.share[-1], 1, rtol=1e-9)
    assert (np.diff(found.share) >= 0).all()


def plain_model(shapes):
    """Mean, weights and modes (k, d), in numpy."""
    area = lambda x: vertex_areas(x, FACES) / surface_area(Mesh(x, FACES))
    weights = np.mean([area(shape) for shape in shapes], 0)
    aligned = plain_alignment(shapes, weights)
    rows = ((aligned - aligned.mean(0)) * np.sqrt(weights)[:, None]).reshape(
        len(shapes), -1
    )
    return aligned.mean(0), weights, np.linalg.svd(rows, full_matrices=False)[2]


def test_generality_against_numpy():
    found = room.generality(POINTS[:5], FACES)
    distances = []
    for i in range(5):
        mean, weights, modes = plain_model(np.delete(MOVED[:5], i, 0))
        left = MOVED[i] - weights @ MOVED[i]
        root = np.sqrt(weights)[:, None]
        turn = Rotation.align_vectors(mean * root, left * root)[0]
        offset = ((turn.apply(left) - mean) * root).ravel()
        for count in (1, 2, 3):
            kept = modes[:count]
            apart = (offset - kept.T @ (kept @ offset)).reshape(N, 3) / root
            distances.append(weights @ np.linalg.norm(apart, axis=1))
    distances = np.reshape(distances, (5, 3))
    np.testing.assert_array_equal(found.counts, [1, 2, 3])
    np.testing.assert_allclose(found.distance, distances.mean(0), atol=1e-8)
    np.testing.assert_allclose(found.standard_error, distances.std(0) / 2, atol=1e-8)
    area = surface_area(Mesh(MEAN, FACES))
    np.testing.assert_allclose(found.share * np.sqrt(area), found.distance, rtol=0.01)
    # Three modes made the shapes, so three describe one that was not seen.
    assert found.distance[2] < 0.1 * found.distance[0]


def test_specificity_against_numpy():
    model, key = fitted(), jax.random.key(0)
    found = room.specificity(model, POINTS, key, samples=20, counts=(0, 2, 7))
    aligned = np.asarray(room.align(POINTS, weights=model.weights).positions)
    normal = np.asarray(jax.random.normal(key, (20, 7), model.mean.dtype))
    mean, modes, variance, *_, weights, _, _ = map(np.asarray, model)
    scores = normal * np.sqrt(variance)
    distances = []
    for count in (0, 2, 7):
        drawn = mean + np.einsum("jk,kna->jna", scores[:, :count], modes[:count])
        apart = np.linalg.norm(aligned[None] - drawn[:, None], axis=3) @ weights
        distances.append(apart.min(1))
    np.testing.assert_allclose(found.distance, np.mean(distances, 1), atol=1e-9)
    error = np.std(distances, 1) / np.sqrt(20)
    np.testing.assert_allclose(found.standard_error, error, atol=1e-9)


# Files


def test_files(tmp_path):
    model = fitted()
    room.write_model(tmp_path / "model.npz", model)
    back = room.read_model(tmp_path / "model.npz")
    assert type(back) is type(model)
    for one, two in zip(back, model, strict=True):
        np.testing.assert_array_equal(one, two)

    names = [f"shape, {i}" for i in range(len(model.scores))]
    room.write_scores(tmp_path / "scores.csv", names, model)
    with open(tmp_path / "scores.csv", encoding="utf-8", newline="") as file:
        title, *rows = csv.reader(file)
    assert title[:3] == ["name", "score_1", "score_2"]
    assert [row[0] for row in rows] == names
    values = [[float(cell) for cell in row[1:]] for row in rows]
    np.testing.assert_array_equal(values, model.scores)

    written = room.write_modes(tmp_path / "modes", back, modes=1)
    assert [path.name for path in written] == [
        *("mean.ply", "mode_1_minus.ply", "mode_1_plus.ply")
    ]
    mean, minus, plus = map(read, written)
    np.testing.assert_array_equal(mean.vertices, model.mean)
    np.testing.assert_array_equal(plus.faces, model.faces)
    scores = np.zeros(len(model.modes))
    scores[0] = 3 * np.sqrt(model.variance[0])
    np.testing.assert_allclose(plus.vertices, room.shape_at(model, scores), atol=1e-9)
    assert np.abs(minus.vertices - mean.vertices).max() > 0


def test_files_that_are_no_model(tmp_path):
    path = tmp_path / "model.npz"
    with pytest.raises(ValueError, match="model.npz: No such file"):
        room.read_model(path)
    path.write_bytes(b"nonsense")
    with pytest.raises(ValueError, match="no model"):
        room.read_model(path)
    np.savez(path, T_xy=np.arange(3))
    with pytest.raises(ValueError, match="no model"):
        room.read_model(path)
    np.savez(path, kind=np.array("other"))
    with pytest.raises(ValueError, match="this version"):
        room.read_model(path)
    model = jax.tree.map(np.asarray, fitted())
    changes = {
        "modes": model.modes[:2],
        "mean": np.where(np.arange(N)[:, None] == 4, np.nan, model.mean),
        "faces": model.faces + N,
    }
    for name, value in changes.items():
        arrays = model._replace(**{name: value})._asdict()
        np.savez(path, kind=np.array("positions"), **arrays)
        with pytest.raises(ValueError, match=r"model.npz\["):
            room.read_model(path)
    with pytest.raises(ValueError, match="model.txt"):
        room.write_model(tmp_path / "model.txt", model)
    with pytest.raises(ValueError, match="1 names"):
        room.write_scores(tmp_path / "scores.csv", ["a"], model)
    with pytest.raises(ValueError, match="modes is -1"):
        room.write_modes(tmp_path, model, modes=-1)


# Bad input

HOLE = np.zeros((S, N, 1), bool)
HOLE[2, 5] = True


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: room.align(MOVED[0]), "pass .s, n, 3."),
        (lambda: room.align([MOVED[0], MOVED[1][:9]]), "same vertices"),
        (lambda: room.align(MOVED[:1]), "1 shapes"),
        (lambda: room.align(np.where(HOLE, np.nan, MOVED)), "vertex 5 of shape 2"),
        (lambda: room.align(POINTS, weights=np.ones(3)), "weights are .3,"),
        (lambda: room.align(POINTS, weights=-np.ones(N)), "none negative"),
        (lambda: room.align((MOVED[0], MOVED[1][:9])), "same vertices"),
        (
            lambda: room.fit_model(np.float32(MOVED + 1e5), FACES),
            "shape 0 has size .* lies 1e.05 from the origin, where float32",
        ),
        (
            lambda: room.fit_model(np.float32(MOVED * 1e-8), FACES),
            "areas are squared in float32",
        ),
        (
            lambda: room.generality(np.float32(MOVED * 1e12), FACES),
            "in another unit",
        ),
        (lambda: room.fit_model(POINTS, FACES, modes=S), "modes is 8"),
        (lambda: room.fit_model(POINTS, FACES, modes=0), "modes is 0"),
        (lambda: room.shape_at(fitted(), jnp.zeros(9)), "scores are"),
        (lambda: room.scores_of(fitted(), MOVED[0, :5]), "positions are"),
        (lambda: room.generality(MOVED[:2], FACES), "2 shapes"),
        (lambda: room.generality(POINTS, FACES, counts=(7,)), "counts is"),
        (lambda: specificity(POINTS, counts=(8,)), "counts is"),
        (lambda: specificity(POINTS, samples=0), "samples is 0"),
        (lambda: specificity(MOVED[:, :9]), "shapes are"),
    ],
)
def test_bad_arguments(call, words):
    with pytest.raises(ValueError, match=words):
        call()


def specificity(positions, **options):
    return room.specificity(fitted(), positions, jax.random.key(0), **options)


@pytest.mark.parametrize("faces", [FACES[:, :2], FACES.astype(float), FACES + 1])
def test_bad_faces(faces):
    with pytest.raises(MeshError):
        room.fit_model(POINTS, faces)

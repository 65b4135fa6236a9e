"""Shape models: against numpy and scipy, laws, and shapes made of known modes."""

import csv
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.spatial
from jax.test_util import check_grads
from scipy.spatial.transform import Rotation

from jfsf import model as room
from jfsf import testing
from jfsf.mesh import MeshError, edges, read, surface_area, vertex_areas
from jfsf.model import _rotations as rotations
from jfsf.types import Mesh

RNG = np.random.default_rng(0)
MEAN, FACES = testing.blob(0)
N, S = len(MEAN), 8
SDS = np.array([0.2, 0.1, 0.05])
# Smooth fields without translation and turn: what alignment takes away is not variance.
WEIGHTS = vertex_areas(MEAN, FACES) / surface_area(Mesh(MEAN, FACES))


def orthonormal(fields):
    """Fields (k, n, 3), in order, made orthonormal under the weights."""
    flat = (fields * np.sqrt(WEIGHTS)[:, None]).reshape(len(fields), -1)
    q = np.linalg.qr(flat.T)[0].T
    return q.reshape(fields.shape) / np.sqrt(WEIGHTS)[:, None]


def rigid_fields():
    """Three shifts and three turns of the mean shape."""
    axes = np.eye(3)
    centred = MEAN - WEIGHTS @ MEAN
    return np.array(
        [np.tile(e, (N, 1)) for e in axes] + [np.cross(e, centred) for e in axes]
    )


MODES = orthonormal(
    np.concatenate([rigid_fields(), np.sin(MEAN[None] @ RNG.normal(size=(3, 3, 3)))])
)[6:]


def centred_scores():
    """(S, 3) with mean 0, no correlation, and the standard deviations SDS."""
    scores = RNG.normal(size=(S, 3))
    q = np.linalg.qr(scores - scores.mean(0))[0]
    return q * np.sqrt(S - 1) * SDS


SCORES = centred_scores()
SHAPES = MEAN + np.einsum("sk,kna->sna", 0.02 * SCORES, MODES)
MOTIONS = Rotation.random(S, rng=1).as_matrix(), RNG.normal(size=(S, 1, 3))
MOVED = np.einsum("sab,snb->sna", MOTIONS[0], SHAPES) + MOTIONS[1]


@cache
def fitted():
    return room.fit_model(jnp.asarray(MOVED), FACES)


@cache
def bar(angle):
    """A tube along x whose middle is bent by an angle, to both sides alike."""
    x = np.linspace(-4, 4, 33)
    turn = angle * np.clip((x + 1.5) / 3, 0, 1)
    fine = np.linspace(-4, 4, 3201)
    bent = angle * np.clip((fine + 1.5) / 3, 0, 1)
    step = fine[1] - fine[0]
    path = np.cumsum(np.stack([np.cos(bent), np.sin(bent)], 1), 0)[::100] * step
    around = np.linspace(0, 2 * np.pi, 6, endpoint=False)
    across = 0.3 * np.cos(around)
    points = np.stack(
        [
            path[:, :1] - np.sin(turn)[:, None] * across,
            path[:, 1:] + np.cos(turn)[:, None] * across,
            np.broadcast_to(0.3 * np.sin(around), (33, 6)),
        ],
        2,
    ).reshape(-1, 3)
    i, j = np.divmod(np.arange(32 * 6), 6)
    a, b = 6 * i + j, 6 * i + (j + 1) % 6
    sides = np.concatenate([np.stack([a, b, a + 6], 1), np.stack([b, b + 6, a + 6], 1)])
    ends = [[first, first + k + 1, first + k] for first in (0,) for k in range(1, 5)]
    ends += [[192, 192 + k, 192 + k + 1] for k in range(1, 5)]
    return Mesh(points, np.concatenate([sides, np.array(ends)]).astype(np.int32))


def lengths(points, faces):
    ends = edges(faces).ends
    return np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1)


# Rotations


def test_rotations_are_those_of_scipy():
    angles = np.array([0, 1e-9, 0.1, 2, np.pi - 1e-6, np.pi])
    axes = RNG.normal(size=(len(angles), 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    vectors = angles[:, None] * axes
    found = jax.jit(rotations.rotations_of)(jnp.asarray(vectors))
    np.testing.assert_allclose(
        found, Rotation.from_rotvec(vectors).as_matrix(), atol=1e-12
    )
    back = jax.jit(rotations.rotation_vectors)(found)
    np.testing.assert_allclose(back[:-1], vectors[:-1], atol=1e-8)
    np.testing.assert_allclose(np.abs(back[-1]), np.abs(vectors[-1]), atol=1e-8)


def test_the_nearest_rotation_is_that_of_scipy_and_never_mirrors():
    source, target = RNG.normal(size=(2, 30, 3))
    for sign in (1, -1):
        target = target * [sign, 1, 1]
        truth = Rotation.align_vectors(target, source)[0].as_matrix()
        found = rotations.nearest_rotation(jnp.asarray(target.T @ source))
        np.testing.assert_allclose(found, truth, atol=1e-8)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_slopes_of_the_nearest_rotation(sign):
    matrix = jnp.asarray(RNG.normal(size=(3, 3))) * jnp.array([[sign, 1, 1]])
    loss = lambda m: jnp.sum(jnp.sin(rotations.nearest_rotation(m)))
    check_grads(loss, (matrix,), 1)
    # Equal singular values: the derivative of the SVD is infinite, this one is not.
    assert jnp.isfinite(jax.grad(loss)(jnp.eye(3))).all()


# Alignment


def test_two_shapes_are_aligned_as_scipy_does():
    one, two = MOVED[:2]
    found = room.align(jnp.asarray(MOVED[:2]), scale=True)
    plain, moved, disparity = scipy.spatial.procrustes(one, two)
    aligned = np.asarray(found.positions)
    unit = aligned - aligned.mean(1, keepdims=True)
    unit /= np.linalg.norm(unit, axis=(1, 2), keepdims=True)
    # scipy also shrinks the second by the cosine between both.
    cosine = np.sqrt(1 - disparity)
    np.testing.assert_allclose(np.sum(unit[0] * unit[1]), cosine, atol=1e-9)
    np.testing.assert_allclose(unit[0], plain, atol=1e-9)
    np.testing.assert_allclose(unit[1] * cosine, moved, atol=1e-9)


def plain_alignment(shapes, weights):
    """Generalised Procrustes analysis in numpy, from the first shape."""
    share = weights / weights.sum()
    offsets = shapes - np.einsum("n,sna->sa", share, shapes)[:, None]
    mean = offsets[0]
    for _ in range(100):
        turned = []
        for shape in offsets:
            u, _, vt = np.linalg.svd(mean.T @ (share[:, None] * shape))
            u[:, 2] *= np.linalg.det(u @ vt)
            turned.append(shape @ (u @ vt).T)
        mean = np.mean(turned, 0)
    return np.array(turned)


@pytest.mark.parametrize("dtype, atol", [(jnp.float64, 1e-9), (jnp.float32, 1e-4)])
def test_alignment_against_numpy(dtype, atol):
    found = room.align(jnp.asarray(MOVED, dtype), weights=jnp.asarray(WEIGHTS, dtype))
    assert found.positions.dtype == found.mean.dtype == dtype
    truth = plain_alignment(MOVED, WEIGHTS)
    # Distances know nothing of the pose of all.
    apart = lambda p: np.linalg.norm(p[1:] - p[:1], axis=2)
    np.testing.assert_allclose(
        apart(np.asarray(found.positions)), apart(truth), atol=atol
    )
    np.testing.assert_allclose(found.positions[0], MOVED[0], atol=atol)
    moved = (
        np.einsum("sab,snb->sna", found.rotation, MOVED) + found.translation[:, None]
    )
    np.testing.assert_allclose(found.positions, moved, atol=10 * atol)


@pytest.mark.parametrize("scale", [False, True])
def test_laws_of_alignment(scale):
    shapes = MOVED * np.linspace(0.5, 2, S)[:, None, None] if scale else MOVED
    weights = jnp.asarray(WEIGHTS)
    known = room.align(jnp.asarray(shapes), scale=scale, weights=weights)
    # Other motions of all but the first change nothing.
    again = np.concatenate([shapes[:1], shapes[1:] @ MOTIONS[0][0] + 5])
    moved = room.align(jnp.asarray(again), scale=scale, weights=weights)
    np.testing.assert_allclose(moved.positions, known.positions, atol=1e-9)
    np.testing.assert_allclose(moved.scale, known.scale, atol=1e-9)
    # Another order turns all together.
    order = np.roll(np.arange(S), 3)
    turned = room.align(jnp.asarray(shapes[order]), scale=scale, weights=weights)
    both = jnp.stack(
        [turned.positions.reshape(-1, 3), known.positions[order].reshape(-1, 3)]
    )
    np.testing.assert_allclose(turned.scale, known.scale[order], atol=1e-9)
    onto = room.align_onto(both[1], both[0], jnp.ones(S * N))
    np.testing.assert_allclose(onto, both[1], atol=1e-8)
    # Other names of the vertices are the vertices' only.
    names = RNG.permutation(N)
    renamed = room.align(
        jnp.asarray(shapes[:, names]), scale=scale, weights=weights[names]
    )
    np.testing.assert_allclose(renamed.positions, known.positions[:, names], atol=1e-9)
    np.testing.assert_allclose(jnp.prod(known.scale), 1.0, atol=1e-9)
    if scale:
        np.testing.assert_allclose(
            known.scale, known.scale[0] * 0.5 / np.linspace(0.5, 2, S), rtol=0.1
        )


def test_missing_vertices_are_not_read():
    shapes = np.repeat(MEAN[None], 4, 0) * np.array([1, 2, 0.5, 1])[:, None, None]
    shapes = np.einsum("sab,snb->sna", MOTIONS[0][:4], shapes) + MOTIONS[1][:4]
    missing = RNG.random((4, N)) < 0.3
    missing[:, ~missing.any(0)] = False
    missing[0, missing.all(0)] = False
    damaged = np.where(missing[..., None], np.nan, shapes)
    found = room.align(jnp.asarray(damaged), scale=True, missing=missing)
    np.testing.assert_allclose(found.scale, found.scale[0] / [1, 2, 0.5, 1], rtol=1e-9)
    for positions in found.positions:
        np.testing.assert_allclose(positions, found.mean, atol=1e-9)
    complete = room.align(jnp.asarray(shapes), scale=True)
    np.testing.assert_allclose(found.mean, complete.mean, atol=1e-8)


def test_slopes_of_alignment():
    shapes, to = jnp.asarray(MOVED[:3, :20]), jnp.asarray(RNG.normal(size=(20, 3)))
    loss = lambda shapes: jnp.sum((room.align(shapes).mean - to) ** 2)
    check_grads(loss, (shapes,), 1, ["rev"], atol=1e-4, rtol=1e-4)


# Models of positions


def test_known_modes_are_recovered():
    model = fitted()
    # In the pose of the first shape, as the mean is.
    pose = MOTIONS[0][0]
    sds = 0.02 * SDS
    np.testing.assert_allclose(np.sqrt(model.variance[:3]), sds, rtol=1e-2)
    share = model.variance[:3].sum() / model.total_variance
    assert share > 0.999
    turned = np.einsum("kna,ba->knb", MODES, pose)
    overlap = np.einsum("n,kna,lna->kl", model.weights, model.modes[:3], turned)
    np.testing.assert_allclose(np.abs(overlap), np.eye(3), atol=0.03)
    onto = room.align_onto(jnp.asarray(MEAN), model.mean, model.weights)
    np.testing.assert_allclose(onto, MEAN, atol=1e-3)


@pytest.mark.parametrize("dtype, atol", [(jnp.float64, 1e-9), (jnp.float32, 1e-5)])
def test_components_against_numpy(dtype, atol):
    shapes, weights = jnp.asarray(MOVED, dtype), jnp.asarray(WEIGHTS, dtype)
    model = room.fit_model(shapes, FACES, weights=weights, modes=3)
    assert all(a.dtype == dtype for a in model if a is not model.faces)
    aligned = np.asarray(room.align(shapes, weights=weights).positions, float)
    rows = ((aligned - aligned.mean(0)) * np.sqrt(WEIGHTS)[:, None]).reshape(S, -1)
    u, sizes, vt = np.linalg.svd(rows, full_matrices=False)
    np.testing.assert_allclose(model.variance, sizes[:3] ** 2 / (S - 1), atol=atol)
    np.testing.assert_allclose(
        model.total_variance, (sizes**2).sum() / (S - 1), atol=atol
    )
    np.testing.assert_allclose(
        np.abs(model.scores), np.abs(u * sizes)[:, :3], atol=10 * atol
    )
    gram = np.einsum("n,kna,lna->kl", WEIGHTS, model.modes, model.modes)
    np.testing.assert_allclose(gram, np.eye(3), atol=1e-5)
    largest = np.abs(model.modes).reshape(3, -1).argmax(1)
    assert (np.asarray(model.modes).reshape(3, -1)[range(3), largest] > 0).all()


def test_shapes_and_scores_are_inverse():
    model = fitted()
    found = jax.vmap(room.scores_of, (None, 0))(model, jnp.asarray(MOVED))
    np.testing.assert_allclose(found, model.scores, atol=1e-8)
    back = jax.vmap(room.shape_at, (None, 0))(model, model.scores)
    aligned = room.align(jnp.asarray(MOVED), weights=model.weights).positions
    np.testing.assert_allclose(back, aligned, atol=1e-8)
    for i, scores in enumerate(model.scores[:2]):
        np.testing.assert_allclose(room.shape_at(model, scores), back[i], atol=1e-12)
    # The first scores alone, and none at all.
    np.testing.assert_array_equal(room.shape_at(model, jnp.zeros(0)), model.mean)
    loss = lambda scores: jnp.sum(room.shape_at(model, scores) ** 2)
    check_grads(loss, (model.scores[0],), 1)
    through = lambda x: jnp.sum(jnp.sin(room.scores_of(model, x)))
    check_grads(through, (jnp.asarray(MOVED[1]),), 1, ["rev"], rtol=1e-4)


def test_a_scaled_model_scales_what_it_is_given():
    shapes = jnp.asarray(MOVED * np.linspace(0.5, 2, S)[:, None, None])
    model = room.fit_model(shapes, FACES, scale=True)
    found = jax.vmap(room.scores_of, (None, 0))(model, 3 * shapes)
    np.testing.assert_allclose(found, model.scores, atol=1e-8)
    assert model.total_variance < 1e-2


def test_vertices_without_a_face_move_with_the_others():
    more = np.concatenate([MOVED, MOVED[:, :1]], 1)
    model = room.fit_model(jnp.asarray(more), FACES)
    np.testing.assert_allclose(model.modes[:3, N], model.modes[:3, 0], atol=1e-6)
    np.testing.assert_allclose(model.mean[N], model.mean[0], atol=1e-9)


@pytest.mark.parametrize("sizes", [(8,), (1, 4, 3)])
def test_batches_give_the_model_of_all(sizes):
    known = fitted()
    aligned = room.align(jnp.asarray(MOVED), weights=known.weights).positions
    batches = np.split(np.asarray(aligned), np.cumsum(sizes)[:-1])
    found = room.fit_model_in_batches(iter(batches), FACES, weights=known.weights)
    for name in known._fields:
        # Modes of a variance of 0 but for rounding are any.
        np.testing.assert_allclose(
            getattr(found, name), getattr(known, name), atol=1e-6, err_msg=name
        )
    few = room.fit_model_in_batches(
        iter(batches), FACES, modes=2, weights=known.weights
    )
    np.testing.assert_allclose(few.variance, known.variance[:2], rtol=1e-3)
    np.testing.assert_allclose(few.total_variance, known.total_variance, rtol=1e-9)


# Models of gradients


def test_gradients_there_and_back():
    rest, moved = bar(0.0), bar(1.0)
    points = [jnp.asarray(mesh.vertices) for mesh in (rest, moved)]
    features = room.gradients_of(*points, rest.faces)
    assert features.shape == (len(rest.faces), 9)
    back = room.from_gradients(points[0], features, rest.faces)
    shift = (points[0] - points[1]).mean(0)
    np.testing.assert_allclose(back, points[1] + shift, atol=1e-6)
    # A turn of the whole is the same in all faces, and stretches nothing.
    turn = Rotation.from_rotvec([0.1, 0.2, 0.3]).as_matrix()
    turned = room.gradients_of(points[0], points[0] @ turn.T, rest.faces)
    truth = np.sqrt(2) * np.array([0.1, 0.2, 0.3])
    np.testing.assert_allclose(
        turned[:, :3], np.tile(truth, (len(turned), 1)), atol=1e-8
    )
    np.testing.assert_allclose(turned[:, 3:], 0, atol=1e-8)
    # Twice as large: the stretch is 2, also across.
    grown = room.gradients_of(points[0], 2 * points[0], rest.faces)
    np.testing.assert_allclose(grown[:, 3:6], 1, atol=1e-8)
    single = [p.astype(jnp.float32) for p in points]
    again = room.from_gradients(
        single[0], room.gradients_of(*single, rest.faces), rest.faces
    )
    np.testing.assert_allclose(again, back, atol=1e-2)


def test_half_way_between_two_poses_lengths_stay():
    (straight, faces), (bent, _) = bar(0.0), bar(2.0)
    poses = jnp.stack([jnp.asarray(straight), jnp.asarray(bent)])
    truth = (lengths(straight, faces) + lengths(bent, faces)) / 2
    by_gradients = room.fit_gradient_model(poses, faces)
    by_positions = room.fit_model(poses, faces)
    for model, most in ((by_gradients, 0.02), (by_positions, np.inf)):
        half_way = room.shape_at(model, jnp.zeros(1))
        np.testing.assert_allclose(half_way, model.mean, atol=1e-6)
        worst = np.abs(lengths(np.asarray(half_way), faces) / truth - 1).max()
        assert worst < most
    assert worst > 0.2
    ends = jax.vmap(room.shape_at, (None, 0))(by_gradients, by_gradients.scores)
    for end, pose in zip(ends, (straight, bent), strict=True):
        np.testing.assert_allclose(
            lengths(np.asarray(end), faces), lengths(pose, faces), rtol=1e-4
        )
    again = jax.vmap(room.scores_of, (None, 0))(by_gradients, poses)
    np.testing.assert_allclose(again, by_gradients.scores, atol=1e-6)
    loss = lambda scores: jnp.sum(room.shape_at(by_gradients, scores) ** 2)
    slope = jax.grad(loss)(jnp.array([0.1]))
    near = (loss(jnp.array([0.1 + 1e-4])) - loss(jnp.array([0.1 - 1e-4]))) / 2e-4
    np.testing.assert_allclose(slope[0], near, rtol=1e-3)


def test_shapes_that_bend_are_named():
    faces = bar(0.0).faces
    poses = np.stack([bar(angle).vertices for angle in (0.0, 1.0, 2.0)])
    angles = room.local_rotation(jnp.asarray(poses), faces)
    assert angles.min() == 0 < angles.max() < 1
    text = room.bending_warning(jnp.asarray(poses), faces, most_turn=0.1)
    assert text is not None and "bend" in text and "gradient" in text
    assert room.bending_warning(jnp.asarray(MOVED), FACES) is None


# What a model is worth


def test_compactness_sums_to_one():
    found = room.compactness(fitted())
    np.testing.assert_allclose(found.variance[-1], fitted().total_variance, rtol=1e-9)
    np.testing.assert_allclose(found.share[-1], 1, rtol=1e-9)
    assert (np.diff(found.share) >= 0).all()


def test_generality_against_a_loop():
    found = room.generality(jnp.asarray(MOVED[:5]), FACES)
    rows = []
    for i in range(5):
        others = np.delete(MOVED[:5], i, 0)
        model = room.fit_model(jnp.asarray(others), FACES)
        left = room.moved_onto(model, jnp.asarray(MOVED[i]))
        scores = room.scores_of(model, left)
        near = [room.shape_at(model, scores[:m]) for m in (1, 2, 3)]
        rows.append(
            [model.weights @ np.linalg.norm(shape - left, axis=1) for shape in near]
        )
    rows = np.array(rows)
    np.testing.assert_array_equal(found.counts, [1, 2, 3])
    np.testing.assert_allclose(found.distance, rows.mean(0), atol=1e-8)
    np.testing.assert_allclose(found.standard_error, rows.std(0) / 2, atol=1e-8)
    area = surface_area(Mesh(MEAN, FACES))
    np.testing.assert_allclose(found.share, rows.mean(0) / np.sqrt(area), rtol=1e-2)
    # Three modes made the shapes, so three describe one that was not seen.
    assert found.distance[2] < 0.1 * found.distance[0]


def test_specificity_against_numpy():
    model, key = fitted(), jax.random.key(0)
    found = room.specificity(
        model, jnp.asarray(MOVED), key, samples=20, counts=(0, 2, 7)
    )
    aligned = np.asarray(
        room.align(jnp.asarray(MOVED), weights=model.weights).positions
    )
    scores = np.asarray(jax.random.normal(key, (20, 7))) * np.sqrt(model.variance)
    for count, distance in zip(found.counts, found.distance, strict=True):
        near = []
        for row in scores:
            drawn = np.asarray(model.mean) + np.einsum(
                "k,kna->na", row[:count], model.modes[:count]
            )
            apart = np.linalg.norm(aligned - drawn, axis=2) @ np.asarray(model.weights)
            near.append(apart.min())
        np.testing.assert_allclose(distance, np.mean(near), atol=1e-9)


def test_models_of_gradients_are_measured_too():
    faces = bar(0.0).faces
    poses = jnp.stack([jnp.asarray(bar(a).vertices) for a in (0.0, 0.6, 1.3, 2.0)])
    by = {fit: room.generality(poses, faces, fit=fit, counts=(1,)) for fit in FITS}
    gradients, positions = (by[fit].distance[0] for fit in FITS)
    assert gradients < 0.3 * positions
    model = room.fit_gradient_model(poses, faces)
    found = room.specificity(model, poses, jax.random.key(0), samples=5, counts=(1,))
    assert 0 < found.distance[0] < 1


FITS = room.fit_gradient_model, room.fit_model


# Files


@pytest.mark.parametrize("fit", FITS)
def test_files(fit, tmp_path):
    model = fit(jnp.asarray(MOVED), FACES, modes=2)
    room.write_model(tmp_path / "model.npz", model)
    back = room.read_model(tmp_path / "model.npz")
    assert type(back) is type(model)
    for one, two in zip(back, model, strict=True):
        np.testing.assert_array_equal(one, two)
    shape = room.shape_at(back, back.scores[0])
    np.testing.assert_allclose(shape, room.shape_at(model, model.scores[0]), atol=1e-9)

    names = [f"shape, {i}" for i in range(S)]
    room.write_scores(tmp_path / "scores.csv", names, model)
    with open(tmp_path / "scores.csv", newline="") as file:
        title, *rows = csv.reader(file)
    assert title == ["name", "score_1", "score_2"]
    assert [row[0] for row in rows] == names
    np.testing.assert_array_equal(
        [[*map(float, row[1:])] for row in rows], model.scores
    )

    written = room.write_modes(tmp_path / "modes", model, modes=1)
    assert [path.name for path in written] == [
        *("mean.ply", "mode_1_minus.ply", "mode_1_plus.ply")
    ]
    mean, minus, plus = map(read, written)
    np.testing.assert_array_equal(mean.vertices, model.mean)
    np.testing.assert_array_equal(plus.faces, FACES)
    scores = jnp.array([3 * jnp.sqrt(model.variance[0])])
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
    for name, value in {
        "modes": fitted().modes[:2],
        "mean": fitted().mean.at[0].set(jnp.nan),
        "faces": fitted().faces + N,
    }.items():
        np.savez(
            path,
            kind=np.array("positions"),
            **fitted()._replace(**{name: value})._asdict(),
        )
        with pytest.raises(ValueError, match=r"model.npz\["):
            room.read_model(path)
    with pytest.raises(ValueError, match="model.txt"):
        room.write_model(tmp_path / "model.txt", fitted())
    with pytest.raises(ValueError, match="1 names"):
        room.write_scores(tmp_path / "scores.csv", ["a"], fitted())
    with pytest.raises(ValueError, match="modes is -1"):
        room.write_modes(tmp_path, fitted(), modes=-1)


# Bad input

POINTS = jnp.asarray(MOVED)
MISSED = np.zeros((S, N), bool)
MISSED[:, 3] = True


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: room.align(POINTS[0]), "pass .s, n, 3."),
        (lambda: room.align([MOVED[0], MOVED[1][:9]]), "same vertices"),
        (lambda: room.align(POINTS[:1]), "1 shapes"),
        (lambda: room.align(POINTS.at[2, 5].set(jnp.nan)), "vertex 5 of shape 2"),
        (lambda: room.align(POINTS, weights=np.ones(3)), "weights are .3,"),
        (lambda: room.align(POINTS, weights=-np.ones(N)), "none negative"),
        (lambda: room.align(POINTS, missing=MISSED[:2]), "missing is"),
        (lambda: room.fit_model(POINTS, FACES, missing=MISSED), "miss vertex 3"),
        (lambda: room.fit_model(POINTS, FACES, modes=S), "modes is 8"),
        (lambda: room.fit_gradient_model(POINTS, FACES, modes=0), "modes is 0"),
        (lambda: room.fit_model_in_batches([], FACES), "0 shapes"),
        (lambda: room.fit_model_in_batches([POINTS[:1]], FACES), "1 shape,"),
        (
            lambda: room.fit_model_in_batches([POINTS, POINTS[:, :9]], FACES),
            "those before",
        ),
        (lambda: room.fit_model_in_batches([POINTS], FACES, modes=0), "modes is 0"),
        (lambda: room.fit_model_in_batches([POINTS], FACES[:3]), "weight 0"),
        (lambda: room.shape_at(fitted(), jnp.zeros(9)), "scores are"),
        (lambda: room.scores_of(fitted(), POINTS[0, :5]), "positions are"),
        (lambda: room.generality(POINTS[:2], FACES), "2 shapes"),
        (lambda: room.generality(POINTS, FACES, counts=(7,)), "counts is"),
        (lambda: specificity(POINTS, counts=(8,)), "counts is"),
        (lambda: specificity(POINTS, samples=0), "samples is 0"),
        (lambda: specificity(POINTS[:, :9]), "shapes are"),
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

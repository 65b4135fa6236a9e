"""Brackets against n . (grad f x grad g), and a score that recognises a mirror."""

import jax
import jax.numpy as jnp
import jax.test_util
import numpy as np
import oracles
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapes import bumpy

import jfsf.data
from jfsf.spectral import functional_map, spectrum
from jfsf.spectral._orientation import (
    COLUMN_WEIGHT,
    FUNCTIONS,
    PULLED_BACK,
    bracket_fields,
    brackets,
    carried_fields,
    orientation_score,
)
from jfsf.testing import cast, mirror

seeds = st.integers(0, 10**6)


def spec_of(mesh, k=30):
    return cast(spectrum(mesh, k, cache=False))


SPEC = spec_of(bumpy())
# A map whose score is far from 0 and 1, so that it can change.
ANY = jnp.eye(FUNCTIONS) + 0.1 * jnp.asarray(
    np.random.default_rng(0).normal(size=(20, 20))
)


def block_rotation(seed, *ends):
    """Orthogonal, the blocks up to each of `ends` turned within themselves."""
    rng, out = np.random.default_rng(seed), np.zeros((ends[-1], ends[-1]))
    for low, high in zip((0, *ends), ends, strict=False):
        turn = np.linalg.qr(rng.normal(size=(high - low, high - low)))[0]
        out[low:high, low:high] = turn
    return jnp.asarray(out)


@given(seed=seeds)
def test_brackets_match_gradients_face_by_face(seed):
    mesh = bumpy(seed)
    functions = np.random.default_rng(seed).normal(size=(162, 3))
    spec = SPEC._replace(evecs=jnp.asarray(functions), faces=jnp.asarray(mesh.faces))
    ours = brackets(spec, k=3)
    assert np.allclose(ours, oracles.brackets(*mesh, functions))
    assert jnp.allclose(ours, -ours.transpose(0, 2, 1))
    # On a closed surface no function flows in or out.
    assert np.allclose(ours, ours.transpose(1, 2, 0))


def test_the_constant_has_no_gradient():
    assert jnp.abs(brackets(SPEC, k=10)[:, 0]).max() < 1e-12


def test_flipping_the_faces_flips_the_sign():
    flipped = SPEC._replace(faces=SPEC.faces[:, ::-1])
    assert jnp.allclose(brackets(flipped, k=10), -brackets(SPEC, k=10))


def test_padding_is_invisible():
    padded = SPEC._replace(
        evecs=jnp.pad(SPEC.evecs, ((0, 3), (0, 0))),
        mass=jnp.pad(SPEC.mass, (0, 3)),
        faces=jnp.pad(SPEC.faces, ((0, 5), (0, 0))),
    )
    assert jnp.allclose(brackets(padded, k=10), brackets(SPEC, k=10))


@given(seed=seeds)
def test_relabelling_changes_nothing(seed):
    order = np.random.default_rng(seed).permutation(162)
    faces = jnp.asarray(np.argsort(order)[np.roll(SPEC.faces, 1, 1)], jnp.int32)
    other = SPEC._replace(evecs=SPEC.evecs[order], faces=faces)
    assert jnp.allclose(brackets(other, k=10), brackets(SPEC, k=10))


def test_the_identity_scores_one():
    tensor = brackets(SPEC, k=FUNCTIONS)
    assert np.isclose(orientation_score(jnp.eye(FUNCTIONS), tensor, tensor), 1)


@given(seed=seeds)
def test_a_mirrored_copy_scores_minus_one(seed):
    mesh = bumpy(seed)
    x, y = spec_of(mesh), spec_of(mirror(mesh))
    C_yx = functional_map(jnp.arange(162), x, y)
    tensors = brackets(x, k=FUNCTIONS), brackets(y, k=FUNCTIONS)
    assert np.isclose(orientation_score(C_yx, *tensors), -1, atol=1e-6)
    # Faces that were not wound outward again hide the mirror.
    wrong = y._replace(faces=y.faces[:, ::-1])
    assert orientation_score(C_yx, tensors[0], brackets(wrong, k=FUNCTIONS)) > 0.99


def test_real_shapes_and_their_mirrors():
    x, y = jfsf.data.load("man_walk"), jfsf.data.load("woman_up")
    spec_x = spec_of(x.mesh)
    # Nearest template point: a true map between meshes of different size.
    back = np.zeros(len(x.mesh.vertices), np.int64)
    back[x.template_to_vertex] = np.arange(len(x.template_to_vertex))
    T_xy = y.template_to_vertex[back]
    known = np.isin(np.arange(len(back)), x.template_to_vertex)
    sample = cast(spectrum(x.mesh, 30, cache=False))
    weight = sample.mass * jnp.asarray(known, float)
    sample = sample._replace(mass=weight / weight.sum())
    for mesh, sign in ((y.mesh, 1), (mirror(y.mesh), -1)):
        spec_y = spec_of(mesh)
        C_yx = functional_map(jnp.asarray(T_xy), sample, spec_y)
        value = orientation_score(
            C_yx, brackets(spec_x, k=FUNCTIONS), brackets(spec_y, k=FUNCTIONS)
        )
        assert sign * value > 0.8


@given(seed=seeds)
def test_signs_and_turns_of_eigenvectors_change_nothing(seed):
    turn_x = block_rotation(seed, FUNCTIONS)
    turn_y = block_rotation(seed + 1, 1, PULLED_BACK + 1, FUNCTIONS)
    other = brackets(spec_of(bumpy(1)), k=FUNCTIONS)

    def turned(tensor, turn):
        return jnp.einsum("cab,ci,aj,bk->ijk", tensor, turn, turn, turn)

    tensor = brackets(SPEC, k=FUNCTIONS)
    value = orientation_score(ANY, tensor, other)
    assert 0.05 < abs(value) < 0.95
    C_yx = turn_x.T @ ANY @ turn_y
    assert np.isclose(
        orientation_score(C_yx, turned(tensor, turn_x), turned(other, turn_y)), value
    )


def test_a_cloud_has_no_score():
    cloud = SPEC._replace(faces=jnp.zeros((0, 3), jnp.int32))
    tensor = brackets(cloud, k=FUNCTIONS)
    assert tensor.shape == (FUNCTIONS,) * 3 and not tensor.any()
    assert jnp.isnan(
        orientation_score(jnp.eye(FUNCTIONS), tensor, brackets(SPEC, k=FUNCTIONS))
    )
    assert jnp.isnan(orientation_score(jnp.eye(FUNCTIONS), tensor, tensor))


@pytest.mark.parametrize("shape", [(30, 20), (7, 12), (5, 5), (3, 30)])
def test_any_size_of_map(shape):
    tensor = brackets(SPEC, k=FUNCTIONS)
    assert np.isclose(
        orientation_score(jnp.eye(*shape), tensor, tensor[:15, :15, :15]), 1
    )


def test_vmap_equals_the_loop():
    specs = [spec_of(bumpy(seed)) for seed in (1, 2)]
    stacked = jax.tree.map(lambda *a: jnp.stack(a), *specs)
    tensors = jax.vmap(lambda s: brackets(s, k=FUNCTIONS))(stacked)
    own = brackets(SPEC, k=FUNCTIONS)
    values = jax.vmap(orientation_score, (None, 0, None))(ANY, tensors, own)
    for i, spec in enumerate(specs):
        assert jnp.allclose(tensors[i], brackets(spec, k=FUNCTIONS))
        assert np.isclose(
            values[i], orientation_score(ANY, brackets(spec, k=FUNCTIONS), own)
        )


def test_the_gradient_is_right():
    tensors = brackets(SPEC, k=FUNCTIONS), brackets(spec_of(bumpy(1)), k=FUNCTIONS)
    step = jnp.asarray(np.random.default_rng(0).normal(size=ANY.shape))
    slope = jnp.sum(jax.grad(orientation_score)(ANY, *tensors) * step)
    h = 1e-6
    gap = orientation_score(ANY + h * step, *tensors) - orientation_score(
        ANY - h * step, *tensors
    )
    assert np.isclose(gap / (2 * h), slope, rtol=1e-5)


def test_float32():
    tensor, exact = (
        brackets(cast(SPEC, jnp.float32), k=FUNCTIONS),
        brackets(SPEC, k=FUNCTIONS),
    )
    assert tensor.dtype == jnp.float32
    assert np.allclose(tensor, exact, atol=1e-5 * float(jnp.abs(exact).max()))
    value = orientation_score(ANY.astype(jnp.float32), tensor, tensor)
    assert value.dtype == jnp.float32
    assert np.isclose(value, orientation_score(ANY, exact, exact), atol=1e-5)


@pytest.mark.parametrize("k", [0, 31])
def test_too_few_eigenpairs_are_an_error(k):
    with pytest.raises(ValueError, match=f"k is {k}, there are 30 eigenpairs"):
        brackets(SPEC, k=k)


def test_fields_are_brackets_at_the_vertices():
    fields = bracket_fields(SPEC)
    assert fields.shape == (162, FUNCTIONS, FUNCTIONS)
    back = jnp.einsum("nc,n,nab->cab", SPEC.evecs[:, :FUNCTIONS], SPEC.mass, fields)
    np.testing.assert_allclose(back, brackets(SPEC, k=FUNCTIONS), atol=1e-10)


def carried(C_yx, field_x, field_y, spec_y, size=FUNCTIONS):
    return carried_fields(C_yx, field_x, field_y, spec_y.mass, size)


def test_carried_fields_agree_under_the_true_map_and_tell_a_mirror():
    fields = bracket_fields(SPEC)
    on_x, on_y = carried(jnp.eye(FUNCTIONS), fields, fields, SPEC)
    np.testing.assert_allclose(on_x, on_y, atol=1e-12)
    assert on_y.shape[1] == PULLED_BACK * (PULLED_BACK - 1) // 2
    np.testing.assert_allclose(SPEC.mass @ on_y**2, COLUMN_WEIGHT**2)
    # The mirror image has other eigenfunctions' signs, and C_yx goes with them.
    other = spec_of(mirror(bumpy()))
    C_yx = functional_map(jnp.arange(162), SPEC, other)[:FUNCTIONS, :FUNCTIONS]
    on_x, on_y = carried(C_yx, fields, bracket_fields(other), other)
    np.testing.assert_allclose(on_x, -on_y, atol=1e-3)


def test_functions_beyond_the_map_carry_nothing():
    fields = bracket_fields(SPEC)
    C_yx = jnp.eye(FUNCTIONS).at[4:].set(0)
    on_x, on_y = carried(C_yx, fields, fields, SPEC, size=4)
    first = carried(jnp.eye(4), fields, fields, SPEC, size=4)
    for found, few in ((on_x, first[0]), (on_y, first[1])):
        kept = np.flatnonzero(jnp.abs(found).max(0))
        assert len(kept) == few.shape[1] == 3
        np.testing.assert_allclose(found[:, kept], few, atol=1e-12)


def test_a_cloud_carries_nothing():
    fields = bracket_fields(SPEC._replace(faces=SPEC.faces[:0]))
    for columns in carried(jnp.eye(FUNCTIONS), fields, fields, SPEC):
        assert not columns.any()


def test_carried_fields_have_slopes():
    fields = bracket_fields(SPEC)
    total = lambda C: sum(jnp.sum(c**3) for c in carried(C, fields, fields, SPEC))
    jax.test_util.check_grads(total, (ANY,), 1, modes=("rev",), rtol=1e-4)

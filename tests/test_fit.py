"""The functional map fit against dense least squares, and its invariances."""

import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import oracles
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import bumpy

import jfsf.data
from jfsf import initial
from jfsf.initial import Weights
from jfsf.initial._linear import solve
from jfsf.initial._terms import combine, shape_terms, terms
from jfsf.spectral import functional_map, spectrum, wks
from jfsf.spectral._orientation import brackets, orientation_score
from jfsf.testing import cast, mirror
from jfsf.types import Mesh

DEFAULT = Weights()
seeds = st.integers(0, 10**6)
SOLVERS = ("jaxopt", "lineax")
solvers = pytest.mark.parametrize("solver", SOLVERS)


def fit(x, y, desc_x, desc_y, weights=DEFAULT, *, k, solver="jaxopt", **options):
    # Weights of one type, defaults included, compile once.
    weights = Weights(*(jnp.asarray(w, x.mass.dtype) for w in weights))
    return initial.fit(x, y, desc_x, desc_y, weights, k=k, solver=solver, **options)


def spec_of(mesh, k=30):
    return cast(spectrum(mesh, k, cache=False))


def random(seed, *shape):
    return jnp.asarray(np.random.default_rng(seed).normal(size=shape))


# The first 42 vertices of X's icosphere are Y's.
X, Y = spec_of(bumpy()), spec_of(bumpy(0, 1), 20)
N_X, N_Y, K = 162, 42, 7
DESC_X, DESC_Y = (
    wks(X, jnp.array([0, 5, 30]), num=8),
    wks(Y, jnp.array([0, 5, 30]), num=8),
)


@solvers
@pytest.mark.parametrize(
    "weights",
    [
        DEFAULT,
        Weights(1.0, 0.0, 0.0, 0.0),
        Weights(0.3, 2.0, 0.0, 0.0),
        Weights(0.5, 0.1, 0.7, -1.5),
    ],
)
@settings(max_examples=5)
@given(seed=seeds)
def test_dense_least_squares_agrees(solver, weights, seed):
    # More descriptors than eigenfunctions: the minimum is unique for all weights.
    desc_x, desc_y = random(seed, N_X, 24), random(seed + 1, N_Y, 24)
    tensor_x, tensor_y = (np.asarray(brackets(spec, k=K)) for spec in (X, Y))
    residuals = oracles.fit_residuals(X, Y, desc_x, desc_y, tensor_x, tensor_y, weights)
    dense = oracles.fit(residuals, K)
    found = fit(X, Y, desc_x, desc_y, weights, k=K, solver=solver)
    assert np.allclose(found.C_yx, dense, atol=1e-7)
    assert found.residual < 1e-9


@pytest.mark.parametrize("weights", [DEFAULT, Weights(0.5, 2.0, 0.7, -1.5)])
def test_terms_match_their_definition(weights):
    # The descriptors standardised, then every operator as a dense product.
    desc_x, desc_y = random(0, N_X, 5) + 3, 10 * random(1, N_Y, 5)
    sides = []
    for spec, desc in ((X, desc_x), (Y, desc_y)):
        mass, desc = np.asarray(spec.mass), np.asarray(desc)
        desc = desc - mass @ desc
        sides.append((np.asarray(spec.evecs)[:, :K], mass, desc))
    norm = np.sqrt(sum(mass @ desc**2 for _, mass, desc in sides) / 2)
    sign = -1 if weights.orientation < 0 else 1
    coef, times, turn = [], [], []
    for spec, (phi, mass, desc) in zip((X, Y), sides, strict=True):
        desc = desc / norm
        coef.append(phi.T @ (mass[:, None] * desc))
        product = [phi.T @ np.diag(mass * d) @ phi for d in desc.T]
        times.append(np.stack(product, 1))
        tensor = np.asarray(brackets(spec, k=K))
        # Row c of operator d: the bracket of descriptor d with each eigenfunction.
        bracket = [np.einsum("cab,a->cb", tensor, c) for c in coef[-1].T]
        turn.append(np.stack(bracket, 1))
    size = lambda parts: sum(np.sum(part**2) for part in parts) / 2
    top = max(X.evals[K - 1], Y.evals[K - 1])
    root_x, root_y = (np.sqrt(np.asarray(s.evals)[:K] / top) for s in (X, Y))
    gap = 1 / (root_x[:, None] - 1j) - 1 / (root_y[None] - 1j)
    mask = np.abs(gap) ** 2
    found = terms(X, Y, desc_x, desc_y, weights, k=K)
    close = lambda ours, truth: np.testing.assert_allclose(ours, truth, atol=1e-10)
    close(found.coef_x, coef[0])
    close(found.coef_y, coef[1])
    close(found.weight_desc, abs(weights.descriptors) * K / size(coef))
    close(found.mask, weights.laplacian * mask / mask.mean())
    close(found.commute_x, np.concatenate([times[0], sign * turn[0]], 1))
    close(found.commute_y, np.concatenate([times[1], turn[1]], 1))
    strength = (
        weights.multiplication / size(times),
        abs(weights.orientation) / size(turn),
    )
    close(found.weight_e, K * np.repeat(strength, 5))
    # One shape at a time, for all of its pairs.
    halves = shape_terms(X, desc_x, k=K), shape_terms(Y, desc_y, k=K)
    jax.tree.map(close, combine(*halves, weights), found)


def test_both_solvers_agree():
    one, two = (fit(X, Y, DESC_X, DESC_Y, k=K, solver=s).C_yx for s in SOLVERS)
    assert jnp.linalg.norm(one - two) < 1e-6 * jnp.linalg.norm(one)


@solvers
def test_constants_go_to_constants(solver):
    C_yx = fit(X, Y, DESC_X, DESC_Y, k=K, solver=solver).C_yx
    assert jnp.array_equal(C_yx[:, 0], jnp.eye(K)[0])


def test_the_identity_is_recovered():
    found = fit(X, X, DESC_X, DESC_X, k=12)
    assert jnp.abs(found.C_yx - jnp.eye(12)).max() < 1e-6
    assert found.residual < 1e-9


def test_a_real_shape_finds_itself():
    spec = spec_of(jfsf.data.load("man_walk").mesh, 60)
    desc = wks(spec, jnp.array([10, 2000, 4000]), num=10)
    found = fit(spec, spec, desc, desc, k=30)
    assert jnp.abs(found.C_yx - jnp.eye(30)).max() < 1e-6


@given(seed=seeds)
def test_relabelling_changes_nothing(seed):
    order = np.random.default_rng(seed).permutation(N_Y)
    faces = jnp.asarray(np.argsort(order)[Y.faces], jnp.int32)
    other = Y._replace(evecs=Y.evecs[order], mass=Y.mass[order], faces=faces)
    plain = fit(X, Y, DESC_X, DESC_Y, k=K)
    assert jnp.allclose(
        fit(X, other, DESC_X, DESC_Y[order], k=K).C_yx, plain.C_yx, atol=1e-7
    )


def test_a_known_map_between_meshes_of_different_size():
    fine, coarse = bumpy(0, 3), bumpy(0, 2)  # 642 and 162 vertices on one surface
    x, y = spec_of(fine), spec_of(coarse)
    gap = fine.vertices[:, None] - coarse.vertices[None]
    truth = functional_map(jnp.asarray((gap**2).sum(2).argmin(1)), x, y)[:10, :10]
    spots = jnp.array([0, 5, 30])  # subdivision keeps the numbers of old vertices
    found = fit(x, y, wks(x, spots, num=20), wks(y, spots, num=20), k=10)
    assert jnp.linalg.norm(found.C_yx - truth) < 0.1 * jnp.linalg.norm(truth)


@given(seed=seeds)
def test_signs_of_eigenvectors_carry_over(seed):
    rng = np.random.default_rng(seed)
    sign_x, sign_y = (
        jnp.asarray(rng.choice([-1.0, 1.0], n)).at[0].set(1) for n in (30, 20)
    )
    x = X._replace(evecs=X.evecs * sign_x[None])
    y = Y._replace(evecs=Y.evecs * sign_y[None])
    plain, turned = (fit(*pair, DESC_X, DESC_Y, k=K).C_yx for pair in ((X, Y), (x, y)))
    assert jnp.allclose(turned, sign_x[:K, None] * plain * sign_y[None, :K], atol=1e-7)


@given(angle=st.floats(-3, 3))
def test_turns_inside_an_eigenspace_carry_over(angle):
    evals = X.evals.at[4].set(X.evals[3])
    c, s = np.cos(angle), np.sin(angle)
    turn = jnp.eye(30).at[3:5, 3:5].set(jnp.array([[c, -s], [s, c]]))
    x = X._replace(evals=evals)
    other = x._replace(evecs=x.evecs @ turn)
    plain, turned = (fit(s, Y, DESC_X, DESC_Y, k=K).C_yx for s in (x, other))
    assert jnp.allclose(turned, turn[:K, :K].T @ plain, atol=1e-7)


def test_the_orientation_weight_chooses_the_side():
    # A shape with a mirror plane: its descriptors cannot tell left from right.
    ball = trimesh.creation.icosphere(subdivisions=3)
    v = np.array(ball.vertices)
    v = v * (1 + 0.3 * v[:, 1:2] ** 3 + 0.2 * v[:, 2:] * v[:, 1:2]) * [1.0, 1.4, 2.0]
    spec = spec_of(Mesh(v, np.array(ball.faces, np.int32)))
    desc = wks(spec, num=60)
    tensor = brackets(spec, k=12)
    values = []
    for weight in (1.0, -1.0):
        weights = Weights(orientation=weight)
        values.append(
            orientation_score(
                fit(spec, spec, desc, desc, weights, k=12).C_yx, tensor, tensor
            )
        )
    assert values[0] > 0.99 and values[1] < -0.99


def test_a_mirrored_copy_wants_a_negative_weight():
    y = spec_of(mirror(bumpy()))
    desc_y = wks(y, jnp.array([0, 5, 30]), num=8)
    truth = functional_map(jnp.arange(N_X), X, y)[:12, :12]
    good, bad = (
        fit(X, y, DESC_X, desc_y, Weights(orientation=w), k=12).C_yx
        for w in (-1.0, 1.0)
    )
    assert jnp.abs(good - truth).max() < 1e-6
    assert jnp.abs(bad - truth).max() > 0.1


@given(seed=seeds)
def test_strength_and_offset_of_a_descriptor_do_not_matter(seed):
    factor, shift = jnp.exp(random(seed, 1, 24)), random(seed + 1, 1, 24)
    plain = fit(X, Y, DESC_X, DESC_Y, k=K).C_yx
    other = fit(X, Y, DESC_X * factor + shift, DESC_Y * factor + shift, k=K).C_yx
    assert jnp.allclose(other, plain, atol=1e-6)


@given(seed=seeds)
def test_a_columns_weight_counts_it(seed):
    """0 leaves a descriptor out, the root of 2 is that descriptor twice."""
    times = np.random.default_rng(seed).permutation(np.arange(24) % 3)
    index = np.repeat(np.arange(24), times)
    counted = fit(X, Y, DESC_X[:, index], DESC_Y[:, index], k=K).C_yx
    weights = 0.3 * jnp.sqrt(jnp.asarray(times, float))
    weighted = fit(X, Y, DESC_X, DESC_Y, k=K, column_weights=weights).C_yx
    assert jnp.allclose(weighted, counted, atol=1e-6)


@pytest.mark.parametrize("value, dtype", [(0.0, "float32"), (3.7, "float32")])
def test_a_constant_descriptor_has_no_effect(value, dtype):
    x, y = cast(X, dtype), cast(Y, dtype)
    desc_x, desc_y = DESC_X.astype(dtype), DESC_Y.astype(dtype)
    plain = terms(x, y, desc_x, desc_y, k=K)
    more = terms(
        x,
        y,
        jnp.concatenate([desc_x, jnp.full((N_X, 1), value, dtype)], 1),
        jnp.concatenate([desc_y, jnp.full((N_Y, 1), value, dtype)], 1),
        k=K,
    )
    assert jnp.abs(more.coef_x[:, -1]).max() < 0.05
    assert np.isclose(more.weight_desc, plain.weight_desc, rtol=1e-3)


def test_padding_is_invisible():
    extra_x, extra_y = 2, 5

    def pad(spec, extra):
        return spec._replace(
            evecs=jnp.pad(spec.evecs, ((0, extra), (0, 0))),
            mass=jnp.pad(spec.mass, (0, extra)),
            faces=jnp.pad(spec.faces, ((0, extra), (0, 0))),
        )

    # Whatever the descriptors say there.
    desc_x = jnp.pad(DESC_X, ((0, extra_x), (0, 0)), constant_values=9)
    desc_y = jnp.pad(DESC_Y, ((0, extra_y), (0, 0)), constant_values=9)
    plain = fit(X, Y, DESC_X, DESC_Y, k=K)
    padded = fit(pad(X, extra_x), pad(Y, extra_y), desc_x, desc_y, k=K)
    assert jnp.allclose(padded.C_yx, plain.C_yx, atol=1e-8)


def test_a_cloud_has_no_orientation_term():
    cloud = X._replace(faces=jnp.zeros((0, 3), jnp.int32))
    found = fit(cloud, cloud, DESC_X, DESC_X, k=K)
    assert jnp.abs(found.C_yx - jnp.eye(K)).max() < 1e-6


@solvers
def test_entries_that_the_energy_does_not_see_are_zero(solver):
    nothing = Weights(0.0, 0.0, 0.0, 0.0)
    found = fit(X, Y, DESC_X, DESC_Y, nothing, k=K, solver=solver)
    assert jnp.array_equal(found.C_yx, jnp.zeros((K, K)).at[0, 0].set(1))
    assert found.residual == 0


@solvers
def test_vmap_equals_the_loop(solver):
    desc_x = jnp.stack([DESC_X, DESC_X[:, ::-1], DESC_X**2])
    weights = Weights(
        jnp.ones(3), jnp.ones(3), jnp.ones(3), jnp.array([1.0, -1.0, 0.0])
    )

    def run(desc, w):
        return fit(X, Y, desc, DESC_Y, w, k=K, solver=solver)

    batch = jax.vmap(run)(desc_x, weights)
    for i in range(3):
        own = run(desc_x[i], jax.tree.map(lambda w, i=i: w[i], weights))
        assert jnp.allclose(batch.C_yx[i], own.C_yx, atol=1e-7)


def sine(desc_x, desc_y, weights, evals, evecs, solver="jaxopt"):
    """Something smooth in the solution."""
    x = X._replace(evals=evals, evecs=evecs)
    return jnp.sum(jnp.sin(fit(x, Y, desc_x, desc_y, weights, k=K, solver=solver).C_yx))


sine_grad = jax.jit(jax.grad(sine, tuple(range(5))), static_argnames="solver")


@solvers
def test_gradients_through_the_solution(solver):
    weights = Weights(*jnp.array([1.0, 0.2, 0.7, 0.4]))
    at = [DESC_X, DESC_Y, weights, X.evals, X.evecs]
    h = 1e-5
    for i, slope in enumerate(sine_grad(*at, solver=solver)):
        step = jax.tree.map(lambda s, i=i: random(i, *s.shape), slope)
        if i == 3:
            step = step.at[0].set(0)  # the constant's eigenvalue is 0
        ends = []
        for sign in (1, -1):
            moved = jax.tree.map(lambda a, d, s=sign: a + s * h * d, at[i], step)
            inputs = [*at[:i], moved, *at[i + 1 :]]
            ends.append(sine(*inputs, solver=solver))
        parts = jax.tree.map(lambda a, b: jnp.sum(a * b), slope, step)
        exact = sum(jax.tree.leaves(parts))
        rate = (ends[0] - ends[1]) / (2 * h)
        assert np.isclose(rate, exact, rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("name", ["laplacian", "multiplication", "orientation"])
def test_gradients_at_weight_zero_are_those_from_above(name):
    at = Weights(*jnp.ones(4))._replace(**{name: jnp.zeros(())})
    h = 1e-6
    slope = getattr(sine_grad(DESC_X, DESC_Y, at, X.evals, X.evecs)[2], name)
    ends = [
        sine(DESC_X, DESC_Y, at._replace(**{name: jnp.asarray(t)}), X.evals, X.evecs)
        for t in (h, 0.0)
    ]
    assert np.isclose((ends[0] - ends[1]) / h, slope, rtol=1e-3, atol=1e-5)


@solvers
def test_float32(solver):
    short = [a.astype(jnp.float32) for a in (DESC_X, DESC_Y)]
    specs = cast(X, jnp.float32), cast(Y, jnp.float32)
    found = fit(*specs, *short, k=K, solver=solver)
    assert found.C_yx.dtype == found.residual.dtype == jnp.float32
    exact = np.asarray(fit(X, Y, DESC_X, DESC_Y, k=K).C_yx)
    assert np.abs(np.asarray(found.C_yx) - exact).max() < 2e-3
    assert found.residual < 1e-4


def test_a_sweep_of_python_floats_compiles_once():
    compiled = initial.fit._jitted._cache_size
    initial.fit(X, Y, DESC_X, DESC_Y, Weights(), k=K)
    before = compiled()
    for weight in (0.5, 0.25, -2.0):
        initial.fit(X, Y, DESC_X, DESC_Y, Weights(orientation=weight), k=K)
    assert compiled() == before


@pytest.mark.parametrize("cast", [jnp.float32, int])
def test_weights_of_any_type(cast):
    weights = Weights(*(cast(w) for w in (1, 2, 1, 1)))
    found = initial.fit(X, Y, DESC_X, DESC_Y, weights, k=K)
    exact = fit(X, Y, DESC_X, DESC_Y, Weights(1.0, 2.0, 1.0, 1.0), k=K)
    assert jnp.allclose(found.C_yx, exact.C_yx)


@pytest.mark.parametrize(
    "change, message",
    [
        ({"desc_x": DESC_X[:-1]}, r"desc_x is \(161, 24\), the shape has 162 vertices"),
        ({"desc_y": DESC_X}, r"desc_y is \(162, 24\), the shape has 42 vertices"),
        ({"desc_y": DESC_Y[:, 0]}, r"desc_y is \(42,\), the shape has 42"),
        ({"desc_y": DESC_Y[:, 1:]}, "desc_x has 24 columns, desc_y 23"),
        ({"column_weights": jnp.ones(23)}, r"column_weights are \(23,\), there are 24"),
        ({"k": 21}, "k is 21, spec_y has 20 eigenpairs"),
        ({"k": 1}, "k is 1, spec_x has 30 eigenpairs"),
        ({"solver": "lbfgs"}, "solver is 'jaxopt' or 'lineax', not 'lbfgs'"),
    ],
)
def test_errors(change, message):
    options = {"desc_x": DESC_X, "desc_y": DESC_Y, "k": K, **change}
    with pytest.raises(ValueError, match=message):
        fit(X, Y, **options)


def test_solve_refuses_an_unknown_solver():
    with pytest.raises(ValueError, match="not 'qr'"):
        solve(terms(X, Y, DESC_X, DESC_Y, k=K), solver="qr")


def test_importing_and_solving_warn_of_nothing_and_leave_jax_as_it_is():
    program = (
        "import jax; before = dict(jax.config.values);"
        "import jfsf.initial._linear as room;"
        "some = jax.numpy.ones((2, 2)); one = jax.numpy.ones((2, 1, 2));"
        "few = one[0, 0, :1]; "
        "problem = room.Terms(some, some, some[0, 0], some, one, one, few);"
        "[room.solve(problem, solver=s) for s in ('jaxopt', 'lineax')];"
        "assert dict(jax.config.values) == before; assert not jax.config.jax_enable_x64"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", program], check=True)

"""The paper's algorithm to the letter, kernels of one's own, and named settings."""

import pickle
import pydoc
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import oracles
import pytest
from precisions import FLOATS
from problems import N_X, N_Y, WIDTH, dense, draw, weights

from jfsf import testing
from jfsf.array._jit import static, static_key
from jfsf.convert import (
    algorithm_2,
    authors_sinkhorn,
    build_kernel,
    scale_kernel,
    sinkhorn,
)
from jfsf.convert._variants import quick_sinkhorn
from jfsf.neighbours import NeighbourSearch, neighbours
from jfsf.refine import icp, soft_sinkhorn
from jfsf.types import Neighbours

K0, LAM = 6, 30.0
NAMED = {
    "quick_sinkhorn": quick_sinkhorn,
    "authors_sinkhorn": authors_sinkhorn,
    "soft_sinkhorn": soft_sinkhorn,
}


@pytest.mark.parametrize("dtype", FLOATS)
@pytest.mark.parametrize("k0, num_iters", [(K0, 1), (K0, 10), (N_Y, 4)])
@pytest.mark.parametrize("seed", range(3))
def test_algorithm_2_is_that_of_the_paper(dtype, k0, num_iters, seed):
    emb_x, emb_y = draw(seed)
    ours = algorithm_2(
        emb_x.astype(dtype), emb_y.astype(dtype), lam=LAM, k0=k0, num_iters=num_iters
    )
    *_, truth = oracles.algorithm_2(*map(np.asarray, draw(seed)), k0, LAM, num_iters)
    tol = 1e-10 if dtype == jnp.float64 else 1e-4
    np.testing.assert_allclose(dense(ours), truth, atol=tol)
    T_xy, T_yx = np.asarray(ours.T_xy), np.asarray(ours.T_yx)
    assert (truth[np.arange(N_X), T_xy] >= truth.max(1) - 10 * tol).all()
    assert (truth[T_yx, np.arange(N_Y)] >= truth.max(0) - 10 * tol).all()
    assert ours.empty_y == (truth.sum(0) == 0).sum() and ours.recall == 1
    assert ours.f.dtype == dtype


def test_its_rows_alone_have_neighbours():
    emb_x, emb_y = draw()
    found = algorithm_2(emb_x, emb_y, lam=LAM, k0=K0)
    assert (dense(found) > 0).sum(1).max() <= K0
    assert not np.isfinite(found.kernel.log_yx).any()


def test_its_sharpness_has_a_unit():
    emb_x, emb_y = draw()
    plain = algorithm_2(emb_x, emb_y, lam=LAM, k0=K0)
    twice = algorithm_2(2 * emb_x, 2 * emb_y, lam=LAM / 4, k0=K0)
    np.testing.assert_allclose(dense(twice), dense(plain), rtol=1e-9, atol=1e-15)


def test_padding_is_invisible():
    emb_x, emb_y = draw()
    a, b = weights(0, N_X), weights(1, N_Y)
    plain = algorithm_2(emb_x, emb_y, a, b, lam=LAM, k0=K0)
    wide = [jnp.pad(e, ((0, 4), (0, 0))) for e in (emb_x, emb_y)]
    padded = algorithm_2(*wide, jnp.pad(a, (0, 4)), jnp.pad(b, (0, 4)), lam=LAM, k0=K0)
    np.testing.assert_allclose(dense(padded)[:N_X, :N_Y], dense(plain), rtol=1e-9)
    assert np.array_equal(padded.T_xy[:N_X], plain.T_xy)
    assert padded.empty_y == plain.empty_y


def test_it_is_a_converter():
    x, y = (testing.blob_spectrum(i, 6, 1) for i in range(2))
    converter = partial(algorithm_2, lam=0.5, k0=8)
    found = icp(x, y, jnp.eye(6), num_iters=1, converter=converter)
    assert found.shape == (6, 6) and np.isfinite(found).all()


def test_tiles_that_hold_all_points_change_nothing():
    from jfsf.neighbours._tiles import tiles

    emb_x, emb_y = draw()
    search = NeighbourSearch((tiles(emb_x), tiles(emb_y)))
    plain = algorithm_2(emb_x, emb_y, lam=LAM, k0=K0)
    tiled = algorithm_2(emb_x, emb_y, search=search, lam=LAM, k0=K0)
    np.testing.assert_allclose(dense(tiled), dense(plain), atol=1e-9)


@pytest.mark.parametrize("power", [1.0, 2.0])
def test_a_kernel_of_ones_own(power):
    emb_x, emb_y = draw()
    near_xy, near_yx = (neighbours(*e, k0=K0) for e in (draw(), draw()[::-1]))
    both = build_kernel(near_xy, LAM, near_yx, power=power)
    rows = build_kernel(near_xy, LAM, n_y=N_Y, power=power)
    a, b = jnp.full(N_X, 1 / N_X), jnp.full(N_Y, 1 / N_Y)
    cost = np.linalg.norm(np.asarray(emb_x)[:, None] - np.asarray(emb_y), axis=2)
    full = np.exp(-LAM * cost**power)
    mine = np.zeros((N_X, N_Y), bool)
    mine[np.arange(N_X)[:, None], near_xy.idx] = True
    theirs = np.zeros((N_Y, N_X), bool)
    theirs[np.arange(N_Y)[:, None], near_yx.idx] = True
    for kernel, stored in ((rows, mine), (both, mine | theirs.T)):
        found = scale_kernel(kernel, a, b, num_iters=3)
        plan = np.exp(found.f)[:, None] * full * stored * np.exp(found.g)[None]
        np.testing.assert_allclose(dense(found), plan, atol=1e-12)


def test_any_costs_make_a_kernel():
    # Two of X, three of Y; the second of X wants the last of Y above all.
    costs = Neighbours(jnp.array([[0, 1], [2, 0]]), jnp.array([[1.0, 2], [0.0, 5]]))
    found = scale_kernel(
        build_kernel(costs, 1.0, n_y=3), jnp.full(2, 0.5), jnp.full(3, 1 / 3)
    )
    assert found.T_xy.tolist() == [1, 2] or found.T_xy.tolist() == [0, 2]
    assert found.empty_y == 0


@pytest.mark.parametrize(
    "run, message",
    [
        (lambda: algorithm_2(*draw(), lam=1.0, k0=0), "k0 is 0; give a whole number"),
        (
            lambda: algorithm_2(*draw(), lam=1.0, num_iters=0),
            "num_iters is 0; give a whole number",
        ),
        (
            lambda: algorithm_2(*draw(), jnp.ones(3), lam=1.0),
            r"marginal_x has shape \(3,\), emb_x has 23 rows",
        ),
        (
            lambda: algorithm_2(draw()[0], jnp.ones((4, 2)), lam=1.0),
            f"emb_x has {WIDTH} columns, emb_y has 2",
        ),
        (
            lambda: build_kernel(neighbours(*draw(), k0=2), 1.0),
            "near_yx is None; give n_y",
        ),
        (
            lambda: build_kernel(
                neighbours(*draw(), k0=2), 1.0, neighbours(*draw()[::-1], k0=2), n_y=4
            ),
            "n_y is 4, near_yx has 31 rows",
        ),
    ],
)
def test_errors(run, message):
    with pytest.raises(ValueError, match=message):
        run()


@pytest.mark.parametrize("name", NAMED)
def test_named_settings_are_documented(name):
    said = pydoc.render_doc(NAMED[name], renderer=pydoc.plaintext)
    assert "Arguments and result are those of" in said
    assert "partial(func" not in said  # the help of functools.partial itself


@pytest.mark.parametrize("name", NAMED)
def test_named_settings_are_equal_by_content(name):
    named = NAMED[name]
    again = partial(named.func, *named.args, **named.keywords)
    copy = pickle.loads(pickle.dumps(named))
    assert copy.func is sinkhorn and copy.__doc__ == named.__doc__
    assert static_key(named) == static_key(again) == static_key(copy)
    assert hash(static_key(named)) == hash(static_key(copy))
    assert static(copy) is static(again)
    # With one more option, as when that were written out.
    more, written = (
        partial(named, k0=3),
        partial(sinkhorn, **named.keywords | {"k0": 3}),
    )
    assert static_key(more) == static_key(written)


def test_help_says_how_the_filter_differs_from_the_paper():
    said = pydoc.render_doc(sinkhorn, renderer=pydoc.plaintext)
    for word in ("eq. 12", "algorithm_2", "power", "union", "relative", "plain"):
        assert word in said


def test_the_paper_s_algorithm_differentiates():
    emb_x, emb_y = draw()
    value = lambda x: algorithm_2(x, emb_y, lam=LAM, k0=K0).f.sum()
    assert np.isfinite(jax.grad(value)(emb_x)).all()


def test_values_out_of_range_are_refused_by_each_step():
    found = algorithm_2(*draw(), lam=LAM, k0=K0)
    mass, other = jnp.full(N_X, 1 / N_X), jnp.full(N_Y, 1 / N_Y)
    with pytest.raises(ValueError, match="algorithm_2: lam is -1.0; give 0 or more"):
        algorithm_2(*draw(), lam=-1.0, k0=K0)
    with pytest.raises(ValueError, match="scale_kernel: marginal_y sums to"):
        scale_kernel(found.kernel, mass, 4 * other)
    with pytest.raises(ValueError, match="scale_kernel: relax is 3; give more than 0"):
        scale_kernel(found.kernel, mass, other, relax=3)

"""Fast Sinkhorn Filter: aligned embeddings -> maps both ways by entropic transport.

Algorithm 2 of Pai et al. (CVPR 2021), re-derived: a sparse kernel on k0 neighbours both
ways (eq. 12), Sinkhorn scaling to the marginals, row and column argmax of the plan.

In the paper's float64 the weights reach e^-500; float32 has nothing below e^-103. So the
scalings live in the log domain: the first pair of updates is a log-sum-exp, and from
then on no update changes a scaling by more than a factor 1 / min(marginal), so a few
plain updates at a time, on a kernel that absorbs the scalings, are safe.
"""

from functools import partial
from typing import Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf import kernel as kernels
from jfsf.knn import neighbours
from jfsf.types import Filtered, Kernel, Neighbours

ABSORB_EVERY = 4  # updates; 4 factors of 1 / min(marginal) stay inside float32


@partial(jax.jit, static_argnames=("k0", "num_iters", "scale", "power", "one_sided"))
def sinkhorn(
    emb_x: Float[Array, "n_x k"],
    emb_y: Float[Array, "n_y k"],
    marginal_x: Float[Array, " n_x"] | None = None,
    marginal_y: Float[Array, " n_y"] | None = None,
    lam: Float[Array, ""] | float = 20.0,
    *,
    k0: int = 20,
    num_iters: int = 30,
    scale: Literal["median", "max"] = "median",
    power: float = 1.0,
    one_sided: float = 1.0,
) -> Filtered:
    """Both point-to-point maps between two aligned embeddings."""
    _check(emb_x, emb_y, marginal_x, marginal_y)
    dtype = jnp.result_type(emb_x)
    marginal_x = _uniform(emb_x) if marginal_x is None else marginal_x
    marginal_y = _uniform(emb_y) if marginal_y is None else marginal_y
    valid_x, valid_y = marginal_x > 0, marginal_y > 0
    near_xy = _near(emb_x, emb_y, valid_x, valid_y, k0)
    near_yx = _near(emb_y, emb_x, valid_y, valid_x, k0)

    lam = jnp.asarray(lam, dtype)
    lam_xy, lam_yx = lam / _length(near_xy, scale), lam / _length(near_yx, scale)
    if scale != "max":
        lam_xy = lam_yx = jnp.sqrt(lam_xy * lam_yx)
    kernel = kernels.build(
        near_xy, near_yx, lam_xy, lam_yx, power=power, one_sided=one_sided
    )
    return scale_kernel(kernel, marginal_x, marginal_y, num_iters=num_iters)


@partial(jax.jit, static_argnames="num_iters")
def scale_kernel(
    kernel: Kernel,
    marginal_x: Float[Array, " n_x"],
    marginal_y: Float[Array, " n_y"],
    *,
    num_iters: int = 30,
) -> Filtered:
    flipped = kernels.transpose(kernel)
    # Padding: log marginal 0 and no entries, so the scalings stay finite there.
    log_x = jnp.log(jnp.where(marginal_x > 0, marginal_x, 1))
    log_y = jnp.log(jnp.where(marginal_y > 0, marginal_y, 1))
    f = jnp.zeros_like(marginal_x)
    g = _minus(log_y, kernels.log_matvec(flipped, f))
    f = _minus(log_x, kernels.log_matvec(kernel, g))

    def absorbed(f, g, updates):
        p = kernels.plan(kernel, f, g)
        pt = kernels.transpose(p)

        def update(_, uv):
            v = _ratio(marginal_y, kernels.matvec(pt, uv[0]))
            return _ratio(marginal_x, kernels.matvec(p, v)), v

        u, v = jnp.ones_like(f), jnp.ones_like(g)
        u, v = jax.lax.fori_loop(0, updates, update, (u, v))
        return f + jnp.log(u), g + jnp.log(v)

    rounds, rest = divmod(num_iters - 1, ABSORB_EVERY)
    f, g = jax.lax.fori_loop(
        0, rounds, lambda _, fg: absorbed(*fg, ABSORB_EVERY), (f, g)
    )
    f, g = absorbed(f, g, rest)

    T_xy, found_x = kernels.row_argmax(kernel, g)
    T_yx, found_y = kernels.row_argmax(flipped, f)
    p = kernels.plan(kernel, f, g)
    rows = kernels.matvec(p, jnp.ones_like(g))
    cols = kernels.matvec(kernels.transpose(p), jnp.ones_like(f))
    error = jnp.abs(rows - marginal_x).sum() + jnp.abs(cols - marginal_y).sum()
    return Filtered(
        T_xy.astype(jnp.int32),
        T_yx.astype(jnp.int32),
        kernel,
        f,
        g,
        error,
        jnp.sum(~found_x & (marginal_x > 0)),
        jnp.sum(~found_y & (marginal_y > 0)),
    )


def _near(queries, points, valid_q, valid_p, k0) -> Neighbours:
    # The choice of neighbours is not differentiable; their distances are.
    frozen = jax.lax.stop_gradient((queries, points))
    idx, dist = neighbours(*frozen, valid_p, k0=min(k0, len(points), len(queries)))
    gap = queries[:, None] - points[idx]
    square = jnp.sum(gap**2, 2)
    # The gradient of sqrt at 0 is infinite; a coincident pair has none to give.
    apart = square > 0
    length = jnp.where(apart, jnp.sqrt(jnp.where(apart, square, 1)), 0)
    known = valid_q[:, None] & jnp.isfinite(dist)
    return Neighbours(idx, jnp.where(known, length, jnp.inf))


def _length(near: Neighbours, scale: str):
    known = jnp.isfinite(near.dist)
    if scale == "max":
        length = jnp.max(jnp.where(known, near.dist, 0))
    elif scale == "median":
        length = jnp.nanmedian(jnp.where(known[:, -1], near.dist[:, -1], jnp.nan))
    elif scale == "first":
        length = jnp.nanmedian(jnp.where(known[:, 0], near.dist[:, 0], jnp.nan))
    else:
        raise ValueError(f"sinkhorn: scale is 'median' or 'max', not {scale!r}")
    return jax.lax.stop_gradient(jnp.where(length > 0, length, 1))


def _minus(log_marginal, log_sum):
    # An empty row keeps scaling 1: it holds no entries, so nothing follows from it.
    return jnp.where(jnp.isfinite(log_sum), log_marginal - log_sum, 0)


def _ratio(marginal, weight):
    ok = (weight > 0) & (marginal > 0)
    return jnp.where(ok, marginal / jnp.where(ok, weight, 1), 1)


def _uniform(emb):
    return jnp.full(len(emb), 1 / len(emb), emb.dtype)


def _check(emb_x, emb_y, marginal_x, marginal_y):
    if emb_x.shape[1] != emb_y.shape[1]:
        raise ValueError(
            f"sinkhorn: emb_x has {emb_x.shape[1]} columns, emb_y {emb_y.shape[1]}"
        )
    for name, m, emb in (("x", marginal_x, emb_x), ("y", marginal_y, emb_y)):
        if m is not None and m.shape != (len(emb),):
            raise ValueError(
                f"sinkhorn: marginal_{name} has shape {m.shape}, emb_{name} has "
                f"{len(emb)} rows"
            )

"""Coherent point drift: aligned embeddings -> maps both ways.

This file is long because it holds one published method whole.

Rodola, Moeller and Cremers, "Point-wise map recovery and refinement from functional
correspondence", VMV 2015, on the registration of Myronenko and Song, "Point set
registration: coherent point drift", TPAMI 2010.

The rows y_m of one embedding are centroids of a Gaussian mixture, the rows x_n of the
other are samples of it. With weight w a sample is an outlier; else it comes from a
centroid moved by a smooth field, t_m = y_m + sum_l G_ml w_l, where G_ml is
exp(-|y_m - y_l|^2 / (2 beta^2)). Expectation and maximisation alternately lower

    -sum_n log(w / N + (1 - w) / M sum_m N(x_n; t_m, sigma^2 I)) + lam / 2 tr(W^T G W).

A centroid's match is the sample that it explains best: argmax_n p(m | n).

As in cpd_register, the package of Myronenko and Song, each set is first brought to mean
0 and unit variance, and sigma^2 starts at the mean squared distance of the two sets.
The defaults beta 2, lam 3, w 0.1 and tol 1e-5 are those of the package. A public script
that applies it to functional maps on FAUST has the same, with at most 50 iterations.
The source maps the centroids only; T_yx comes from a second run with the roles
exchanged.

Departures: G is replaced by its leading eigenpairs, as in the package's own low-rank
variant, but more of them. All densities stay in the log domain, because sigma^-k under-
and overflows at the width of an embedding.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jfsf.array import matmul
from jfsf.array._jit import jit
from jfsf.neighbours import NeighbourSearch
from jfsf.types import Maps

ROWS = 256  # samples at a time
OVERSAMPLE = 20  # random directions beyond the rank
POWERS = 1  # subspace iterations
LEAST = 1e-8  # sigma^2 at which the source stops, on sets of unit variance


class Drift(NamedTuple):
    """A mixture fitted to samples, in the frame of unit variance.

    match: (m,) int32, the sample that each centroid explains best; 0 on padding.
    moved: centroids after the motion.
    sigma2: variance of the Gaussians, a coordinate.
    energy: the objective before each iteration, up to a constant; nan after the last.
    """

    match: Int[Array, " m"]
    moved: Float[Array, "m k"]
    sigma2: Float[Array, ""]
    energy: Float[Array, " num_iters"]


@jit(static_argnames=("num_iters", "rank"))
def cpd(
    emb_x: Float[Array, "n_x k"],
    emb_y: Float[Array, "n_y k"],
    marginal_x: Float[Array, " n_x"] | None = None,
    marginal_y: Float[Array, " n_y"] | None = None,
    search: NeighbourSearch | None = None,
    *,
    beta: Float[Array, ""] | float = 2.0,
    lam: Float[Array, ""] | float = 3.0,
    outliers: Float[Array, ""] | float = 0.1,
    tol: Float[Array, ""] | float = 1e-5,
    num_iters: int = 50,
    rank: int = 300,
) -> Maps:
    """Both maps between two aligned embeddings, by coherent point drift. A converter.

    Args:
        emb_x, emb_y: rows of one Euclidean space (`jfsf.spectral.embeddings`).
        marginal_x, marginal_y: 0 marks padding, which is never matched and is mapped to
            0; other values do not matter. Rows that are not finite are padding too.
        search: ignored; all points are compared.
        beta: width of the kernel that makes the motion smooth, in units of the root
            mean square distance of a point to the mean.
        lam: weight of the motion's penalty.
        outliers: w, share of samples that no centroid explains, in [0, 1).
        tol: relative change of the objective that ends the iteration.
        num_iters: most iterations of expectation and maximisation.
        rank: eigenpairs of G, several times the width of the embedding. With as many as
            there are centroids, or more, G is exact.

    Raises:
        ValueError: shapes do not fit, or num_iters or rank is out of range.
    """
    _check("cpd", emb_x, emb_y, marginal_x, marginal_y, num_iters, rank)
    run = partial(
        drift,
        beta=beta,
        lam=lam,
        outliers=outliers,
        tol=tol,
        num_iters=num_iters,
        rank=rank,
    )
    return Maps(
        run(emb_x, emb_y, marginal_x, marginal_y).match,
        run(emb_y, emb_x, marginal_y, marginal_x).match,
    )


@jit(static_argnames=("num_iters", "rank"))
def drift(
    centroids: Float[Array, "m k"],
    samples: Float[Array, "n k"],
    marginal_centroids: Float[Array, " m"] | None = None,
    marginal_samples: Float[Array, " n"] | None = None,
    *,
    beta: Float[Array, ""] | float = 2.0,
    lam: Float[Array, ""] | float = 3.0,
    outliers: Float[Array, ""] | float = 0.1,
    tol: Float[Array, ""] | float = 1e-5,
    num_iters: int = 50,
    rank: int = 300,
) -> Drift:
    """Move `centroids` coherently onto `samples`. Arguments as for `cpd`.

    Raises:
        ValueError: shapes do not fit, or num_iters or rank is out of range.
    """
    _check(
        "drift",
        centroids,
        samples,
        marginal_centroids,
        marginal_samples,
        num_iters,
        rank,
        names=("centroids", "samples"),
    )
    dtype, width = centroids.dtype, samples.shape[1]
    real_c, centroids = _real(centroids, marginal_centroids)
    real_s, samples = _real(samples, marginal_samples)
    beta, lam = jnp.asarray(beta, dtype), jnp.asarray(lam, dtype)
    outliers, tol = jnp.asarray(outliers, dtype), jnp.asarray(tol, dtype)
    start, data = _standard(centroids, real_c), _standard(samples, real_s)
    # The log of the term that the uniform density adds to
    # sum_m exp(-|x - t_m|^2 / (2 sigma^2)), without its power of sigma.
    log_uniform = jnp.log(outliers / (1 - outliers) * real_c.sum() / real_s.sum())
    log_uniform = log_uniform + width / 2 * jnp.log(2 * jnp.pi).astype(dtype)
    modes, gain = _kernel_modes(start, real_c, beta, min(rank, len(start)))

    def log_outlier(sigma2):
        return log_uniform + width / 2 * jnp.log(sigma2)

    def more(state):
        i, change, sigma2 = state[0], state[1], state[4]
        return (i < num_iters) & (change > tol) & (sigma2 > LEAST)

    def step(state):
        i, _, last, moved, sigma2, penalty, energy = state
        weight, mean, square, log_sum = _expectation(
            data, real_s, moved, real_c, sigma2, log_outlier(sigma2)
        )
        now = width / 2 * real_s.sum() * jnp.log(sigma2) - log_sum + penalty
        # The motion is modes @ a, its penalty sum a^2 / gain: this scaling keeps the
        # system well conditioned in float32.
        system = matmul(modes.T, modes * weight[:, None])
        system = system + jnp.diag(lam * sigma2 / gain)
        force = matmul(modes.T, mean - weight[:, None] * start)
        a = jax.scipy.linalg.solve(system, force, assume_a="pos")
        moved = start + matmul(modes, a)
        residual = square - 2 * jnp.sum(mean * moved)
        residual = residual + jnp.sum(weight * jnp.sum(moved**2, 1))
        sigma2 = jnp.abs(residual) / (weight.sum() * width)
        penalty = lam / 2 * jnp.sum(a**2 / gain[:, None])
        change = jnp.abs((now - last) / now)
        return i + 1, change, now, moved, sigma2, penalty, energy.at[i].set(now)

    count = real_c.sum() * real_s.sum() * width
    sigma2 = (
        real_c.sum() * jnp.sum(data**2) + real_s.sum() * jnp.sum(start**2)
    ) / count
    zero = jnp.zeros((), dtype)
    energy = jnp.full(num_iters, jnp.nan, dtype)
    state = (
        jnp.zeros((), jnp.int32),
        zero + jnp.inf,
        zero,
        start,
        sigma2,
        zero,
        energy,
    )
    state = jax.lax.while_loop(more, step, state)
    moved, sigma2 = state[3], jnp.maximum(state[4], LEAST)
    match = _matches(data, real_s, moved, real_c, sigma2, log_outlier(sigma2))
    return Drift(match, moved, sigma2, state[6])


def _standard(points: Array, real: Array) -> Array:
    """Mean 0, mean squared length 1; 0 on padding."""
    points = jnp.where(real[:, None] > 0, points, 0)
    centred = (points - points.sum(0)[None] / real.sum()) * real[:, None]
    scale = jnp.sqrt(jnp.sum(centred**2) / real.sum())
    return centred / jnp.where(scale > 0, scale, 1)


def _kernel_modes(points, real, beta, rank):
    """Leading eigenpairs of G, by randomised subspace iteration (Halko et al. 2011)."""
    n = len(points)
    rows = _blocks(points, real)

    def times(right):
        def block(args):
            # Between distant points exp underflows to 0. It cannot overflow.
            kernel = jnp.exp(-_square(args[0], points) / (2 * beta**2))
            return matmul(kernel * args[1][:, None] * real[None], right)

        return jax.lax.map(block, rows).reshape(-1, right.shape[1])[:n]

    if rank == n:
        modes = jnp.eye(n, dtype=points.dtype)
    else:
        width = min(rank + OVERSAMPLE, n)
        # One key a row: padding does not change the numbers of the other rows.
        key = jax.random.key(0)
        draw = lambda i: jax.random.normal(
            jax.random.fold_in(key, i), (width,), points.dtype
        )
        # The barrier keeps XLA from drawing them at compile time, slowly.
        rows_drawn = jax.lax.optimization_barrier(jnp.arange(n))
        modes = jnp.linalg.qr(times(jax.vmap(draw)(rows_drawn)))[0]
        for _ in range(POWERS):
            modes = jnp.linalg.qr(times(modes))[0]
    gram = matmul(modes.T, times(modes))
    gain, turn = jnp.linalg.eigh((gram + gram.T) / 2)
    gain, turn = gain[-rank:], turn[:, -rank:]
    # An eigenvalue below rounding errors is noise. With `floor` in its place the
    # penalty of its mode is so large that it hardly moves.
    floor = jnp.finfo(points.dtype).eps * gain[-1:]
    return matmul(modes, turn) * real[:, None], jnp.maximum(gain, floor)


def _expectation(data, real_s, moved, real_c, sigma2, log_outlier):
    """Sums over samples of p, p x, p |x|^2 (p = p(m | n)) and of the log densities."""

    def block(carry, args):
        x, real = args
        _, share, log_z = _posterior(x, moved, real_c, sigma2, log_outlier)
        p = share * real[:, None]
        weight, mean, square, log_sum = carry
        square = square + jnp.sum(p.sum(1) * jnp.sum(x**2, 1))
        log_sum = log_sum + jnp.sum(log_z * real)
        return (weight + p.sum(0), mean + matmul(p.T, x), square, log_sum), None

    zero = jnp.zeros((), data.dtype)
    start = jnp.zeros(len(moved), data.dtype), jnp.zeros_like(moved), zero, zero
    return jax.lax.scan(block, start, _blocks(data, real_s))[0]


def _matches(data, real_s, moved, real_c, sigma2, log_outlier):
    def block(carry, args):
        best, at = carry
        x, real, first = args
        log_p, _, log_z = _posterior(x, moved, real_c, sigma2, log_outlier)
        # p itself may underflow; its logarithm still ranks.
        log_z = jnp.where(real > 0, log_z, jnp.inf)
        log_p = log_p - log_z[:, None]
        value, row = log_p.max(0), jnp.argmax(log_p, 0).astype(jnp.int32)
        better = value > best
        return (
            jnp.where(better, value, best),
            jnp.where(better, first + row, at),
        ), None

    start = (
        jnp.full(len(moved), -jnp.inf, data.dtype),
        jnp.zeros(len(moved), jnp.int32),
    )
    blocks = _blocks(data, real_s)
    first = jnp.arange(len(blocks[0]), dtype=jnp.int32) * ROWS
    return jax.lax.scan(block, start, (*blocks, first))[0][1]


def _posterior(
    x: Array, moved: Array, real_c: Array, sigma2: Array, log_outlier: Array
) -> tuple[Array, Array, Array]:
    """log of p(m | x) z (rows, m), p(m | x) itself, and log z, z the density at x."""
    log_p = jnp.where(real_c[None] > 0, -_square(x, moved) / (2 * sigma2), -jnp.inf)
    top = log_p.max(1)
    part = jnp.exp(log_p - top[:, None])
    log_z = jnp.logaddexp(top + jnp.log(jnp.sum(part, 1)), log_outlier)
    return log_p, part * jnp.exp(top - log_z)[:, None], log_z


def _square(x, y) -> Array:
    square = jnp.sum(x**2, 1)[:, None] + jnp.sum(y**2, 1)[None] - 2 * matmul(x, y.T)
    return jnp.maximum(square, 0)


def _blocks(points, real):
    extra = -len(points) % ROWS
    points, real = jnp.pad(points, ((0, extra), (0, 0))), jnp.pad(real, (0, extra))
    return points.reshape(-1, ROWS, points.shape[1]), real.reshape(-1, ROWS)


def _real(emb, marginal) -> tuple[Any, Any]:
    """1 for rows that are no padding and finite, and the rows, 0 elsewhere."""
    real = jnp.isfinite(emb).all(1)
    if marginal is not None:
        real &= marginal > 0
    return real.astype(emb.dtype), jnp.where(real[:, None], emb, 0)


def _check(
    name,
    one,
    other,
    weight_one,
    weight_other,
    num_iters,
    rank,
    names=("emb_x", "emb_y"),
):
    if one.ndim != 2 or other.ndim != 2 or one.shape[1] != other.shape[1]:
        raise ValueError(
            f"{name}: {names[0]} is {one.shape}, {names[1]} is {other.shape}; they "
            "must have as many columns"
        )
    for label, weight, emb in (
        (names[0], weight_one, one),
        (names[1], weight_other, other),
    ):
        if weight is not None and weight.shape != (len(emb),):
            raise ValueError(
                f"{name}: {label} has {len(emb)} rows, its marginal has shape "
                f"{weight.shape}; give one number a row"
            )
    if num_iters < 1 or rank < 1:
        raise ValueError(
            f"{name}: num_iters and rank must be positive, got {num_iters} and {rank}"
        )

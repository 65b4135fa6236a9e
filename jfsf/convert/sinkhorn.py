"""Fast Sinkhorn Filter: aligned embeddings -> maps both ways by entropic transport.

Algorithm 2 of Pai et al. (CVPR 2021), re-derived: a sparse kernel on k0 neighbours both
ways (eq. 12), Sinkhorn scaling to the marginals, row and column argmax of the plan.

Updates are over-relaxed (Thibault et al., 2017; Lehmann et al., 2021): two dozen do
what a hundred plain ones do.

In the paper's float64 the weights reach e^-500; float32 has nothing below e^-103. So
the scalings live in the log domain: the first pair of updates is a log-sum-exp, and
from then on a few bounded updates at a time, on a kernel that has absorbed the
scalings, are safe.
"""

from functools import partial
from typing import Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf import kernel as kernels
from jfsf.candidates import tiled_neighbours
from jfsf.knn import mutual_neighbours
from jfsf.sides import both
from jfsf.types import Filtered, Kernel, Neighbours, Tiles

Scale = Literal["nearest", "max"]

ABSORB_EVERY = 4  # updates
# The most that an update may change a scaling by, before relaxation: an infeasible
# marginal sends scalings to infinity, and this keeps them inside float32 on the way.
BOUND = 100.0


@partial(
    jax.jit,
    static_argnames=("k0", "num_iters", "scale", "power", "one_sided", "least"),
)
def sinkhorn(
    emb_x: Float[Array, "n_x k"],
    emb_y: Float[Array, "n_y k"],
    marginal_x: Float[Array, " n_x"] | None = None,
    marginal_y: Float[Array, " n_y"] | None = None,
    lam: Float[Array, ""] | float = 120.0,
    *,
    k0: int = 20,
    num_iters: int = 24,
    relax: Float[Array, ""] | float = 1.7,
    scale: Scale = "nearest",
    power: float = 1.0,
    one_sided: float = 1.0,
    tiles: tuple[Tiles, Tiles] | None = None,
    least: float = 0.95,
) -> Filtered:
    """Both point-to-point maps between two aligned embeddings.

    Args:
        emb_x, emb_y: rows of one Euclidean space (`fmap.embeddings`).
        marginal_x, marginal_y: mass to send from each vertex of X, to receive at each
            of Y; each sums to 1, 0 marks padding. Uniform when absent.
        lam: sharpness; the kernel is exp(-lam (d / length)^power).
        k0: neighbours a vertex, both ways. Ten cost some percent of accuracy; more
            than these change little, and above 32 the search takes twice as long.
        num_iters: updates of each side. More lower the marginal error. On shapes
            sampled differently, uniform marginals are not quite true, and ten updates
            may do better than these.
        relax: each update of a log scaling is taken this many times, in (0, 2); 1 is
            the plain algorithm. The last update is plain.
        scale: the length that lam is relative to. "nearest" is the median distance to
            the nearest neighbour, one for both directions: no outlier moves it, nor
            the size of the mesh. "max" is the largest neighbour distance of each
            direction, as in the authors' code.
        power: p of d^p.
        one_sided: weight of a pair that only one side counts among its neighbours.
        tiles: of X and of Y (`jfsf.tiles.spectral_tiles`): neighbours are searched
            among candidates, at a cost that grows like n.
        least: recall of that search below which all points are compared; 0 leaves the
            check out of the program.

    The authors' own settings are lam=500, k0=50, num_iters=11, relax=1, scale="max",
    one_sided=0.5.

    Returns:
        The maps with the plan that they are the argmax of, and its marginal error.

    Raises:
        ValueError: shapes do not fit, or an option is out of range.
    """
    _check(emb_x, emb_y, marginal_x, marginal_y, k0, num_iters, scale)
    if marginal_x is None:
        marginal_x = jnp.full(len(emb_x), 1 / len(emb_x), emb_x.dtype)
    if marginal_y is None:
        marginal_y = jnp.full(len(emb_y), 1 / len(emb_y), emb_y.dtype)
    valid_x, valid_y = marginal_x > 0, marginal_y > 0
    k0 = min(k0, len(emb_x), len(emb_y))
    if tiles is None:
        near_xy, near_yx = mutual_neighbours(emb_x, emb_y, valid_x, valid_y, k0=k0)
    else:
        found = tiled_neighbours(
            emb_x, emb_y, *tiles, valid_x, valid_y, k0=k0, least=least
        )
        near_xy, near_yx = found.near_xy, found.near_yx
    length_xy, length_yx = both(
        lambda near: _length(near, scale), (near_xy,), (near_yx,)
    )
    if scale == "nearest":
        length_xy = length_yx = jnp.sqrt(length_xy * length_yx)
    lam = jnp.asarray(lam, emb_x.dtype)
    kernel = kernels.build(
        near_xy,
        near_yx,
        lam / length_xy**power,
        lam / length_yx**power,
        power=power,
        one_sided=one_sided,
    )
    return scale_kernel(
        kernel, marginal_x, marginal_y, num_iters=num_iters, relax=relax
    )


# For the rounds of a refiner. Plain updates: these few, over-relaxed, would leave ties
# to rounding. The rounds to come mend what a search among candidates misses.
brief = partial(sinkhorn, k0=10, lam=80.0, num_iters=8, relax=1.0, least=0.0)


@partial(jax.jit, static_argnames="num_iters")
def scale_kernel(
    kernel: Kernel,
    marginal_x: Float[Array, " n_x"],
    marginal_y: Float[Array, " n_y"],
    *,
    num_iters: int = 24,
    relax: Float[Array, ""] | float = 1.7,
) -> Filtered:
    """Scale `kernel` to the marginals and read both maps off the plan.

    Args:
        kernel: entries only between vertices of positive marginal.
        marginal_x, marginal_y: each sums to 1; 0 on padding.
        num_iters: updates of each side, at least 1; Y's first, so X's sums are exact.
        relax: as in `sinkhorn`.
    """
    flipped = kernels.transpose(kernel)
    log_x = jnp.log(jnp.where(marginal_x > 0, marginal_x, 1))
    log_y = jnp.log(jnp.where(marginal_y > 0, marginal_y, 1))
    f = jnp.zeros_like(marginal_x)
    g = _minus(log_y, kernels.log_matvec(flipped, f))
    f = _minus(log_x, kernels.log_matvec(kernel, g))

    def absorbed(fg, powers):
        f, g = fg
        plan = kernels.plan(kernel, f, g)
        back = kernels.transpose(plan)

        def update(uv, power):
            u, v = uv
            v = v * _factor(marginal_y, v * kernels.matvec(back, u)) ** power
            u = u * _factor(marginal_x, u * kernels.matvec(plan, v)) ** power
            return (u, v), None

        ones = jnp.ones_like(f), jnp.ones_like(g)
        (u, v), _ = jax.lax.scan(update, ones, powers)
        return (f + jnp.log(u), g + jnp.log(v)), None

    (f, g), _ = jax.lax.scan(absorbed, (f, g), _powers(num_iters - 1, relax, f.dtype))

    (T_xy, found_x), (T_yx, found_y) = both(
        kernels.row_argmax, (kernel, g), (flipped, f)
    )
    plan = kernels.plan(kernel, f, g)
    back = kernels.transpose(plan)
    ones = jnp.ones_like(g), jnp.ones_like(f)
    rows, cols = both(kernels.matvec, (plan, ones[0]), (back, ones[1]))
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


@jax.jit
def pull_back(
    filtered: Filtered, values_y: Float[Array, "n_y c"]
) -> Float[Array, "n_x c"]:
    """Functions on Y as seen from X: each vertex averages over its row of the plan."""
    plan = kernels.plan(filtered.kernel, filtered.f, filtered.g)
    rows = kernels.matvec(plan, jnp.ones_like(filtered.g))
    found = rows > 0
    total = kernels.matvec(plan, values_y)
    return jnp.where(found[:, None], total / jnp.where(found, rows, 1)[:, None], 0)


@jax.jit
def plan_entries(filtered: Filtered):
    """The plan as (rows, columns, values), each (n_x k0 + n_y k0,); 0 where absent."""
    kernel = filtered.kernel
    plan = kernels.plan(kernel, filtered.f, filtered.g)
    n_x, n_y = len(plan.idx_xy), len(plan.idx_yx)
    own_x = jnp.broadcast_to(_column(n_x, plan.idx_xy), plan.idx_xy.shape)
    own_y = jnp.broadcast_to(_column(n_y, plan.idx_yx), plan.idx_yx.shape)
    rows = jnp.concatenate([own_x.ravel(), plan.idx_yx.ravel()])
    columns = jnp.concatenate([plan.idx_xy.ravel(), own_y.ravel()])
    return rows, columns, jnp.concatenate([plan.log_xy.ravel(), plan.log_yx.ravel()])


def _powers(num: int, relax, dtype) -> Float[Array, "rounds updates"]:
    """How far each of `num` updates goes: `relax`, but for a last one that is plain.

    Those of power 0, which fill the first round up, change nothing: rounds of one size
    are one program.
    """
    rounds = -(-num // ABSORB_EVERY)
    empty = rounds * ABSORB_EVERY - num
    slot = jnp.arange(rounds * ABSORB_EVERY)
    powers = jnp.where(slot < empty, 0, jnp.asarray(relax, dtype))
    powers = jnp.where(slot == len(slot) - 1, 1, powers)
    return powers.astype(dtype).reshape(rounds, ABSORB_EVERY)


def _column(n: int, like):
    return jnp.arange(n, dtype=like.dtype)[:, None]


def _length(near: Neighbours, scale: Scale):
    known = jnp.isfinite(near.dist)
    if scale == "max":
        length = jnp.max(jnp.where(known, near.dist, 0))
    else:
        # Shapes that coincide have nearest distance 0; 1 / lam must not follow.
        nearest, farthest = _medians(near.dist[:, (0, -1)], known[:, (0, -1)])
        length = jnp.maximum(nearest, farthest / 100)
    return jax.lax.stop_gradient(jnp.where(length > 0, length, 1))


def _medians(dist: Float[Array, "n c"], known: Array) -> Float[Array, " c"]:
    """The lower median of what is known of each column; its bits found one by one.

    Counts in place of a sort, which XLA does slowly on a CPU. Bits order numbers that
    are not negative.
    """
    integer = jnp.int32 if dist.dtype.itemsize == 4 else jnp.int64
    bits = jax.lax.bitcast_convert_type(dist, integer)
    before = (known.sum(0) - 1) // 2

    def settle(i, low):
        larger = low | (jnp.ones((), integer) << (top - i))
        smaller = jnp.sum(known & (bits < larger[None]), 0)
        return jnp.where(smaller <= before, larger, low)

    top = 8 * dist.dtype.itemsize - 2  # below the sign
    low = jnp.zeros(dist.shape[1], integer)
    found = jax.lax.fori_loop(0, top + 1, settle, low)
    return jnp.where(before < 0, 0, jax.lax.bitcast_convert_type(found, dist.dtype))


def _minus(log_marginal: Array, log_sum: Array) -> Array:
    # An empty row keeps scaling 1: it holds no entries, so nothing follows from it.
    return jnp.where(jnp.isfinite(log_sum), log_marginal - log_sum, 0)


def _factor(marginal: Array, total: Array) -> Array:
    """What brings a total to its marginal."""
    ok = (total > 0) & (marginal > 0)
    factor = jnp.where(ok, marginal / jnp.where(ok, total, 1), 1)
    return jnp.clip(factor, 1 / BOUND, BOUND)


def _check(emb_x, emb_y, marginal_x, marginal_y, k0, num_iters, scale):
    if emb_x.shape[1] != emb_y.shape[1]:
        raise ValueError(
            f"sinkhorn: emb_x has {emb_x.shape[1]} columns, emb_y {emb_y.shape[1]}"
        )
    for name, marginal, emb in (("x", marginal_x, emb_x), ("y", marginal_y, emb_y)):
        if marginal is not None and marginal.shape != (len(emb),):
            raise ValueError(
                f"sinkhorn: marginal_{name} has shape {marginal.shape}, emb_{name} has "
                f"{len(emb)} rows"
            )
    if k0 < 1 or num_iters < 1:
        raise ValueError(
            f"sinkhorn: k0 and num_iters must be positive, got {k0} and {num_iters}"
        )
    if scale not in ("nearest", "max"):
        raise ValueError(f"sinkhorn: scale is 'nearest' or 'max', not {scale!r}")

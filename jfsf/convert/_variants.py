"""The filter with other settings than its own: the paper's, its authors', a quick one.

`algorithm_2` is the paper's method to the letter, `authors_sinkhorn` what the authors'
code does, which differs from it, and `quick_sinkhorn` is for rounds of a refinement.
"""

from functools import partial

import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf.array._jit import jit
from jfsf.convert import _kernel as kernels
from jfsf.convert._checks import check_counts, check_shapes, check_values, flagged
from jfsf.convert._scaling import scale_kernel
from jfsf.convert._sinkhorn import sinkhorn, uniform_marginals
from jfsf.neighbours import NeighbourSearch
from jfsf.neighbours._among_tiles import tiled_one_way
from jfsf.neighbours._exhaustive import neighbours_of_valid
from jfsf.types import Filtered, Kernel, Neighbours

quick_sinkhorn: partial[Filtered] = partial(
    sinkhorn, k0=10, lam=80.0, num_iters=8, relax=1.0
)
# Help shows the docstring of a partial, if it has one of its own.
quick_sinkhorn.__doc__ = """`sinkhorn` with few updates, for rounds of a refinement.

The updates are plain, as so few over-relaxed ones would leave ties to rounding.
Arguments and result are those of `sinkhorn`.
"""

authors_sinkhorn: partial[Filtered] = partial(
    sinkhorn,
    lam=500.0,
    k0=50,
    num_iters=11,
    relax=1.0,
    scale="max",
    unilateral_weight=0.5,
)
authors_sinkhorn.__doc__ = """`sinkhorn` with the settings of the authors' MATLAB code.

For comparison. It differs from algorithm 2 of their paper (`algorithm_2`): distances
are not squared, neighbours are taken both ways, the kernel is the mean of one of each
direction, lam is 500 over the largest neighbour distance of that direction, and the
loop of 10 updates makes 11. Arguments and result are those of `sinkhorn`.
"""


@jit(check=partial(check_values, "algorithm_2"), static_argnames=("k0", "num_iters"))
def algorithm_2(
    emb_x: Float[Array, "n_x k"],
    emb_y: Float[Array, "n_y k"],
    marginal_x: Float[Array, " n_x"] | None = None,
    marginal_y: Float[Array, " n_y"] | None = None,
    search: NeighbourSearch | None = None,
    *,
    lam: Float[Array, ""] | float,
    k0: int = 50,
    num_iters: int = 10,
) -> Filtered:
    """Algorithm 2 of Pai et al. (CVPR 2021) as it is written, in logarithms.

    K_ij = exp(-lam d_ij^2) for the k0 neighbours j in Y of each i in X, and for no
    others; `num_iters` times v = b / (K^T u), then u = a / (K v), from a constant u;
    T_xy and T_yx are the row and column argmax of diag(u) K diag(v). It is for
    comparison: `sinkhorn` says how it differs, and finds better maps.

    A vertex of Y that is no neighbour of any of X has an empty column. The paper
    divides by 0 there. Here it receives no mass, is counted in `empty_y`, and T_yx is
    0. After the first update none changes a scaling by more than a factor of 100.

    Args:
        emb_x, emb_y: rows of one Euclidean space; the paper's are the adjoint ones of
            `jfsf.spectral.embeddings`.
        marginal_x, marginal_y: a and b, each of sum 1; 0 marks padding. Uniform when
            absent, as in the paper.
        search: how neighbours are searched; when absent, all points are compared.
        lam: over a squared length, in the unit of the embeddings: where these are
            doubled, the same kernel has a quarter of it. The paper gives no number.
        k0: neighbours of a vertex of X, or all vertices of Y if there are fewer.
        num_iters: updates of each side; N0 in the paper.

    Returns:
        As `sinkhorn`, without memberships.

    Raises:
        ValueError: shapes do not fit, or a value is out of range. Values that are
            traced cannot be checked so: the marginal error is nan then.
    """
    check_shapes("algorithm_2", emb_x, emb_y, marginal_x, marginal_y)
    check_counts("algorithm_2", k0=k0, num_iters=num_iters)
    marginal_x, marginal_y = uniform_marginals(emb_x, emb_y, marginal_x, marginal_y)
    search = NeighbourSearch() if search is None else search
    k0 = min(k0, len(emb_y))
    valid_x, valid_y = marginal_x > 0, marginal_y > 0
    if search.tiles is None:
        near = neighbours_of_valid(emb_x, emb_y, valid_x, valid_y, k0=k0)
        recall = jnp.ones((), emb_x.dtype)
    else:
        there = emb_x, emb_y, *search.tiles, valid_x, valid_y
        options = {"min_recall": search.min_recall, "settings": search.settings}
        near, recall, _ = tiled_one_way(*there, k0=k0, **options)
    kernel = build_kernel(near, lam, n_y=len(emb_y), power=2.0)
    found = scale_kernel(kernel, marginal_x, marginal_y, num_iters=num_iters, relax=1.0)
    return flagged(found._replace(recall=recall), jnp.asarray(lam) >= 0)


@jit(static_argnames=("n_y", "power", "unilateral_weight"))
def build_kernel(
    near_xy: Neighbours,
    lam_xy: Float[Array, ""] | float,
    near_yx: Neighbours | None = None,
    lam_yx: Float[Array, ""] | float | None = None,
    *,
    n_y: int | None = None,
    power: float = 1.0,
    unilateral_weight: float = 1.0,
) -> Kernel:
    """The sparse kernel K_ij = exp(-lam d_ij^power) of neighbours, for `scale_kernel`.

    With neighbours both ways its entries are the union of both, as in `sinkhorn`; with
    `near_xy` alone those of its rows, as in `algorithm_2`.

    Args:
        near_xy: (n_x, k0), neighbours in Y of each vertex of X
            (`jfsf.neighbours.neighbours`), or any others: `dist` need not be a
            distance. Each is named once in its row; index 0 at distance inf is none.
        lam_xy: factor of d^power, not relative to any length.
        near_yx: (n_y, k0), neighbours in X of each vertex of Y; None for none.
        lam_yx: factor of d^power for `near_yx`; `lam_xy` if None. Two vertices that are
            each among the other's neighbours have the mean of exp(-lam_xy d^p) and
            exp(-lam_yx d^p), with d of `near_xy`.
        n_y: vertices of Y; it has to be given where `near_yx` is not.
        power: p of d^p.
        unilateral_weight: with `near_yx`, factor of an entry whose vertices are
            neighbours in one direction only.

    Returns:
        The kernel: (n_x, k0) and (n_y, k0) entries, the latter (n_y, 1) and empty
        without `near_yx`.

    Raises:
        ValueError: n_y is absent, or is not the number of rows of `near_yx`.
    """
    dtype = near_xy.dist.dtype
    lam_xy = jnp.asarray(lam_xy, dtype)
    lam_yx = lam_xy if lam_yx is None else jnp.asarray(lam_yx, dtype)
    if near_yx is None:
        if n_y is None:
            raise ValueError("build_kernel: near_yx is None; give n_y, the points of Y")
        # So that no entry is found both ways, and each has its own weight.
        none = jnp.zeros((n_y, 1), near_xy.idx.dtype)
        near_yx = Neighbours(none, jnp.full((n_y, 1), jnp.inf, dtype))
        unilateral_weight = 1.0
    elif n_y is not None and n_y != len(near_yx.idx):
        raise ValueError(
            f"build_kernel: n_y is {n_y}, near_yx has {len(near_yx.idx)} rows"
        )
    weight = {"power": power, "unilateral_weight": unilateral_weight}
    return kernels.build(near_xy, near_yx, lam_xy, lam_yx, **weight)

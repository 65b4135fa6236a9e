"""Fast Sinkhorn Filter: aligned embeddings -> maps both ways by entropic transport.

Algorithm 2 of Pai et al. (CVPR 2021), re-derived: a sparse kernel on k0 neighbours,
here those both ways, Sinkhorn scaling to the marginals, row and column argmax of the
plan. With a `reach` mass without a partner may go: unbalanced entropic transport
(Chizat et al., Math. Comp. 2018) on the same kernel.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf.array._jit import jit
from jfsf.array._loops import map_sides
from jfsf.array._precision import safe_divide
from jfsf.convert import _kernel as kernels
from jfsf.convert._checks import check_counts, check_shapes, check_values, flagged
from jfsf.convert._scaling import scale_kernel
from jfsf.convert._updates import sums
from jfsf.neighbours import NeighbourSearch
from jfsf.neighbours._both_ways import neighbours_both_ways
from jfsf.types import Filtered, Kernel


class KernelAndMarginals(NamedTuple):
    """The kernel of two embeddings, the marginals, and the recall of the search."""

    kernel: Kernel
    marginal_x: Float[Array, " n_x"]
    marginal_y: Float[Array, " n_y"]
    recall: Float[Array, ""]


def kernel_between(
    emb_x: Array,
    emb_y: Array,
    marginal_x: Array | None,
    marginal_y: Array | None,
    search: NeighbourSearch | None,
    lam: Array | float,
    *,
    k0: int,
    scale: kernels.Scale,
    length_gradient: bool,
    power: float,
    unilateral_weight: float,
) -> KernelAndMarginals:
    """The kernel of eq. 12, and uniform marginals where there are none."""
    marginal_x, marginal_y = uniform_marginals(emb_x, emb_y, marginal_x, marginal_y)
    valid_x, valid_y = marginal_x > 0, marginal_y > 0
    k0 = min(k0, len(emb_x), len(emb_y))
    near_both = neighbours_both_ways(emb_x, emb_y, valid_x, valid_y, search, k0=k0)
    near_xy, near_yx = near_both.near_xy, near_both.near_yx
    length_xy, length_yx = map_sides(
        lambda near: kernels.length(near, scale, length_gradient),
        (near_xy,),
        (near_yx,),
    )
    # In this unit neither lengths times each other nor their powers leave the range of
    # the type; it is a power of two, so nothing is rounded.
    exponent = jnp.frexp(jax.lax.stop_gradient(length_xy))[1]
    unit = jnp.ldexp(jnp.ones_like(length_xy), exponent)
    near_xy, near_yx = (n._replace(dist=n.dist / unit) for n in (near_xy, near_yx))
    length_xy, length_yx = length_xy / unit, length_yx / unit
    if scale == "nearest":
        length_xy = length_yx = jnp.sqrt(length_xy * length_yx)
    lam = jnp.asarray(lam, emb_x.dtype)
    kernel = kernels.build(
        near_xy,
        near_yx,
        lam / length_xy**power,
        lam / length_yx**power,
        power=power,
        unilateral_weight=unilateral_weight,
    )
    return KernelAndMarginals(kernel, marginal_x, marginal_y, near_both.recall)


def uniform_marginals(
    emb_x: Array, emb_y: Array, marginal_x: Array | None, marginal_y: Array | None
) -> tuple[Array, Array]:
    """The marginals, uniform where there are none."""
    if marginal_x is None:
        marginal_x = jnp.full(len(emb_x), 1 / len(emb_x), emb_x.dtype)
    if marginal_y is None:
        marginal_y = jnp.full(len(emb_y), 1 / len(emb_y), emb_y.dtype)
    return marginal_x, marginal_y


# Slack (entropy over reach) beyond which the plan is the kernel times both marginals,
# to a thousandth of its log.
MOST_SLACK = 1e3


@jit(
    check=partial(check_values, "sinkhorn"),
    static_argnames=(
        "k0",
        "num_iters",
        "max_iters",
        "scale",
        "length_gradient",
        "power",
        "unilateral_weight",
    ),
)
def sinkhorn(
    emb_x: Float[Array, "n_x k"],
    emb_y: Float[Array, "n_y k"],
    marginal_x: Float[Array, " n_x"] | None = None,
    marginal_y: Float[Array, " n_y"] | None = None,
    search: NeighbourSearch | None = None,
    *,
    reach: Float[Array, ""] | float | None = None,
    lam: Float[Array, ""] | float = 120.0,
    k0: int = 20,
    num_iters: int = 24,
    relax: Float[Array, ""] | float = 1.7,
    tol: Float[Array, ""] | float | None = None,
    max_iters: int = 10_000,
    scale: kernels.Scale = "nearest",
    length_gradient: bool = False,
    power: float = 1.0,
    unilateral_weight: float = 1.0,
) -> Filtered:
    """Both point-to-point maps between two aligned embeddings.

    The Fast Sinkhorn Filter after Pai et al. (CVPR 2021): the kernel
    K_ij = exp(-lam (d_ij / length)^p) between neighbours, d_ij = |x_i - y_j| (eq. 10),
    scaled to the plan P = diag(u) K diag(v) of given marginals (eq. 11).
    T_xy[i] = argmax_j P_ij and T_yx[j] = argmax_i P_ij.

    It differs from their eq. 12 and algorithm 2 (`algorithm_2` is these to the letter):

    - `power` is 1, theirs 2: exp(-lam d^2), with 1 / lam in eq. 12;
    - neighbours are the union of those both ways, theirs k0 of each vertex of X;
    - `lam` is relative to a length of the data (`scale`), theirs has a unit;
    - updates are over-relaxed (`relax`) but for the first and the last, which are
      plain; all of theirs are plain.

    With a `reach`, shapes need to share only a part. With a, b the marginals and
    M_ij = (d_ij / length)^p, the plan P is then the minimum of

        <P, M> + eps KL(P | a b^T) + rho KL(P 1 | a) + rho KL(P^T 1 | b)

    on the entries of K, with eps = 1 / lam and rho = reach^p. It is
    P = diag(u) K diag(v) with u = a (K v)^-t and v = b (K^T u)^-t, t = rho / (rho +
    eps), and the result says what share of its mass each vertex keeps.

    Args:
        emb_x, emb_y: rows of one Euclidean space (`jfsf.spectral.embeddings`).
        marginal_x, marginal_y: the mass that each vertex of X sends, and that each
            vertex of Y receives. Each sums to 1, and 0 marks padding; uniform when
            absent. With `reach` their sums may differ: if Y is half of X, give both the
            same mass per unit of area, since a vertex keeps all of its mass only if its
            partners have as much.
        search: how neighbours are searched; when absent, all points are compared.
        reach: None for plans that meet the marginals; otherwise a distance above 0, in
            units of the length, beyond which mass is dropped. 3 is a good start. If two
            points of mass m at distance d have only each other, each keeps the share

            exp(-(d^power + log(1 / m) / lam) / (2 reach^power + 1 / lam)),

            61 % at the distance `reach` if lam is large. inf is the same as None.
        lam: sharpness; the kernel is exp(-lam (d / length)^power).
        k0: neighbours of each vertex, in both directions. With 10 the error is some
            per cent larger; more than 20 change little, and above 32 the search takes
            twice as long.
        num_iters: updates of each side. More updates lower the marginal error. On
            shapes that are sampled differently, uniform marginals are not quite right,
            and ten updates may give better maps.
        relax: factor of each update of a log scaling, in (0, 2); 1 is the plain
            algorithm. The last update is plain.
        tol: marginal error to reach, in place of a fixed number of updates, by at most
            `max_iters` of them; see `Filtered.converged`. Derivatives are then those of
            the plan that meets the marginals exactly (the implicit function theorem),
            and take memory that does not depend on the number of updates.
        max_iters: with `tol`, the most updates of each side, beside two more and those
            that complete the last round of four. Updates end earlier if the error no
            longer falls: k0 neighbours may be too few to carry the mass, above all with
            marginals that are not uniform.
        scale: the length that lam is relative to. "nearest" is the median distance to
            the nearest neighbour, one for both directions. It does not depend on
            outliers, nor on the size of the mesh. "max" is the largest neighbour
            distance of each direction, as in the authors' code.
        length_gradient: whether derivatives include that of this length; by default it
            counts as constant. Which vertices are neighbours always does.
        power: the exponent p of the distance.
        unilateral_weight: factor of an entry whose vertices are neighbours in one
            direction only.

    `authors_sinkhorn` has the settings of the authors' code, which follows neither
    eq. 12 nor algorithm 2.

    Returns:
        The maps with the plan that they are the argmax of, and its marginal error. With
        `reach` that error is the l1 gap of the plan's sums from those of the best plan
        for the same scalings, a exp(-(f - log a) / (lam reach^power)), as a fraction of
        all mass; 0 at the optimum.

    Raises:
        ValueError: shapes do not fit, or a value is out of range. Values that are
            traced cannot be checked so: the marginal error is nan then.
    """
    num = min(num_iters, max_iters)
    check_shapes("sinkhorn", emb_x, emb_y, marginal_x, marginal_y)
    check_counts("sinkhorn", k0=k0, num_iters=num)
    if scale not in ("nearest", "max"):
        raise ValueError(f"sinkhorn: scale is 'nearest' or 'max', not {scale!r}")
    if power <= 0 or unilateral_weight < 0:
        raise ValueError(
            f"sinkhorn: power is {power} and unilateral_weight {unilateral_weight}; "
            "give more than 0, and 0 or more"
        )
    kernel, marginal_x, marginal_y, recall = kernel_between(
        emb_x,
        emb_y,
        marginal_x,
        marginal_y,
        search,
        lam,
        k0=k0,
        scale=scale,
        length_gradient=length_gradient,
        power=power,
        unilateral_weight=unilateral_weight,
    )
    slack = None if reach is None else _slack(reach, lam, power, emb_x.dtype)
    filtered = scale_kernel(
        kernel,
        marginal_x,
        marginal_y,
        slack,
        num_iters=num_iters,
        relax=relax,
        tol=tol,
        max_iters=max_iters,
    )
    filtered = flagged(filtered._replace(recall=recall), jnp.asarray(lam) >= 0)
    if reach is None:
        return filtered
    kept_x, kept_y = sums(kernel, filtered.f, filtered.g)
    return filtered._replace(
        membership_x=jnp.minimum(safe_divide(kept_x, marginal_x), 1),
        membership_y=jnp.minimum(safe_divide(kept_y, marginal_y), 1),
    )


def _slack(reach, lam, power: float, dtype) -> Array:
    """eps / rho; nan for a reach that is not above 0, which would mean nothing."""
    reach, lam = (jnp.asarray(value, dtype) for value in (reach, lam))
    slack = (1 / reach) ** power / lam  # finite derivatives where reach is inf
    return jnp.where(reach > 0, jnp.minimum(slack, MOST_SLACK), jnp.nan)

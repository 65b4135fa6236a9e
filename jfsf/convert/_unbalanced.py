"""Unbalanced filter: as the Fast Sinkhorn Filter, but mass without a partner may go.

Unbalanced entropic transport (Chizat et al., Math. Comp. 2018) on the sparse kernel of
eq. 12 of Pai et al. (CVPR 2021): the plan's sums are drawn to the marginals, and need
not meet them.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jfsf.array._jit import jit
from jfsf.array._precision import safe_divide
from jfsf.convert._scaling import scale as scale_to_targets
from jfsf.convert._sinkhorn import Scale, check, kernel_between
from jfsf.convert._updates import sums
from jfsf.neighbours import NeighbourSearch
from jfsf.types import Filtered

# Beyond it the plan is the kernel times both marginals, to a thousandth of its log.
MOST_SLACK = 1e3


class Unbalanced(NamedTuple):
    """What the unbalanced filter returns.

    filtered: maps, plan and kernel, for `plan`, `pull_back` and `plan_entries`. Its
        marginal error is the l1 gap of the plan's sums from those of the best plan for
        the same scalings, marginal_x exp(-(f - log marginal_x) / (lam reach^power)); 0
        at the optimum, as a fraction of all mass.
    membership_x, membership_y: the mass that each point keeps, as a share of its
        marginal, at most 1; 0 on padding, and for a point that no mass can reach.
    """

    filtered: Filtered
    membership_x: Float[Array, " n_x"]
    membership_y: Float[Array, " n_y"]

    @property
    def T_xy(self) -> Int[Array, " n_x"]:
        """The vertex of Y for each vertex of X, whatever it keeps."""
        return self.filtered.T_xy

    @property
    def T_yx(self) -> Int[Array, " n_y"]:
        """The vertex of X for each vertex of Y, whatever it keeps."""
        return self.filtered.T_yx


@jit(
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
def unbalanced_sinkhorn(
    emb_x: Float[Array, "n_x k"],
    emb_y: Float[Array, "n_y k"],
    marginal_x: Float[Array, " n_x"] | None = None,
    marginal_y: Float[Array, " n_y"] | None = None,
    search: NeighbourSearch | None = None,
    *,
    reach: Float[Array, ""] | float = 3.0,
    lam: Float[Array, ""] | float = 120.0,
    k0: int = 20,
    num_iters: int = 24,
    relax: Float[Array, ""] | float = 1.7,
    tol: Float[Array, ""] | float | None = None,
    max_iters: int = 10_000,
    scale: Scale = "nearest",
    length_gradient: bool = False,
    power: float = 1.0,
    unilateral_weight: float = 1.0,
) -> Unbalanced:
    """Both maps between two aligned embeddings, and which points have a partner.

    With a, b the marginals and C_ij = (d_ij / length)^power, the plan P is the minimum
    of

        <P, C> + eps KL(P | a b^T) + rho KL(P 1 | a) + rho KL(P^T 1 | b)

    on the entries of the kernel K = exp(-C / eps) of `sinkhorn`, with eps = 1 / lam and
    rho = reach^power. It is P = diag(u) K diag(v) with u = a (K v)^-t and
    v = b (K^T u)^-t, t = rho / (rho + eps).

    Args:
        emb_x, emb_y: rows of one Euclidean space (`jfsf.spectral.embeddings`).
        marginal_x, marginal_y: mass of each vertex, 0 on padding; uniform when absent.
            Their sums may differ. A point keeps all of its mass only if its partners
            have as much: where Y is half of X, give both the same mass a unit of area,
            not 1 in all. With 1 each the plan's sums are between both.
        search: how neighbours are searched; when absent, all points are compared.
        reach: a distance, in units of the length, above 0. Of two points of mass m at
            distance d that have only each other, each keeps the share

            exp(-(d^power + log(1 / m) / lam) / (2 reach^power + 1 / lam)),

            61 % at the distance `reach` if lam is large. inf is the filter `sinkhorn`.
        tol: marginal error to reach, in place of a fixed number of updates, by at most
            `max_iters` of them. Derivatives are then those of the optimum, by the
            implicit function theorem.
        lam, k0, num_iters, relax, max_iters, scale, length_gradient, power,
        unilateral_weight: as in `sinkhorn`.

    Returns:
        The maps with their plan, and the membership of each point.

    Raises:
        ValueError: shapes do not fit, or an option is out of range.
    """
    num = min(num_iters, max_iters)
    check("unbalanced_sinkhorn", emb_x, emb_y, marginal_x, marginal_y, k0, num, scale)
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
    reach, lam = (jnp.asarray(value, emb_x.dtype) for value in (reach, lam))
    filtered = scale_to_targets(
        kernel,
        marginal_x,
        marginal_y,
        _slack(reach, lam, power),
        num_iters=num_iters,
        relax=relax,
        tol=tol,
        max_iters=max_iters,
    )
    kept_x, kept_y = sums(kernel, filtered.f, filtered.g)
    return Unbalanced(
        filtered._replace(recall=recall),
        jnp.minimum(safe_divide(kept_x, marginal_x), 1),
        jnp.minimum(safe_divide(kept_y, marginal_y), 1),
    )


def _slack(reach: Array, lam: Array, power: float) -> Array:
    """eps / rho; nan for a reach that is not above 0, which would mean nothing."""
    slack = (1 / reach) ** power / lam  # finite derivatives where reach is inf
    return jnp.where(reach > 0, jnp.minimum(slack, MOST_SLACK), jnp.nan)

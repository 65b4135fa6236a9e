"""The sparse kernel <-> ott-jax's geometry, and its potentials.

Ours is the plan diag(exp f) K diag(exp g). ott's is exp((f + g - cost) / epsilon), so
cost = -epsilon log K, and its potentials, in the unit of the cost, are epsilon times
ours. K = exp(-lam d^p): with epsilon = 1 / lam the cost is d^p. Any other epsilon gives
the same plan.
"""

from typing import TYPE_CHECKING, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf.apps.interop._packages import need
from jfsf.types import Kernel

if TYPE_CHECKING:
    from ott.geometry.geometry import Geometry


class Potentials(NamedTuple):
    """f of X and g of Y. The plan stays the same if f + c and g - c replace them."""

    f: Float[Array, " n_x"]
    g: Float[Array, " n_y"]


def to_ott(kernel: Kernel, *, epsilon: Float[Array, ""] | float = 1.0) -> "Geometry":
    """ott's Geometry with the kernel's costs, rows X and columns Y.

    ott has no sparse costs: this one is dense, (n_x, n_y), and inf where the kernel has
    no entry, so it is for small problems (5000 vertices each take 100 MB in float32).
    ott's potentials, plans and regularised cost are finite; its `primal_cost` is not,
    because it multiplies 0 by inf.

    Args:
        kernel: `Filtered.kernel`, or one of your own.
        epsilon: ott's; see the module.

    Raises:
        ImportError: ott-jax is missing; the message says how to install it.
        ValueError: a batch of kernels.
    """
    geometry = need("ott.geometry.geometry", "ott-jax")
    idx_xy, log_xy, idx_yx, log_yx = (jnp.asarray(a) for a in kernel)
    if idx_xy.ndim != 2 or idx_yx.ndim != 2:
        raise ValueError(
            f"to_ott: the kernel's halves are {idx_xy.shape} and {idx_yx.shape}; pass "
            "one kernel, or vmap over them"
        )
    n_x, n_y = len(idx_xy), len(idx_yx)
    epsilon = jnp.asarray(epsilon, log_xy.dtype)
    cost = jnp.full((n_x, n_y), jnp.inf, log_xy.dtype)
    # An absent entry has index 0 and cost inf, which leaves what is there.
    cost = cost.at[jnp.arange(n_x)[:, None], idx_xy].min(-epsilon * log_xy)
    cost = cost.at[idx_yx, jnp.arange(n_y)[:, None]].min(-epsilon * log_yx)
    return geometry.Geometry(cost, epsilon=epsilon)


def from_ott(f: Array, g: Array, geometry: "Geometry") -> Potentials:
    """Our log scalings of ott's potentials: `filtered._replace(f=f, g=g)` takes them.

    Args:
        f, g: (n_x,) and (n_y,), in the unit of the cost, such as the solution's `f` and
            `g`. -inf, which ott gives to a point without mass, becomes our 0.
        geometry: whose rows are X and whose columns are Y, such as that of `to_ott`.

    Raises:
        ValueError: sizes do not fit.
    """
    _check("from_ott", f, g, geometry)
    f, g = (jnp.asarray(values) / geometry.epsilon for values in (f, g))
    return Potentials(*(jnp.where(jnp.isfinite(v), v, 0) for v in (f, g)))


def potentials_to_ott(f: Array, g: Array, geometry: "Geometry") -> Potentials:
    """ott's potentials of our log scalings, in the unit of the geometry's cost.

    Args:
        f, g: `Filtered.f` and `Filtered.g`.
        geometry: as in `from_ott`.

    Raises:
        ValueError: sizes do not fit.
    """
    _check("potentials_to_ott", f, g, geometry)
    return Potentials(*(jnp.asarray(v) * geometry.epsilon for v in (f, g)))


def _check(function, f, g, geometry):
    if (*jnp.shape(f), *jnp.shape(g)) != geometry.shape:
        raise ValueError(
            f"{function}: f is {jnp.shape(f)} and g is {jnp.shape(g)}, the geometry is "
            f"{geometry.shape} (X, Y)"
        )

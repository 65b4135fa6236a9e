"""All maps of a collection at once: functional maps to one template.

The functional maps of the pairs disagree round cycles. Those of each shape to the
template, Z_i, are asked to agree with all of them: the energy is

    sum over pairs (i, j) of w_ij (|C_ji Z_j - Z_i|^2 + |C_ij Z_i - Z_j|^2),

with Z = I at the template. It is that of Wang, Huang and Guibas (2013, "Image
co-segmentation via consistent functional maps", equation 5), with one shape held fixed.
Each Z_i then is a mean over all ways from the template to the shape, and maps through
the template are consistent by construction.
"""

import jax.numpy as jnp
from jax.scipy.sparse.linalg import cg
from jaxtyping import Array, Float, Int

from jfsf.array import matmul
from jfsf.array._jit import jit


@jit(static_argnames=("num_shapes", "max_steps", "tolerance"))
def synchronise(
    edges: Int[Array, "e 2"],
    Cs_yx: Float[Array, "e k k"],
    Cs_xy: Float[Array, "e k k"],
    weight: Float[Array, " e"],
    template: Int[Array, ""],
    *,
    num_shapes: int,
    max_steps: int = 200,
    tolerance: float = 1e-4,
) -> Float[Array, "s k k"]:
    """Functional maps of functions on the template, pulled back to each shape.

    Args:
        edges: numbers of X and Y of each pair.
        Cs_yx: functions on Y pulled back to X (from T_xy); Cs_xy: the other way.
        weight: how much each pair counts, 0 for none: padding.
        template: the number of the shape.
        num_shapes: s.
        max_steps: steps of conjugate gradients.
        tolerance: relative residual at which they stop.

    Returns:
        Z of each shape: coefficients on the shape of the template's eigenfunctions,
        (shape, its function, template's function); 0 where no pair reaches a shape.
    """
    x, y = edges[:, 0], edges[:, 1]
    k = Cs_yx.shape[1]
    w = weight[:, None, None]
    free = (jnp.arange(num_shapes) != template)[:, None, None]
    fixed = jnp.where(free, 0, jnp.eye(k, dtype=Cs_yx.dtype)[None])

    def gradient(Z):
        """Half of that of the energy."""
        at_x = matmul(Cs_yx, Z[y]) - Z[x]
        at_y = matmul(Cs_xy, Z[x]) - Z[y]
        to_x = w * (matmul(jnp.swapaxes(Cs_xy, 1, 2), at_y) - at_x)
        to_y = w * (matmul(jnp.swapaxes(Cs_yx, 1, 2), at_x) - at_y)
        total = jnp.zeros_like(Z).at[x].add(to_x).at[y].add(to_y)
        return jnp.where(free, total, 0)

    right = -gradient(fixed)
    # A few heavy pairs should not set the pace of all.
    degree = jnp.zeros(num_shapes, weight.dtype).at[x].add(weight).at[y].add(weight)
    inverse = jnp.where(degree > 0, 1 / jnp.maximum(degree, 1e-12), 0)[:, None, None]
    Z, _ = cg(
        lambda Z: gradient(jnp.where(free, Z, 0)),
        right,
        M=lambda Z: inverse * Z,
        tol=tolerance,
        maxiter=max_steps,
    )
    return jnp.where(free, jnp.asarray(Z), fixed)

"""Products in full float32 precision, and division that leaves out 0.

By default accelerators round the factors of a float32 product: an NVIDIA GPU to TF32
and a TPU to bfloat16, with 10 and 7 bits of fraction. Neighbours, plans and functional
maps need all 23. On a CPU the precision changes nothing.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

HIGHEST = jax.lax.Precision.HIGHEST

matmul = partial(jnp.matmul, precision=HIGHEST)
matmul.__doc__ = "`jax.numpy.matmul` in full float32 precision on every device."
einsum = partial(jnp.einsum, optimize="optimal", precision=HIGHEST)
einsum.__doc__ = "`jax.numpy.einsum` in full float32 precision, in the best order."


def safe_divide(
    numerator: Float[Array, "*#shape"] | float, denominator: Float[Array, "*#shape"]
) -> Float[Array, "*shape"]:
    """numerator / denominator, and 0 where the denominator is not above 0.

    The derivative there is 0 too, never nan.
    """
    positive = denominator > 0
    ratio = numerator / jnp.where(positive, denominator, 1)
    return jnp.where(positive, ratio, 0)

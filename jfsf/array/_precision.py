"""Products in full float32 precision, division that leaves out 0, largest entries.

By default accelerators round the factors of a float32 product: an NVIDIA GPU to TF32
and a TPU to bfloat16, with 10 and 7 bits of fraction. Neighbours, plans and functional
maps need all 23. On a CPU the precision changes nothing.

Indices of the largest entries are found by plain maxima: on a CPU, XLA vectorises a
maximum but neither argmax nor top_k.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jfsf.array._loops import varying_as

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


TOP_K_LIMIT = (
    32  # above this k0, one jax.lax.top_k is faster than a pass for each entry
)
TINY = 1e-30  # scores above -TINY become -TINY: 0 has no bits to hold an index


def argmax(score: Float[Array, "..."], axis: int) -> Int[Array, "..."]:
    """Index along `axis` of the largest entry, the first among equals.

    It is a maximum followed by a minimum over indices. Where an entry is nan, the
    result is the last index.
    """
    largest = score == score.max(axis, keepdims=True)
    index = jax.lax.broadcasted_iota(jnp.int32, score.shape, axis)
    # No entry equals a maximum of nan.
    return jnp.where(largest, index, score.shape[axis] - 1).min(axis)


def top_k(score: Float[Array, "c r"], k0: int, folds: int = 1) -> Int[Array, "k0 r"]:
    """Row indices of the k0 largest entries in each column, the largest first.

    Each of k0 passes takes the largest entry below the previous one. The row index
    replaces the last bits of each entry, so entries whose relative difference is below
    about c / 2^23 come in any order. k0 = 1 and k0 above `TOP_K_LIMIT` are exact.

    Args:
        score: finite, float32, and at most 0 up to rounding, such as squared distances
            times -1/2: entries near 0 then lose the least.
        folds: a divisor of c, at most c / k0. Rows i, i + c / folds, i + 2 c / folds,
            ... form a bin, and only the largest entry of each bin is considered. For
            k0 = 1 and above `TOP_K_LIMIT` all entries are.
    """
    if k0 == 1:
        return argmax(score, 0)[None]
    if k0 > TOP_K_LIMIT:
        return jax.lax.top_k(score.T, k0)[1].T
    size = 1 << (len(score) - 1).bit_length()
    index = jax.lax.broadcasted_iota(jnp.int32, score.shape, 0)
    key = with_index(score, index, size)
    key = key.reshape(folds, -1, *key.shape[1:]).max(0)

    def next_largest(previous, _):
        largest = jnp.where(key < previous[None], key, -jnp.inf).max(0)
        return largest, largest

    start = varying_as(jnp.zeros(key.shape[1], key.dtype), key)
    _, keys = jax.lax.scan(next_largest, start, length=k0)
    return jax.lax.bitcast_convert_type(keys, jnp.int32) & (size - 1)


def with_index(score: Float[Array, "..."], index: Int[Array, "..."], size: int):
    """`score`, as for `top_k`, its last bits replaced by an index below `size`.

    `size` is a power of two.
    """
    score = jnp.minimum(score, -TINY)
    bits = jax.lax.bitcast_convert_type(score, jnp.int32) & -size
    return jax.lax.bitcast_convert_type(bits | index, jnp.float32)

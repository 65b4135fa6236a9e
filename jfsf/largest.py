"""Where the largest of many numbers stand, by plain maxima.

XLA vectorises these on a CPU, and neither argmax nor top_k.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

FEW = 32  # of more than this, top_k takes less than a pass for each
TINY = 1e-30  # above what counts as 0, with or without its last bits


def leader(score: Float[Array, "..."], axis: int) -> Int[Array, "..."]:
    """Where along `axis` the largest entry stands, the first of equals.

    Two plain reductions vectorise where argmax and top_k do not.
    """
    best = score == score.max(axis, keepdims=True)
    place = jax.lax.broadcasted_iota(jnp.int32, score.shape, axis)
    # The last where nothing is best, as with nan.
    return jnp.where(best, place, score.shape[axis] - 1).min(axis)


def leaders(score: Float[Array, "c r"], k0: int, folds: int = 1) -> Int[Array, "k0 r"]:
    """Where in each column the k0 largest entries stand, the largest first.

    Each of k0 passes takes the largest entry below the last one: plain maxima, which
    vectorise where top_k does not. Places replace the last bits, so entries that differ
    by less than c / 2^23 of themselves come in any order.

    Args:
        score: float32, finite, below 0 but for rounding, such as squared distances
            times -1/2: what is near 0 loses the least.
        folds: a divisor of c, at most c / k0; entries i, i + c / folds, i + 2 c / folds
            ... share a bin, of which only the largest counts. Above `FEW` none do.
    """
    if k0 == 1:
        return leader(score, 0)[None]
    if k0 > FEW:
        return jax.lax.top_k(score.T, k0)[1].T
    size = 1 << (len(score) - 1).bit_length()
    key = _with_places(score, 0, size)
    key = key.reshape(folds, -1, *key.shape[1:]).max(0)

    def following(last, _):
        largest = jnp.where(key < last[None], key, -jnp.inf).max(0)
        return largest, largest

    start = jnp.zeros(key.shape[1], key.dtype)
    _, found = jax.lax.scan(following, start, length=k0)
    return jax.lax.bitcast_convert_type(found, jnp.int32) & (size - 1)


def best_with_place(score: Float[Array, "..."], axis: int):
    """Largest along `axis`, a power of two long; its place replaces the last bits."""
    return _with_places(score, axis, score.shape[axis]).max(axis)


def _with_places(score: Float[Array, "..."], axis: int, size: int):
    """Each with its place along `axis` for its last bits; size: a power of two."""
    # What counts as 0 would lose its place.
    score = jnp.minimum(score, -TINY)
    place = jax.lax.broadcasted_iota(jnp.int32, score.shape, axis)
    bits = jax.lax.bitcast_convert_type(score, jnp.int32) & -size
    return jax.lax.bitcast_convert_type(bits | place, jnp.float32)

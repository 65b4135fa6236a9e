"""Where the search starts: sign patterns, fits to descriptors, and flips."""

from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jfsf.initial._linear import solve
from jfsf.initial._samples import SearchSamples
from jfsf.initial._settings import FIT_KS, FIT_WEIGHTS
from jfsf.initial._terms import combine


def fits(
    x: SearchSamples, y: SearchSamples, sign: Array | int
) -> Float[Array, "f k k"]:
    """Functional maps by fits to descriptors, cut to the size that refinement needs."""
    dtype, size = x.fit.coef.dtype, FIT_KS[0]
    sign = jnp.asarray(jnp.where(jnp.asarray(sign) < 0, -1, 1))
    weights = [w._replace(orientation=sign * w.orientation) for w in FIT_WEIGHTS]
    stacked = jax.tree.map(lambda *w: jnp.asarray(w, dtype), *weights)
    C_yx = jax.lax.map(lambda w: solve(combine(x.fit, y.fit, w)).C_yx, stacked)
    return C_yx[:, :size, :size]


def sign_patterns(functions: int) -> np.ndarray:
    """Diagonal maps of all signs but that of the constant."""
    patterns = product((1, -1), repeat=functions - 1)
    return np.stack([np.diag((1, *pattern)) for pattern in patterns])


def flips(first: int, end: int) -> np.ndarray:
    """Rows of signs: none flipped, then each of `first` to `end` - 1."""
    rows = np.ones((1 + end - first, end))
    rows[np.arange(1, len(rows)), np.arange(first, end)] = -1
    return rows

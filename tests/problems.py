"""Two samples of a surface, marginals, and the plan between them as an array."""

import jax.numpy as jnp
import numpy as np

from jfsf.convert._scaling import plan_entries

N_X, N_Y, WIDTH = 23, 31, 3


def draw(seed=0, n_x=N_X, n_y=N_Y, dtype=jnp.float64):
    """One smooth surface, sampled twice."""
    rng = np.random.default_rng(seed)
    waves = rng.normal(size=(2, WIDTH)) * 2
    return [
        jnp.asarray(np.sin(rng.uniform(-1, 1, (n, 2)) @ waves), dtype)
        for n in (n_x, n_y)
    ]


def weights(seed, n, low=0.2, total=1.0):
    """Random marginals with this sum."""
    found = np.random.default_rng(seed).uniform(low, 1, n)
    return jnp.asarray(total * found / found.sum())


def dense(found):
    """The plan (n_x, n_y); adding repeated entries, of which there are none."""
    filtered = getattr(found, "filtered", found)
    rows, columns, values = map(np.asarray, plan_entries(filtered))
    out = np.zeros((len(filtered.T_xy), len(filtered.T_yx)))
    np.add.at(out, (rows, columns), values)
    return out

"""Two samples of a surface, marginals, and the plan between them as an array."""

import jax.numpy as jnp
import numpy as np

from jfsf.convert import sinkhorn
from jfsf.convert._scaling import plan_entries

N_X, N_Y, WIDTH = 23, 31, 3
K0, NUM = 5, 20
FULL = max(N_X, N_Y)


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


def filtered(emb_x, emb_y, marginal_x=None, marginal_y=None, **options):
    """`sinkhorn` with few neighbours and updates.

    All that the tests vary is given in every call, so that calls with equal sizes and
    static options share a program: to compile one takes seconds.
    """
    if marginal_x is None:
        marginal_x = jnp.full(len(emb_x), 1 / len(emb_x), emb_x.dtype)
    if marginal_y is None:
        marginal_y = jnp.full(len(emb_y), 1 / len(emb_y), emb_y.dtype)
    plain = {"k0": K0, "num_iters": NUM, "lam": 120.0, "relax": 1.7}
    plain |= {"scale": "nearest", "unilateral_weight": 1.0, "power": 1.0}
    return sinkhorn(emb_x, emb_y, marginal_x, marginal_y, **(plain | options))


def dense(found):
    """The plan (n_x, n_y); adding repeated entries, of which there are none."""
    filtered = getattr(found, "filtered", found)
    rows, columns, values = map(np.asarray, plan_entries(filtered))
    out = np.zeros((len(filtered.T_xy), len(filtered.T_yx)))
    np.add.at(out, (rows, columns), values)
    return out

"""What the filter and its steps refuse: shapes that do not fit, values out of range."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from jfsf.neighbours._exhaustive import check_point_sets
from jfsf.types import ArrayLike, Filtered

# How far the sum of a marginal may be from 1: rounding of a million in float32.
SUM_SLACK = 1e-3


def check_shapes(
    function: str,
    emb_x: Array,
    emb_y: Array,
    marginal_x: Array | None,
    marginal_y: Array | None,
) -> None:
    """ValueError in the name of `function` unless these arrays fit each other."""
    check_point_sets(function, emb_x=emb_x, emb_y=emb_y)
    for name, marginal, emb in (("x", marginal_x, emb_x), ("y", marginal_y, emb_y)):
        if marginal is not None and marginal.shape != (len(emb),):
            raise ValueError(
                f"{function}: marginal_{name} has shape {marginal.shape}, emb_{name} "
                f"has {len(emb)} rows"
            )


def check_counts(function: str, **counts: int) -> None:
    """ValueError in the name of `function` unless all are whole numbers from 1 up."""
    for name, number in counts.items():
        if not isinstance(number, int) or number < 1:
            raise ValueError(
                f"{function}: {name} is {number}; give a whole number, 1 or more"
            )


def check_values(
    function: str,
    *,
    marginal_x: ArrayLike = None,
    marginal_y: ArrayLike = None,
    lam: ArrayLike = 0.0,
    relax: ArrayLike = 1.0,
    reach: ArrayLike = None,
    tol: ArrayLike = None,
    **others: Any,
) -> None:
    """ValueError in the name of `function` for numbers that are out of range.

    Those that are traced are not among the arguments (`jfsf.array.jit`).

    Args:
        function: opens the message.
        marginal_x, marginal_y, lam, relax, reach, tol: as in `sinkhorn`.
        others: what else the function was given; the embeddings, if there are any, say
            whether a marginal has the right shape, which another check names.
    """
    # An explicit transfer, which `jax.transfer_guard` lets pass.
    lam, relax, reach, tol = jax.device_get((lam, relax, reach, tol))
    facts = {
        f"lam is {lam}; give 0 or more": np.all(np.asarray(lam) >= 0),
        f"relax is {relax}; give more than 0 and less than 2": (
            np.all((np.asarray(relax) > 0) & (np.asarray(relax) < 2))
        ),
        f"reach is {reach}; give more than 0, or None": (
            reach is None or np.all(np.asarray(reach) > 0)
        ),
        f"tol is {tol}; give more than 0, or None": (
            tol is None or np.all(np.asarray(tol) > 0)
        ),
    }
    # With a reach or a slack marginals are targets, whose sums may differ.
    free = reach is not None or others.get("slack") is not None
    for side, marginal in (("x", marginal_x), ("y", marginal_y)):
        emb = others.get(f"emb_{side}")
        if marginal is None or (emb is not None and len(marginal) != len(emb)):
            continue
        mass = np.asarray(jax.device_get(marginal), np.float64)
        least, total = mass.min(initial=0), mass.sum()
        facts[f"marginal_{side} has {least}; give masses of 0 or more"] = least >= 0
        facts[f"marginal_{side} sums to {total}; divide it by its sum"] = (
            free or abs(total - 1) <= SUM_SLACK
        )
    for message, holds in facts.items():
        if not holds:
            raise ValueError(f"{function}: {message}")


def flagged(filtered: Filtered, right: Bool[Array, ""]) -> Filtered:
    """The same where values are in range; else its marginal error is nan.

    Values that are traced cannot be refused, so the result says it.
    """
    error = jnp.where(right, filtered.marginal_error, jnp.nan)
    return filtered._replace(marginal_error=error, converged=filtered.converged & right)

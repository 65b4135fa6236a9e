"""Principal components of superimposed shapes, and shape against size.

The components are unweighted, each landmark alike, as in geomorph and MorphoJ.
`jfsf.apps.model.fit_model` has those of meshes: weighted by area, of shapes in their
unit, in the precision of jax.
"""

from itertools import permutations as all_orders
from math import factorial
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jfsf.apps.morphometrics._checks import check_points
from jfsf.types import ArrayLike

# Share of the variance below which a component is a rounding.
NOTHING = 1e-14
# Statistics that differ by no more than this, relatively, count as equal.
EQUAL = 1e-10
AT_ONCE = 1000  # orders of the specimens held in memory


class Components(NamedTuple):
    """Principal components: a shape is mean + sum_k score_k axis_k.

    mean: (l, 3).
    axes: (k, l, 3) orthonormal, of variance above 0; the number of largest size in each
        is positive.
    variance: (k,) of the scores, over s - 1, the largest first.
    share: (k,) of the variance.
    scores: (s, k) of the specimens.
    """

    mean: Float[np.ndarray, "l 3"]
    axes: Float[np.ndarray, "k l 3"]
    variance: Float[np.ndarray, " k"]
    share: Float[np.ndarray, " k"]
    scores: Float[np.ndarray, "s k"]


class Allometry(NamedTuple):
    """The regression of shape on the natural logarithm of centroid size.

    slope: (l, 3) by which shape changes where the logarithm grows by 1.
    scores: (s,) regression scores: deviations from the mean shape along the slope
        (Drake and Klingenberg, Proc. R. Soc. B 2008).
    sums: (3,) of squares: by size, the rest, and all.
    share: R^2, of all squares by size.
    F: ratio of the mean squares, of 1 and s - 2 degrees of freedom.
    p: share of orders of the specimens with an F as large or larger, the real one
        counted.
    orders: how many there were.
    """

    slope: Float[np.ndarray, "l 3"]
    scores: Float[np.ndarray, " s"]
    sums: Float[np.ndarray, "3"]
    share: float
    F: float
    p: float
    orders: int


def components(shapes: Float[ArrayLike, "s l 3"]) -> Components:
    """Principal components of superimposed shapes.

    Args:
        shapes: as of `procrustes` or `symmetric_parts`.

    Raises:
        ValueError: fewer than two specimens, or values that are not finite.
    """
    shapes = check_points("components", shapes)
    s = len(shapes)
    mean = shapes.mean(0)
    u, sizes, vt = np.linalg.svd((shapes - mean).reshape(s, -1), full_matrices=False)
    variance = sizes**2 / (s - 1)
    kept = variance[: s - 1] > NOTHING * (shapes**2).sum()
    k = int(kept.sum())
    axes, variance = vt[:k], variance[:k]
    largest = np.take_along_axis(axes, np.abs(axes).argmax(1)[:, None], 1)
    signs = np.where(largest < 0, -1, 1)
    scores = (u[:, :k] * sizes[:k]) * signs[:, 0]
    axes = (axes * signs).reshape(k, *mean.shape)
    return Components(mean, axes, variance, variance / variance.sum(), scores)


def allometry(
    shapes: Float[ArrayLike, "s l 3"],
    sizes: Float[ArrayLike, " s"],
    *,
    permutations: int = 9999,
    seed: int = 0,
) -> Allometry:
    """How shape depends on size, and the probability that it does so by chance.

    Procrustes regression (Goodall 1991) with permuted residuals (Collyer, Sekora and
    Adams, Heredity 2015), which with one predictor are permuted specimens: that of
    `geomorph::procD.lm(coords ~ log(size))`. Where there are no more orders of the
    specimens than asked for, each is taken once, and p is exact.

    Args:
        shapes: as of `procrustes` or `symmetric_parts`.
        sizes: centroid sizes of the specimens.
        permutations: random orders beside the real one.
        seed: of these orders.

    Raises:
        ValueError: fewer than four specimens, sizes that are not positive or are all
            equal, no permutation, or values that are not finite.
    """
    shapes = check_points("allometry", shapes, least=4)
    sizes, s = np.asarray(sizes, float), len(shapes)
    if sizes.shape != (s,) or not (np.isfinite(sizes) & (sizes > 0)).all():
        raise ValueError(
            f"allometry: sizes are {sizes.shape}, {sizes.min()} to {sizes.max()}; pass "
            f"{s} positive ones"
        )
    if permutations < 1:
        raise ValueError(f"allometry: permutations are {permutations}; pass 1 or more")
    off = (shapes - shapes.mean(0)).reshape(s, -1)
    log = np.log(sizes) - np.log(sizes).mean()
    square = (log**2).sum()
    if square <= EQUAL:
        raise ValueError(
            f"allometry: all sizes are {sizes[0]:.4g}; give specimens of several"
        )
    total = (off**2).sum()
    if total <= NOTHING * (shapes**2).sum():
        raise ValueError("allometry: all shapes are equal; give others")
    slope = log @ off / square
    products = off @ off.T
    by_size = lambda orders: np.einsum("ps,ps->p", orders @ products, orders) / square
    found = by_size(log[None])[0]
    as_large, number = 0, 0
    for orders in _orders(s, permutations, seed):
        as_large += int((by_size(log[orders]) >= found * (1 - EQUAL)).sum())
        number += len(orders)
    rest = total - found
    return Allometry(
        slope.reshape(shapes.shape[1:]),
        off @ slope / (np.linalg.norm(slope) or 1),
        np.array([found, rest, total]),
        float(found / total),
        float(found / rest * (s - 2)) if rest > 0 else np.inf,
        as_large / number,
        number,
    )


def _orders(s, permutations, seed):
    """Orders of s specimens, the real one first, in pieces."""
    if s < 20 and factorial(s) <= permutations + 1:  # beyond 20 no int64 holds them
        yield np.array(list(all_orders(range(s))))
        return
    yield np.arange(s)[None]
    rng = np.random.default_rng(seed)
    for start in range(0, permutations, AT_ONCE):
        number = min(AT_ONCE, permutations - start)
        yield rng.permuted(np.tile(np.arange(s), (number, 1)), axis=1)

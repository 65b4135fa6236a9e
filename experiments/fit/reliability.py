"""Whether probabilities hold: as many are right as they say."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jfsf.types import ArrayLike

BINS = 10


class Reliability(NamedTuple):
    """How often what has each probability is true, in bins of equal width.

    probability: the mean probability in each bin; nan in an empty bin.
    share: the share, in each bin, that came true; nan in an empty bin.
    weight: the weight of each bin; the weights sum to 1, and an empty bin has 0.
    """

    probability: Float[np.ndarray, " b"]
    share: Float[np.ndarray, " b"]
    weight: Float[np.ndarray, " b"]

    @property
    def calibration_error(self) -> float:
        """The expected calibration error: mean gap between probability and share."""
        gap = np.abs(self.probability - self.share)
        return float(np.nansum(self.weight * gap))


def reliability(
    probability: ArrayLike,
    right: ArrayLike,
    *,
    weights: ArrayLike | None = None,
    bins: int = BINS,
) -> Reliability:
    """Compare probabilities (p,) with what came of them.

    Args:
        probability: (p,) predicted probabilities, in [0, 1].
        right: (p,) whether each prediction came true.
        weights: (p,) weights of the predictions, not negative; equal when absent.
        bins: number of bins of equal width from 0 to 1.
    """
    p, right = np.asarray(probability, np.float64), np.asarray(right, np.float64)
    w = np.ones_like(p) if weights is None else np.asarray(weights, np.float64)
    at = np.minimum((p * bins).astype(int), bins - 1)
    total = np.bincount(at, w, bins)
    sums = [np.bincount(at, w * values, bins) for values in (p, right)]
    known = np.where(total > 0, total, np.nan)
    return Reliability(sums[0] / known, sums[1] / known, total / total.sum())

"""Points that follow the deformation of a coarse shape near to them. Host side."""

import numpy as np


def follow(
    points: np.ndarray,
    rest: np.ndarray,
    moved: np.ndarray,
    rotation: np.ndarray,
    near: np.ndarray,
    away: np.ndarray,
) -> np.ndarray:
    """Where points go if each follows the rigid motions of some vertices.

    sum_j w_j (R_j (p - q_j) + m_j) for the point p, with weights w_j ~ 1 / away_j^2
    that sum to 1 (embedded deformation, Sumner et al., SIGGRAPH 2007, equation 1).

    Args:
        points: (n, 3) p.
        rest, moved: (c, 3) vertices of the coarse shape before, q, and after, m.
        rotation: (c, 3, 3) R of each.
        near, away: (n, k) vertices that a point follows, and how far they are.

    Returns:
        (n, 3).
    """
    weight = 1 / (away + 1e-6) ** 2
    weight /= weight.sum(1, keepdims=True)
    found = np.zeros(points.shape)
    for one, share in zip(near.T, weight.T, strict=True):
        turned = np.einsum("nij,nj->ni", rotation[one], points - rest[one])
        found += share[:, None] * (turned + moved[one])
    return found

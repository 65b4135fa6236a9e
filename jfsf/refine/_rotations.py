"""The rotations nearest to many 3 x 3 matrices, without an SVD of each. Host side.

`jfsf.refine.rotations` does the same of the transposed matrices in jitted code, less
exactly.
"""

import numpy as np

# The Newton steps end below this, and rows that have not come so far get an SVD.
PRECISION = 1e-10
MAX_STEPS = 25
# Rows that are nearer than this to having no single best rotation get an SVD.
DISTINCT = 1e-6
NEXT, LAST = np.array([1, 2, 0]), np.array([2, 0, 1])


def closest_rotations(spread: np.ndarray) -> np.ndarray:
    """The rotation R of each matrix that makes the trace of R^T spread largest.

    That largest trace is a root of a quartic, and R a polynomial of the matrix and the
    root (Markley, Fast Optimal Attitude Matrix, J. Astronautical Sciences 41, 1993).
    It takes a quarter of the time of SVDs, which the rare matrices get that have
    several best rotations, or nearly so.

    Args:
        spread: (..., 3, 3), finite.
    """
    flat = spread.reshape(-1, 3, 3)
    size = np.sqrt(np.einsum("nij,nij->n", flat, flat))
    unit = flat / np.where(size > 0, size, 1)[:, None, None]
    matrix = np.ascontiguousarray(np.moveaxis(unit, 0, 2))  # the long axis last
    cofactor = matrix[NEXT][:, NEXT] * matrix[LAST][:, LAST]
    cofactor -= matrix[NEXT][:, LAST] * matrix[LAST][:, NEXT]
    det, square = np.sum(matrix[0] * cofactor[0], 0), np.sum(cofactor**2, (0, 1))
    # (trace^2 - 1)^2 - 8 det trace - 4 square = 0, from above its largest root.
    trace, step = np.full(len(det), np.sqrt(3.0)), np.ones(len(det))
    for _ in range(MAX_STEPS):
        more = trace**2 - 1
        slope = 4 * (more * trace - 2 * det)
        value = more**2 - 8 * det * trace - 4 * square
        step = value / np.where(slope > 0, slope, np.inf)
        trace = trace - step
        if np.abs(step).max(initial=0) < PRECISION:
            break
    half = (trace**2 - 1) / 2
    scale = half * trace - det
    clear = (scale > DISTINCT) & (np.abs(step) < PRECISION)
    cube = np.moveaxis(unit @ unit.swapaxes(1, 2) @ unit, 0, 2)
    rotation = (half + 1) * matrix + trace * cofactor - cube
    rotation = np.moveaxis(rotation / np.where(clear, scale, 1), 2, 0)
    if not clear.all():
        rotation[~clear] = _by_svd(flat[~clear])
    return rotation.reshape(spread.shape)


def _by_svd(spread: np.ndarray) -> np.ndarray:
    left, _, right = np.linalg.svd(spread)
    left[..., 2] *= np.linalg.det(left @ right)[..., None]
    return left @ right

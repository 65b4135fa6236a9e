"""Block Lanczos: the largest eigenpairs of a symmetric operator in one sweep.

Host side. ARPACK orthogonalises one vector at a time, by products of a matrix and a
vector that wait for memory: two thirds of its time. Here the vectors of a block share
each pass over the basis, and two threads share the solves and the passes.
"""

from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import nullcontext

import numpy as np
import scipy.linalg as sl

# Sizes of the basis, in parts of the wanted pairs and in vectors beside: where
# convergence is first looked at, the steps in which it grows after that, and where it
# is given up. At the first look, copies of an eigenvalue that did not fit into a block
# must have appeared.
FIRST, FIRST_BESIDE = 2.5, 64
STEP = 0.125
LAST, LAST_BESIDE = 3, 256
# These are powers of the machine's precision, so that they suit float32 and float64.
# Parts of an image that should be zero, relative to those that are not: 1e-11 in
# float64.
DRIFT = 0.7
# A new direction's length, relative to the operator, below which it is rounding: 1e-10
# in float64.
EXHAUSTED = 0.64
# Slices that threads share. Sums depend on it in their last bits, so it does not follow
# the machine.
SLICES = 2


def largest_eigenpairs(
    apply: Callable[[np.ndarray], np.ndarray],
    start: np.ndarray,
    k: int,
    *,
    tol: float,
    threads: bool = True,
) -> tuple[np.ndarray, np.ndarray] | None:
    """The k largest eigenvalues of a symmetric operator, and their eigenvectors.

    Block Lanczos (Golub and Underwood, 1977) without restarts, each block orthogonal to
    all before it.

    Args:
        apply: the operator on columns, (n, c) -> (n, c). Two threads may call it at a
            time.
        start: the first block, (b, n), a row a vector, of full rank: random numbers. An
            eigenvalue with more than b copies gets the others by rounding only. Its
            precision is that of the basis. In float32 it takes half the memory, and
            residuals below 1e-6 of the largest eigenvalue are rounding.
        k: number of eigenpairs; their eigenvalues are positive.
        tol: for the residuals, |A v - theta v| <= tol theta. The error of an eigenvalue
            is of the order of tol squared.

    Returns:
        Eigenvalues (k,), falling; orthonormal eigenvectors (n, k). None if residuals
        are larger with the largest basis, or not finite.
    """
    b, n = start.shape
    last = min(LAST * k + LAST_BESIDE, n) // b * b
    step = max(int(STEP * k) // b, 1) * b
    look_at = max(int(FIRST * k), k + FIRST_BESIDE)
    eps = np.finfo(start.dtype).eps
    basis = np.empty((last, n), start.dtype)  # a row a vector
    small = np.zeros((last, last))  # the operator in the basis, upper triangle
    block = _orthonormal(start)[0]
    drifts = False, False  # of this block, and of the one before
    with ThreadPoolExecutor(SLICES) if threads else nullcontext() as pool:
        for begin in range(0, last, b):
            end = begin + b
            basis[begin:end] = block
            image = _applied(pool, apply, basis[begin:end])
            inner = _remove(pool, basis[:end], image)
            small[:end, begin:end] = inner
            block, factor = _orthonormal(image)
            if not np.isfinite(factor).all():
                return None
            # Exactly, only the last two blocks have a part in the image. Where others
            # have, the basis loses orthogonality; two blocks in a row restore it.
            drift = np.abs(inner[: max(begin - b, 0)]).max(initial=0)
            drifts = drift > eps**DRIFT * np.abs(inner[begin:]).max(), drifts[0]
            exhausted = abs(np.diag(factor)).min() < eps**EXHAUSTED * abs(small[0, 0])
            for _ in range(2 if exhausted else any(drifts)):
                _remove(pool, basis[:end], block)
                block = _orthonormal(block)[0]
            if end < min(look_at, last):
                continue
            look_at = end + step
            evals, vectors = sl.eigh(
                small[:end, :end], lower=False, subset_by_index=[end - k, end - 1]
            )
            residuals = np.linalg.norm(factor @ vectors[-b:], axis=0)
            if np.all(residuals <= tol * evals):
                evecs = np.empty((n, k), start.dtype)
                falling = np.ascontiguousarray(vectors[:, ::-1], start.dtype)

                def combine(at, known=basis[:end], falling=falling, evecs=evecs):
                    np.matmul(known[:, at].T, falling, out=evecs[at])

                _share(pool, combine, n)
                return evals[::-1], evecs
    return None


def _share(pool: Executor | None, function: Callable, size: int) -> list:
    """`function` of slices of `size` rows or columns, a slice a thread."""
    cuts = np.linspace(0, size, SLICES + 1).astype(int)
    slices = [slice(*cut) for cut in zip(cuts[:-1], cuts[1:], strict=True)]
    return list(map(function, slices) if pool is None else pool.map(function, slices))


def _applied(pool, apply, block):
    image = np.empty_like(block)

    def part(at):
        image[at] = apply(block[at].T).T

    _share(pool, part, len(block))
    return image


def _remove(pool, basis, image):
    """Take the span of `basis` out of the rows of `image`, in place.

    Returns:
        The coefficients, a column a row of `image`.
    """
    n = image.shape[1]
    parts = _share(pool, lambda at: image[:, at] @ basis[:, at].T, n)
    inner = np.sum(parts, 0)

    def subtract(at):
        image[:, at] -= inner @ basis[:, at]

    _share(pool, subtract, n)
    return inner.T


def _orthonormal(block):
    """LQ of a wide block by Cholesky, twice: as orthonormal as by reflections.

    Returns:
        Q, and L^T: what multiplies it from the right, for vectors as columns.
    """
    factor = np.eye(len(block))
    for _ in range(2):
        try:
            lower = np.linalg.cholesky(block @ block.T)
        except np.linalg.LinAlgError:  # the rows nearly depend on each other
            columns, upper = np.linalg.qr(block.T)
            block, lower = columns.T, upper.T
        else:
            block = np.linalg.inv(lower) @ block
        factor = lower.T @ factor
    return block, factor

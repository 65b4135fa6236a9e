"""Block Lanczos against numpy's dense eigensolver."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jfsf.spectral._lanczos import largest_eigenpairs


def operator(values, seed):
    """A symmetric matrix with these eigenvalues, and its eigenvectors."""
    n = len(values)
    vectors = np.linalg.qr(np.random.default_rng(seed).normal(size=(n, n)))[0]
    return (vectors * values) @ vectors.T, vectors


def largest(matrix, k, b=8, tol=1e-10):
    found = attempt(matrix, k, b, tol)
    assert found is not None
    return found


def attempt(matrix, k, b=8, tol=1e-10, start=None):
    if start is None:
        start = np.random.default_rng(10**7).normal(size=(b, len(matrix)))
    return largest_eigenpairs(lambda x: matrix @ x, start, k, tol=tol)


@given(seed=st.integers(0, 10**6), k=st.integers(1, 20), b=st.integers(2, 9))
def test_it_is_the_dense_solver(seed, k, b):
    # Like the inverse of a Laplacian's.
    values = 1 / (10 + 4 * np.pi * np.arange(400.0))
    matrix, vectors = operator(values, seed)
    evals, evecs = largest(matrix, k, b)
    np.testing.assert_allclose(evals, values[:k], rtol=1e-12)
    np.testing.assert_allclose(np.abs(evecs.T @ vectors[:, :k]), np.eye(k), atol=1e-8)
    np.testing.assert_allclose(evecs.T @ evecs, np.eye(k), atol=1e-12)


@pytest.mark.parametrize("tol", [1e-2, 1e-4, 1e-6])
def test_residuals_are_below_the_tolerance(tol):
    values = 1 / (10 + np.arange(600.0))
    matrix, _ = operator(values, 1)
    evals, evecs = largest(matrix, 40, tol=tol)
    residuals = np.linalg.norm(matrix @ evecs - evecs * evals, axis=0)
    assert (residuals <= tol * evals).all()
    # No more work than it takes: else the tolerance would not matter.
    assert residuals.max() > 1e-12


def test_copies_of_an_eigenvalue_up_to_a_block():
    values = np.repeat([1.0, 0.9, 0.5, 0.3, 0.1, 0.05], [1, 8, 5, 8, 8, 370])
    matrix, _ = operator(values, 2)
    evals, evecs = largest(matrix, 30, b=8)
    np.testing.assert_allclose(evals, values[:30], rtol=1e-12)
    np.testing.assert_allclose(evecs.T @ evecs, np.eye(30), atol=1e-12)


def test_a_start_that_holds_eigenvectors():
    values = 1 / (10 + np.arange(500.0))
    matrix, vectors = operator(values, 5)
    start = np.random.default_rng(6).normal(size=(8, 500))
    start[:3] = vectors[:, [0, 10, 400]].T
    start[3:6] = start[6:7] @ vectors[:, :40] @ vectors[:, :40].T
    start[4] += start[7]
    found = attempt(matrix, 20, start=start, tol=1e-9)
    assert found is not None
    evals, evecs = found
    np.testing.assert_allclose(evals, values[:20], rtol=1e-12)
    np.testing.assert_allclose(evecs.T @ evecs, np.eye(20), atol=1e-10)


@pytest.mark.slow
def test_values_all_alike_are_attempt():
    matrix, _ = operator(1 + 1e-9 * np.arange(2000.0), 3)
    assert attempt(matrix, 10, tol=1e-14) is None


def test_values_that_are_not_finite_are_attempt():
    assert attempt(np.full((200, 200), np.nan), 10) is None


@pytest.mark.parametrize("threads", [True, False])
def test_the_same_bits_again(threads):
    matrix, _ = operator(1 / (10 + np.arange(300.0)), 4)
    first = largest(matrix, 20)
    start = np.random.default_rng(10**7).normal(size=(8, 300))
    again = largest_eigenpairs(
        lambda x: matrix @ x, start, 20, tol=1e-10, threads=threads
    )
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))


def test_a_basis_in_float32():
    # Like the inverse of a Laplacian's.
    values = 1 / (10 + 4 * np.pi * np.arange(2000.0))
    matrix, vectors = operator(values, 8)
    start = np.random.default_rng(9).normal(size=(8, 2000)).astype(np.float32)
    found = attempt(matrix, 60, start=start, tol=1e-3)
    assert found is not None
    evals, evecs = found
    assert evecs.dtype == np.float32
    np.testing.assert_allclose(evals, values[:60], rtol=3e-5)
    np.testing.assert_allclose(evecs.T @ evecs, np.eye(60), atol=3e-5)
    low = vectors[:, :50]
    assert np.abs(low - evecs @ (evecs.T @ low)).max() < 1e-3

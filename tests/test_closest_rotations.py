"""The nearest rotations of many matrices, against an SVD of each."""

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from jfsf.refine._rest import closest_rotations
from jfsf.spectral._laplacian import definite_solver

ENTRIES = st.floats(-100, 100, allow_nan=False).filter(lambda x: x == 0 or abs(x) > 0.1)


def by_svd(matrix: np.ndarray) -> tuple[np.ndarray, float]:
    """A best rotation, and how far the next turn away from it is worse."""
    left, size, right = np.linalg.svd(matrix)
    sign = np.sign(np.linalg.det(left @ right))
    return left @ np.diag([1, 1, sign]) @ right, size[1] + sign * size[2]


@given(
    hnp.arrays(float, st.tuples(st.integers(0, 5), *[st.just(3)] * 2), elements=ENTRIES)
)
def test_it_is_a_rotation_and_no_other_has_a_greater_trace(matrices):
    found = closest_rotations(matrices)
    assert found.shape == matrices.shape
    for rotation, matrix in zip(found, matrices, strict=True):
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(rotation) == pytest.approx(1)
        best, distinct = by_svd(matrix)
        size = np.abs(matrix).max() + 1e-30
        assert np.sum(rotation * matrix) / size == pytest.approx(
            np.sum(best * matrix) / size, abs=1e-9
        )
        if distinct > 1e-3 * size:
            np.testing.assert_allclose(rotation, best, atol=1e-9)


@pytest.mark.parametrize("flat", [1.0, 1e-3, 1e-9, 0.0, -1e-9, -1e-3, -0.4])
def test_of_flat_and_mirrored_surroundings(flat):
    """A vertex on a flat surface has a matrix of rank 2, whose sign is noise."""
    rng = np.random.default_rng(0)
    left, right = (np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(2))
    right *= np.linalg.det(left @ right)
    matrix = 1e-6 * left @ np.diag([1, 0.5, flat]) @ right
    np.testing.assert_allclose(closest_rotations(matrix), left @ right, atol=1e-9)


def test_rows_do_not_depend_on_each_other():
    rng = np.random.default_rng(1)
    some = rng.normal(size=(6, 3, 3))
    some[1], some[3] = 0, np.outer([1, 2, 3], [1, 0, 1])  # of these many are best
    alone = np.stack([closest_rotations(matrix) for matrix in some])
    np.testing.assert_allclose(closest_rotations(some), alone, atol=1e-12)


def test_a_definite_matrix_is_solved_as_a_dense_one():
    rng = np.random.default_rng(2)
    some = sp.random(40, 40, 0.05, rng=rng)
    matrix = some @ some.T + sp.diags(rng.uniform(1e-3, 1, 40))
    right = rng.normal(size=(40, 3))
    dense = np.linalg.solve(matrix.toarray(), right)
    np.testing.assert_allclose(definite_solver(matrix)(right), dense, rtol=1e-8)

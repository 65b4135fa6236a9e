"""Structs and sparse matrices of MATLAB files: what was saved is read, or refused."""

import struct
import tempfile
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st

from jfsf.apps.mapfiles import MapFileError, read_map, read_mat, write_mat

RNG = np.random.default_rng(0)
LEAVES = [
    np.arange(6.0).reshape(2, 3),
    np.array([[-7]], np.int16),
    RNG.normal(size=(1, 40)).astype(np.float32),
    np.zeros((0, 3)),
    np.zeros((0, 0)),
    sp.random_array((5, 4), density=0.4, rng=RNG, format="csc"),
    sp.csc_array(np.diag([3.0, 0, 300])),
    sp.csc_array((4, 2)),
]
OTHERS = [
    np.ones((2, 2)) * 1j,
    sp.csc_array(np.eye(3) * 1j),
    "text",
    np.array([["a", 3.0]], object),  # a cell
    np.array([(1.0,), (2.0,)], [("a", float)]),  # two structs
]
names = st.text("abXYZ_9", min_size=1, max_size=31).map(lambda name: "f" + name[:30])
leaves = st.sampled_from(LEAVES + OTHERS)
structs = st.recursive(
    st.dictionaries(names, leaves, min_size=1, max_size=4),
    lambda inner: st.dictionaries(names, inner | leaves, min_size=1, max_size=4),
    max_leaves=4,
)


def read(path):
    return {name: value() for name, value in read_mat(path).items()}


def assert_same(found, wanted):
    if isinstance(wanted, dict):
        assert list(found) == list(wanted)
        for name in wanted:
            assert_same(found[name], wanted[name])
    elif any(wanted is other for other in OTHERS):
        assert found.dtype == object and found.item() is None
    elif sp.issparse(wanted):
        assert sp.issparse(found) and found.shape == wanted.shape
        np.testing.assert_array_equal(found.toarray(), wanted.toarray())
    else:
        np.testing.assert_array_equal(found, wanted)
        assert found.shape == wanted.shape


@pytest.mark.parametrize("compressed", [False, True])
@given(structs)
def test_what_scipy_saved_is_read(compressed, content):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "s.mat"
        scipy.io.savemat(path, content, do_compression=compressed)
        assert_same(read(path), content)
        if compressed:
            write_mat(path, content)
            assert_same(read(path), content)


CONTENT = {"S": {"n": 3.0, "v": np.arange(5.0), "in": {"A": LEAVES[5]}}, "B": LEAVES[6]}


def integers(*values):
    return struct.pack(f"<{len(values)}i", *values)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        # Rows of B, and starts of its columns.
        (integers(0, 2) + integers(5, 16), integers(0, 9) + integers(5, 16)),
        (integers(0, 1, 1, 2), integers(0, 2, 1, 2)),
        (integers(0, 1, 1, 2), integers(0, 1, 1, 200)),
        (integers(0, 1, 1, 2), integers(0, -1, 1, 2)),
        (integers(0, 1, 1, 2), integers(0, 1, 1, 0)),
    ],
)
def test_damaged_indices_are_refused(tmp_path, before, after):
    scipy.io.savemat(path := tmp_path / "s.mat", CONTENT)
    whole = path.read_bytes()
    assert whole.count(before) == 1
    path.write_bytes(whole.replace(before, after))
    with pytest.raises(MapFileError, match=r"s\.mat: damaged, or no \.mat .*again"):
        read(path)


def test_a_struct_that_is_no_map_is_refused(tmp_path):
    scipy.io.savemat(tmp_path / "s.mat", CONTENT)
    for key in CONTENT:
        with pytest.raises(MapFileError, match="holds object, expected whole numbers"):
            read_map(tmp_path / "s.mat", key=key)


def test_limits_are_arguments(tmp_path):
    write_mat(tmp_path / "s.mat", {"v": np.zeros(1000)})
    with pytest.raises(MapFileError, match=r"\[v\]: has 8000 bytes, above 4000"):
        read_mat(tmp_path / "s.mat", 4000)["v"]()
    assert not read_mat(tmp_path / "s.mat", 9000)["v"]().any()

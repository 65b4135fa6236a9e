"""Map files: what is written is read, and what cannot be right is refused."""

import os
import tempfile
import zipfile
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
import scipy.io
from certificates import certificate
from clock import clocks
from hypothesis import given
from hypothesis import strategies as st

from jfsf._figures import FIGURES, OLDEST
from jfsf.apps.mapfiles import (
    MapFileError,
    read_ground_truth,
    read_map,
    read_match,
    write_map,
    write_mat,
    write_match,
)
from jfsf.apps.mapfiles._stored import read_stored
from jfsf.types import STAGES, Certificate, Match, MatchInfo

SUFFIXES = [".vts", ".map", ".mat", ".npz"]


def text(folder, content, name="a.map"):
    path = folder / name
    path.write_text(content)
    return path


def match(n_x=6, n_y=4, **fields):
    numbers = dict.fromkeys(FIGURES, 0.5) | {"empty": 2, "finite": True}
    evidence = certificate(**numbers, landmarks=[0.1, 0.9])
    T_xy, T_yx = jnp.arange(n_x) % n_y, jnp.arange(n_y) + n_x - n_y
    C_yx = jnp.asarray(np.random.default_rng(0).normal(size=(3, 2)), jnp.float32)
    return Match(T_xy, T_yx, C_yx, evidence, **fields)


def refused(sentence):
    return pytest.raises(MapFileError, match=sentence)


@given(
    st.sampled_from(SUFFIXES),
    st.lists(st.integers(0, 10**6), min_size=1, max_size=20),
    st.sampled_from([None, 0, 1]),
)
def test_round_trip(suffix, values, base):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"a{suffix}"
        write_map(path, values, base=base)
        found = read_map(path, n_from=len(values), n_to=10**6 + 1, base=base)
        assert os.listdir(folder) == [path.name]
    assert found.dtype == np.int32
    np.testing.assert_array_equal(found, values)


@given(st.lists(st.integers(0, 9), min_size=1, max_size=12), st.sampled_from([0, 1]))
def test_the_other_base_shifts_by_one_or_is_refused(values, base):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.map"
        write_map(path, values, base=base)
        wrong = 1 - base
        contradicted = min(values) == 0 if wrong == 1 else max(values) == 9
        if contradicted:
            with refused(f"pass base={base}" if min(values) == 0 or base else "target"):
                read_map(path, n_to=10, base=wrong)
        else:
            found = read_map(path, n_to=10, base=wrong)
            np.testing.assert_array_equal(found, np.array(values) + base - wrong)


@pytest.mark.parametrize("suffix", [*SUFFIXES, ".match.npz", ".struct.mat"])
def test_equal_values_are_equal_bytes_at_any_time(suffix, tmp_path, monkeypatch):
    write = {
        ".match.npz": lambda path: write_match(path, match()),
        ".struct.mat": lambda path: write_mat(path, {"S": {"a": np.eye(3)}}),
    }.get(suffix, lambda path: write_map(path, [0, 2, 1]))
    found = []
    for year in clocks(monkeypatch):
        write(path := tmp_path / f"{year}{suffix}")
        found.append(path.read_bytes())
    assert found[0] == found[1]


def test_formats_of_the_field(tmp_path):
    floats = text(tmp_path, "   1.0000000e+00\r\n   3.0000000e+00\r\n\r\n", "a.sym.VTS")
    np.testing.assert_array_equal(read_map(floats, n_to=3), [0, 2])

    scipy.io.savemat(tmp_path / "one.mat", {"T12": [[1.0], [3.0]]})
    np.testing.assert_array_equal(read_map(tmp_path / "one.mat"), [0, 2])
    scipy.io.savemat(tmp_path / "two.mat", {"a": [[1, 2]], "b": [[4]]})
    np.testing.assert_array_equal(read_map(tmp_path / "two.mat", key="b"), [3])

    np.savez(tmp_path / "both.npz", T_xy=[0, 2], T_yx=[1, 0, 0])
    np.testing.assert_array_equal(read_map(tmp_path / "both.npz"), [0, 2])
    both = read_map(str(tmp_path / "both.npz"), key="T_yx", n_from=3, n_to=2)
    np.testing.assert_array_equal(both, [1, 0, 0])


def test_ground_truth(tmp_path):
    x = text(tmp_path, "1\n3\n2\n", "x.vts")
    y = text(tmp_path, "9\n8\n7\n", "y.vts")
    found = read_ground_truth(x, y, n_x=3, n_y=9)
    np.testing.assert_array_equal(found.gt_x, [0, 2, 1])
    np.testing.assert_array_equal(found.gt_y, [8, 7, 6])
    with refused(r"y\.vts: .* is 9, the target has 8"):
        read_ground_truth(x, y, n_x=3, n_y=8)
    short = text(tmp_path, "9\n8\n", "short.vts")
    with refused(r"short\.vts: has 2 template points, .*x\.vts has 3"):
        read_ground_truth(x, short)


OPTIONAL = {
    "confidence_x": jnp.linspace(0, 1, 6, dtype="f4"),
    "confidence_y": jnp.array([0.1, np.nan, 0.3, 1]),
    "radius_x": jnp.linspace(0, 3, 6, dtype="f4"),
    "radius_y": jnp.array([0.1, np.nan, 0.3, np.inf]),
    "membership_x": jnp.linspace(0, 1, 6, dtype="f4"),
    "membership_y": jnp.array([0.1, 0.9, 0.3, 1]),
    "matched_x": jnp.arange(6) > 2,
    "matched_y": jnp.arange(4) > 2,
    "overlap_x": jnp.asarray(0.4),
    "overlap_y": jnp.asarray(0.9),
}


def test_what_a_match_may_have_is_written_and_read(tmp_path):
    path = tmp_path / "match.npz"
    write_match(path, match())
    assert all(getattr(read_match(path), name) is None for name in OPTIONAL)
    write_match(path, match(**OPTIONAL))
    found = read_match(path)
    for name, values in OPTIONAL.items():
        np.testing.assert_array_equal(getattr(found, name), values)
        assert getattr(found, name).dtype == values.dtype


@pytest.mark.parametrize(
    "name, wrong, sentence",
    [
        ("confidence_x", np.zeros(5, "f4"), r"float32 \(5,\), .*probabilities \(6,\)"),
        ("confidence_x", np.arange(6), "expected probabilities"),
        ("confidence_x", np.arange(6) / 2.5, "from 0 to 2"),
        ("radius_x", np.arange(6) - 1.0, "lengths from 0 to inf"),
        ("membership_x", np.arange(6) / 2.5, "memberships from 0"),
        ("matched_x", np.zeros(6), r"float64 \(6,\), expected bool \(6,\)"),
        ("overlap_x", np.ones(3), "expected a number"),
    ],
)
def test_what_a_match_cannot_have_is_refused(tmp_path, name, wrong, sentence):
    write_match(tmp_path / "match.npz", match(**{name: wrong}))
    with refused(rf"\[{name}\]: .*{sentence}"):
        read_match(tmp_path / "match.npz")


def test_match_round_trip(tmp_path):
    path = tmp_path / "match.npz"
    write_match(path, match())
    assert os.listdir(tmp_path) == ["match.npz"]
    found, truth = read_match(path), match()
    for name in ("T_xy", "T_yx", "C_yx"):
        np.testing.assert_array_equal(getattr(found, name), getattr(truth, name))
    assert found.T_xy.dtype == np.int32 and found.C_yx.dtype == np.float32
    with np.load(path) as file:
        assert not {"index_x", "index_y"} & {*file.files}
    for name in Certificate._fields:
        a, b = getattr(found.certificate, name), getattr(truth.certificate, name)
        assert a.dtype == b.dtype and np.array_equal(a, b)
    # A match file is a map file, both ways.
    np.testing.assert_array_equal(read_map(path, n_from=6, n_to=4), truth.T_xy)
    found = read_map(path, key="T_yx", n_from=4, n_to=6)
    np.testing.assert_array_equal(found, truth.T_yx)


def test_a_match_of_parts_keeps_their_vertex_numbers(tmp_path):
    path = tmp_path / "match.npz"
    index = np.array([0, 2, 3, 7], np.int32)
    write_match(path, match(), index_y=index)
    with np.load(path) as file:
        assert "index_x" not in file.files
        np.testing.assert_array_equal(file["index_y"], index)
        assert file["index_y"].dtype == np.int32
    np.testing.assert_array_equal(read_match(path).T_xy, match().T_xy)


@pytest.mark.parametrize(
    "content, options, sentence",
    [
        ("1\n0\n", {}, "holds a 0, so it is not 1-based; pass base=0"),
        ("0\n2\n", {"base": 1}, "pass base=0"),
        ("1\n3\n", {"base": 0, "n_to": 3}, "entry 2 is 3.* pass base=1"),
        ("0\n3\n", {"base": 0, "n_to": 3}, "entry 2 is 3.* another shape's"),
        ("1\n4\n", {"n_to": 3}, "entry 2 is 4, the target has 3 .* as 1-based"),
        ("1\n1e10\n", {}, "entry 2 is 10000000000, the target has 2147483647"),
        ("1\n2\n", {"n_from": 3, "n_to": 5}, "has 2 entries, expected 3; .*truncated"),
        ("1\n2\n", {"n_from": 3, "n_to": 2}, "has 2 entries.* runs the other way"),
        ("1\n1.5\n", {}, "entry 2 is 1.5, not a whole number"),
        ("1\nnan\n", {}, "entry 2 is nan"),
        ("inf\n1\n", {}, "entry 1 is inf"),
        ("1\n-1\n", {}, "entry 2 is -1; give every vertex an image"),
        ("1\n\n2 3\n", {}, "line 3 is '2 3'; expected one index a line"),
        ("1\n1_0\n", {}, "line 2 is '1_0'"),
        ("# head\n1\n", {}, "line 1 is '# head'"),
        (" \n\n", {}, "the file is empty"),
        ("1\n", {"key": "T_xy"}, "text holds no key 'T_xy'"),
    ],
)
def test_text_refused(tmp_path, content, options, sentence):
    with refused(rf"a\.map: {sentence}|a\.map: .*{sentence}"):
        read_map(text(tmp_path, content), **options)


def test_files_refused(tmp_path):
    with refused(r"none\.map: No such file"):
        read_map(tmp_path / "none.map")
    with refused(r"none\.npz: No such file"):
        read_map(tmp_path / "none.npz")
    (tmp_path / "folder.map").mkdir()
    with refused("directory"):
        read_map(tmp_path / "folder.map")
    with refused(r"unknown format '\.txt'; maps are \.vts, \.map, \.mat, \.npz"):
        read_map(text(tmp_path, "1\n", "a.txt"))
    (tmp_path / "b.map").write_bytes(b"\xff\xfe1\n")
    with refused("not text"):
        read_map(tmp_path / "b.map")
    for name in ("c.npz", "c.mat"):
        write_map(tmp_path / name, np.arange(100))
        whole = (tmp_path / name).read_bytes()
        for size in (len(whole) // 2, len(whole) - 30, 60):
            (tmp_path / name).write_bytes(whole[:size])
            with refused("damaged"):
                read_map(tmp_path / name)
        (tmp_path / name).write_bytes(b"")
        with refused("empty"):
            read_map(tmp_path / name)
        (tmp_path / name).write_text("1\n2\n")
        with refused("damaged"):
            read_map(tmp_path / name)
    with (tmp_path / "d.npz").open("wb") as file:
        np.save(file, np.arange(3))
    with refused(r"no \.npz; write it with np.savez"):
        read_map(tmp_path / "d.npz")
    # MATLAB's -v7.3 is HDF5 behind a header that says so.
    header = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    (tmp_path / "e.mat").write_bytes(header + b"\x89HDF\r\n\x1a\n" + bytes(64))
    with refused("-v7.3; save it again with -v7"):
        read_map(tmp_path / "e.mat")


def test_arrays_refused(tmp_path):
    path = tmp_path / "a.npz"

    def write(**arrays):
        np.savez(path, **arrays)
        return path

    with refused("no T_xy among several arrays; .*: a, b"):
        read_map(write(a=[1], b=[1]))
    with refused("no key 'T_yx'; it holds T_xy"):
        read_map(write(T_xy=[1]), key="T_yx")
    with refused("it holds no array"):
        read_map(write(), key="T_yx")
    with refused(r"a\.npz\[T_xy\]: holds no index"):
        read_map(write(T_xy=np.zeros(0, int)))
    with refused(r"shape is \(2, 2\), expected a vector"):
        read_map(write(T_xy=np.eye(2)))
    with refused("holds <U1, expected whole numbers"):
        read_map(write(T_xy=["a"]))
    with refused("holds bool"):
        read_map(write(T_xy=[True]))
    with refused("damaged, or no .npz of plain arrays"):
        read_map(write(T_xy=np.array([None])))
    with refused("entry 1 is 2.* pass base=1"):
        read_map(write(T_xy=[2, 1]), n_to=2)


SAVED = {
    "-v4": {"format": "4"},
    "-v6": {"format": "5"},
    "-v7": {"format": "5", "do_compression": True},
}


@pytest.mark.parametrize("version", SAVED)
def test_matlab_files_of_every_version_are_read(version, tmp_path):
    path, values = tmp_path / "a.mat", np.arange(1.0, 6)[None]
    others = {"other": "text", "matrix": values * 1j, "T_yx": values.T}
    scipy.io.savemat(path, {**others, "T_xy": values}, **SAVED[version])
    for key in ("T_xy", "T_yx"):
        np.testing.assert_array_equal(read_map(path, key=key), np.arange(5))
    for name in ("other", "matrix"):
        with refused(f"{name}.*: holds object, expected whole numbers"):
            read_map(path, key=name)


# Without compression (-v6) scipy ends the process where the type of an element is
# damaged. With it a checksum finds the damage first.
@pytest.mark.parametrize("version", ["-v4", "-v7"])
@given(st.integers(0, 400), st.integers(0, 255))
def test_a_damaged_byte_in_a_matlab_file(version, at, byte):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.mat"
        scipy.io.savemat(path, {"T_xy": np.arange(1.0, 21)}, **SAVED[version])
        whole = bytearray(path.read_bytes())
        whole[at % len(whole)] = byte
        path.write_bytes(whole)
        try:
            # Only in the numbers themselves can damage go unnoticed.
            assert read_map(path).size
        except MapFileError as error:
            assert str(path) in str(error)


def npz(path, header=None, data=bytes(800), name="T_xy.npy", **options):
    """A .npz of one array, with any header; by default of 200 integers."""
    header = header or "{'descr': '<i4', 'fortran_order': False, 'shape': (200,), }"
    text = header.encode().ljust(117) + b"\n"
    array = b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + data
    with zipfile.ZipFile(path, "w", **options) as file:
        file.writestr(name, array)
    return path


def test_npz_by_hand_is_read(tmp_path):
    assert read_map(npz(tmp_path / "a.npz")).tolist() == [0] * 200


# What numpy and zipfile raise, and a file that makes them.
HEADERS = {
    MemoryError: "{'descr': '<i4', 'fortran_order': False, 'shape': (10000000000000,)}",
    TypeError: "{'descr': '<i4', 'fortran_order': False, 'shape': (200,), [1]: 2}",
    SyntaxError: "{'descr': '<i4', 'fortran_order': False, 'shape': (200,), ",
    ValueError: "{'descr': '|O', 'fortran_order': False, 'shape': (200,), }",
}


@pytest.mark.parametrize("kind", HEADERS)
def test_a_damaged_header_of_an_array_is_refused(tmp_path, kind):
    path = npz(tmp_path / "a.npz", HEADERS[kind])
    with refused(
        r"a\.npz: damaged, or no \.npz of plain arrays \(.+\); write it again"
    ):
        read_map(path)


def test_a_damaged_shape_does_not_cut_an_array(tmp_path):
    # The array is long enough that numpy does not meet its checksum.
    header = "{'descr': '<i4', 'fortran_order': False, 'shape': (200,), }"
    path = npz(tmp_path / "a.npz", header, bytes(80_000))
    with refused("T_xy is longer than its shape"):
        read_map(path)


def test_a_compression_that_nobody_knows_is_refused(tmp_path):
    path = npz(tmp_path / "a.npz")
    whole = path.read_bytes()
    for magic, offset in ((b"PK\x03\x04", 8), (b"PK\x01\x02", 10)):
        at = whole.index(magic) + offset
        whole = whole[:at] + b"\x63\x00" + whole[at + 2 :]
    path.write_bytes(whole)
    with refused("damaged, or no .npz .*compression"):
        read_map(path)


def test_a_damaged_npz_says_nothing_but_its_error(tmp_path):
    # Warnings are errors here: numpy reads headers as Python text.
    header = r"{'descr': '\<i4', 'fortran_order': False, 'shape': (200,), }"
    with refused("damaged"):
        read_map(npz(tmp_path / "a.npz", header))


@pytest.mark.parametrize("suffix", [".npz", ".mat"])
def test_arrays_that_expand_to_more_than_memory_are_refused(
    tmp_path, monkeypatch, suffix
):
    monkeypatch.setattr("jfsf.apps.mapfiles._arrays.MOST_BYTES", 4000)
    path = tmp_path / f"a{suffix}"
    for n, is_read in ((900, True), (1100, False)):
        values = np.ones(n, np.int32)
        if suffix == ".npz":
            np.savez_compressed(path, T_xy=values, other=np.zeros(9999))
        else:
            scipy.io.savemat(path, {"T_xy": values}, do_compression=True)
        if is_read:
            assert len(read_map(path)) == n
        else:
            with refused("above 4000"):
                read_map(path)


def test_numbers_beyond_all_integers_are_refused(tmp_path):
    for values in ([1e300], np.array([np.longdouble("1e4000")]), [2**63]):
        np.savez(tmp_path / "a.npz", T_xy=np.array(values))
        with refused("entry 1 is (1e.300|inf|9.2233)"):
            read_map(tmp_path / "a.npz")


def test_options_refused(tmp_path):
    with pytest.raises(ValueError, match="read_map: base is 2"):
        read_map(tmp_path / "a.map", base=2)
    with pytest.raises(ValueError, match="write_map: base is -1"):
        write_map(tmp_path / "a.map", [0], base=-1)
    for wrong in ([[0]], [0.0], np.zeros(0, int)):
        with pytest.raises(ValueError, match=r"write_map: T_xy is \("):
            write_map(tmp_path / "a.map", wrong)
    for wrong in (-1, 2**31 - 1):
        with pytest.raises(ValueError, match=f"holds {wrong}, not in 0"):
            write_map(tmp_path / "a.map", [wrong])
    with refused("unknown format '.txt'"):
        write_map(tmp_path / "a.txt", [0])
    with refused(r"cannot be written \(No such file"):
        write_map(tmp_path / "none" / "a.map", [0])
    assert os.listdir(tmp_path) == []


def test_matches_refused(tmp_path):
    path = tmp_path / "match.npz"
    with refused("written as .npz"):
        write_match(tmp_path / "match.mat", match())
    with refused("a match is a .npz"):
        read_match(tmp_path / "match.mat")
    batch = match()._replace(T_xy=jnp.zeros((2, 6), int))
    with pytest.raises(ValueError, match=r"T_xy is \(2, 6\), expected one match"):
        write_match(path, batch)
    write_map(path, [0, 1])
    with refused("lacks T_yx, C_yx, certificate_.*; it holds T_xy; "):
        read_match(path)
    write_match(path, match()._replace(T_xy=jnp.array([0, 4])))
    with refused(r"\[T_xy\]: entry 2 is 4, the target has 4"):
        read_match(path)
    for wrong in (jnp.zeros(3), jnp.zeros((0, 5)), np.array([["a"]])):
        write_match(path, match()._replace(C_yx=wrong))
        with refused(r"\[C_yx\]: holds .*, expected a functional map"):
            read_match(path)
    for name, wrong, expected in (
        ("gap", np.array("a"), "a number"),
        ("energy", np.zeros(2), "a number"),
        ("landmarks", np.zeros((2, 2)), "a vector of numbers"),
    ):
        wrong = match().certificate._replace(**{name: wrong})
        write_match(path, match()._replace(certificate=wrong))
        with refused(rf"\[certificate_{name}\]: holds .*, expected {expected};"):
            read_match(path)


def test_stored_maps(tmp_path):
    path = tmp_path / "a.npz"
    write_match(path, match(), index_y=[0, 2, 3, 7])
    found = read_stored(path, n_x=6, n_y=9)
    assert found.index_x is None
    np.testing.assert_array_equal(found.index_y, [0, 2, 3, 7])
    for name in ("T_xy", "T_yx", "C_yx"):
        np.testing.assert_array_equal(getattr(found, name), getattr(match(), name))
    write_map(tmp_path / "a.map", [0, 1], base=0)
    found = read_stored(tmp_path / "a.map", n_x=2, n_y=2, base=0)
    assert found.T_xy.tolist() == [0, 1] and found[1:] == (None,) * 4
    # Whole numbers of any type, and one column, as for maps.
    np.savez(path, T_xy=[0, 1], index_x=[[3.0], [1.0]])
    found = read_stored(path, n_x=4, n_y=2)
    np.testing.assert_array_equal(found.index_x, [3, 1])


STORED = {
    "float": ({"index_x": [0, 1.5]}, r"\[index_x\]: entry 2 is 1.5, not a whole"),
    "string": ({"index_x": ["a", "b"]}, r"\[index_x\]: holds <U1, expected whole"),
    "flags": ({"index_x": [True, True]}, "holds bool, expected whole"),
    "empty": ({"index_x": np.zeros(0, int)}, r"\[index_x\]: holds no index"),
    "matrix": ({"index_x": np.eye(2, dtype=int)}, r"shape is \(2, 2\), expected a vec"),
    "number": ({"index_x": 1}, r"shape is \(\), expected a vector"),
    "too large": ({"index_y": [0, 5]}, r"\[index_y\]: entry 2 is 5, the target has 5"),
    "negative": ({"index_y": [0, -1]}, r"\[index_y\]: entry 2 is -1"),
    "twice": ({"index_x": [3, 3]}, "names vertex 3 more than once"),
    "too long": ({"index_x": [0, 1, 2]}, "index_x has 3 entries and T_xy 2"),
    "too long, y": (
        {"index_y": [0, 1, 2], "T_yx": [0, 1]},
        "index_y has 3 entries and T_yx 2",
    ),
    "mesh without index": ({"T_xy": [0, 1, 1]}, "has 3 entries, expected 2"),
    "not other way": ({"T_yx": [0]}, r"\[T_yx\]: has 1 entries, expected 5"),
    "words": ({"C_yx": "a"}, r"\[C_yx\]: holds <U1 \(\), expected a functional map"),
    "no columns": ({"C_yx": np.zeros((0, 5))}, r"float64 \(0, 5\), expected"),
    "vector": ({"C_yx": np.zeros(5)}, r"float64 \(5,\), expected"),
    "complex": ({"C_yx": np.eye(2) * 1j}, "complex128"),
    "nan": ({"C_yx": np.eye(2) * np.nan}, r"\[C_yx\]: holds nan, no number of a"),
    "huge": ({"C_yx": np.eye(2) * 1e300}, r"\[C_yx\]: holds 1e\+300"),
}


@pytest.mark.parametrize("name", STORED)
def test_stored_maps_that_do_not_fit_are_refused(tmp_path, name):
    arrays, sentence = STORED[name]
    with (tmp_path / "a.npz").open("wb") as file:
        np.savez(file, **{"T_xy": [0, 1], **arrays})
    n_x = 2 if "index_x" not in arrays else 4
    with refused(rf"a\.npz.*{sentence}"):
        read_stored(tmp_path / "a.npz", n_x=n_x, n_y=5)


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "a.map"
    write_map(path, [0, 1])

    def fails(file, *_):
        file.write(b"1\n")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savetxt", fails)
    with refused("No space left"):
        write_map(path, [5, 6, 7])
    assert os.listdir(tmp_path) == ["a.map"]
    np.testing.assert_array_equal(read_map(path), [0, 1])


@pytest.mark.slow
def test_files_of_the_data_sets():
    data = Path(os.environ.get("JFSF_DATA", "data"))
    if not (data / "authors_pair").is_dir():
        pytest.skip("needs the research data: set JFSF_DATA")
    rough = read_map(data / "authors_pair" / "Man0_Man1.map", n_from=6890, n_to=6890)
    assert rough.min() >= 0 and rough.max() < 6890
    corres = data / "faust_r" / "corres"
    files = sorted(corres.glob("*[0-9].vts"))[:2]
    assert len(read_ground_truth(*files).gt_x) == 5000


INFO = MatchInfo(
    np.array([1, 3, 3], np.int32),
    np.array([0.2, np.nan, 0.8], np.float32),
    np.array(2, np.int32),
    np.arange(len(STAGES)) / 7,
)


def test_the_info_of_a_match_comes_back(tmp_path):
    path = tmp_path / "match.npz"
    write_match(path, match()._replace(info=INFO))
    info = read_match(path).info
    assert info.sources == ["search", "coarse copies", "coarse copies"]
    assert info.start == "coarse copies"
    for ours, theirs in zip(info, INFO, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    write_match(path, match())
    assert read_match(path).info is None


def changed(path, **arrays):
    """The file with other arrays; None removes one."""
    with np.load(path) as file:
        new = {**file, **arrays}
    np.savez(path, **{name: value for name, value in new.items() if value is not None})


def test_info_of_another_version_is_left_out_or_filled_up(tmp_path):
    path = tmp_path / "match.npz"
    write_match(path, match()._replace(info=INFO))
    changed(
        path, info_stages=np.array(["search", "later"]), info_seconds=np.arange(2.0)
    )
    seconds = dict(zip(STAGES, read_match(path).info.seconds, strict=True))
    assert seconds.pop("search") == 0 and np.isnan([*seconds.values()]).all()
    changed(path, info_sources=np.array(["search", "later", "search"]))
    assert read_match(path).info is None


@pytest.mark.parametrize(
    "wrong",
    [
        {"info_won": np.array(3)},
        {"info_won": np.array(1.0)},
        {"info_confidence": np.zeros(2)},
        {"info_sources": np.arange(3)},
        {"info_seconds": np.zeros(1)},
    ],
)
def test_info_that_does_not_fit_is_refused(tmp_path, wrong):
    path = tmp_path / "match.npz"
    write_match(path, match()._replace(info=INFO))
    changed(path, **wrong)
    with refused("info_.* do not fit each other; match the pair again"):
        read_match(path)


LATER = {name: figure for name, figure in FIGURES.items() if figure.since != OLDEST}


@pytest.mark.parametrize("name", LATER)
def test_a_file_without_a_later_figure_is_read(tmp_path, name):
    # A field with a new name must not make all older files unreadable.
    path = tmp_path / "match.npz"
    write_match(path, match())
    older = {f"certificate_{name}": None}
    if before := LATER[name].formerly:
        older[f"certificate_{before}"] = np.array(0.3)
    changed(path, **older)
    found = getattr(read_match(path).certificate, name)
    assert found == 0.3 if before else np.isnan(found)


def test_a_file_without_a_figure_that_all_have_is_refused(tmp_path):
    path = tmp_path / "match.npz"
    write_match(path, match())
    changed(path, certificate_share=None)
    with refused("lacks certificate_share; it holds"):
        read_match(path)

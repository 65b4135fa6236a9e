"""The disk cache: one key a content, whole files, and no way to break a result."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from jfsf import cache


class Pair(NamedTuple):
    a: Any
    b: Any


VALUE = Pair(np.arange(6.0).reshape(2, 3), np.array([[1, 2, 3]], np.int32))


def same(got):
    return all(
        np.array_equal(x, y) and x.dtype == y.dtype and x.shape == y.shape
        for x, y in zip(got, VALUE, strict=True)
    )


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.setenv("JFSF_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def never():
    raise AssertionError("computed again")


def test_the_folder_follows_the_environment(place, monkeypatch):
    assert cache.folder() == place
    monkeypatch.delenv("JFSF_CACHE")
    assert cache.folder().name == "jfsf" and cache.folder() != place


def test_a_record_is_computed_once(place):
    assert same(cache.fetch("key", Pair, lambda: VALUE))
    assert same(cache.fetch("key", Pair, never))
    assert [file.name for file in place.iterdir()] == ["key.npz"]


def test_what_compute_raises_passes_through(place):
    with pytest.raises(ZeroDivisionError):
        cache.fetch("key", Pair, lambda: 1 / 0)
    assert not place.exists()


@given(st.data())
def test_damage_is_repaired(tmp_path_factory, data):
    folder = tmp_path_factory.mktemp("cache")
    path = folder / "key.npz"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("JFSF_CACHE", str(folder))
        cache.fetch("key", Pair, lambda: VALUE)
        good = path.read_bytes()
        at = data.draw(st.integers(0, len(good) - 1))
        kind = data.draw(st.sampled_from(["cut", "flip", "noise"]))
        if kind == "cut":
            bad = good[:at]
        elif kind == "flip":
            flipped = bytes([good[at] ^ data.draw(st.integers(1, 255))])
            bad = good[:at] + flipped + good[at + 1 :]
        else:
            bad = data.draw(st.binary(max_size=50))
        path.write_bytes(bad)
        assert same(cache.fetch("key", Pair, lambda: VALUE))
        assert same(cache.fetch("key", Pair, lambda: VALUE))


@pytest.mark.parametrize("content", ["npy", "other fields", "pickle"])
def test_a_foreign_file_is_replaced(place, content):
    place.mkdir()
    path = place / "key.npz"
    with path.open("wb") as file:
        if content == "npy":
            np.save(file, np.zeros(3))
        elif content == "pickle":
            np.savez(file, a=np.array([{}], object), b=np.zeros(1))
        else:
            np.savez(file, a=np.zeros(3))
    assert same(cache.fetch("key", Pair, lambda: VALUE))
    assert same(cache.fetch("key", Pair, never))


def test_a_folder_that_cannot_be_made_is_done_without(place):
    place.write_text("a file stands here")
    assert same(cache.fetch("key", Pair, lambda: VALUE))
    assert place.read_text() == "a file stands here"


@pytest.mark.parametrize("broken", ["mkstemp", "replace", "savez"])
def test_a_failed_write_leaves_nothing_behind(place, monkeypatch, broken):
    def fail(*_, **__):
        raise PermissionError("read-only")

    owner = {"mkstemp": cache.tempfile, "replace": cache.os, "savez": cache.np}[broken]
    monkeypatch.setattr(owner, broken, fail)
    assert same(cache.fetch("key", Pair, lambda: VALUE))
    assert list(place.iterdir()) == []


arrays = hnp.arrays(
    st.sampled_from([np.int32, np.int64, np.float32, np.float64]),
    hnp.array_shapes(min_dims=1, max_dims=2, min_side=0, max_side=3),
    elements=st.integers(0, 2),
)
parts = st.lists(st.one_of(st.integers(0, 120), st.text("ab'1 ", max_size=3), arrays))


def plain(values):
    return [
        (v.shape, v.dtype.str, v.tobytes()) if isinstance(v, np.ndarray) else v
        for v in values
    ]


@given(parts, parts)
def test_keys_differ_where_parts_differ(one, two):
    equal = plain(one) == plain(two)
    assert (cache.key(*one) == cache.key(*two)) == equal
    assert cache.key(*one) == cache.key(*one)


def test_neighbours_do_not_run_together():
    assert cache.key(1, 23) != cache.key(12, 3)
    assert cache.key(np.zeros(2), 1) != cache.key(np.zeros((2, 1)), 1)
    grid = np.arange(6.0).reshape(2, 3)
    assert cache.key(grid.T) == cache.key(np.ascontiguousarray(grid.T))

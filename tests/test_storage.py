"""Files that are whole or absent; a cache whose damage never changes a result."""

import os
from typing import Any, NamedTuple

import numpy as np
import platformdirs
import pytest
from clock import clocks
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from jfsf import storage
from jfsf.storage._atomic import (
    check_writable,
    remove_left_over,
    remove_unfinished,
    write_atomically,
    write_text,
)
from jfsf.storage._cache import fetch, limit_bytes, make_room, stored_files


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
    assert storage.folder() == place
    monkeypatch.delenv("JFSF_CACHE")
    assert storage.folder().name == "jfsf" and storage.folder() != place


def test_a_record_is_computed_once(place):
    assert same(fetch("key", Pair, lambda: VALUE))
    assert same(fetch("key", Pair, never))
    assert [file.name for file in place.iterdir()] == ["key.npz"]


def test_a_record_does_not_carry_the_clock(place, monkeypatch):
    for year in clocks(monkeypatch):
        fetch(f"{year}", Pair, lambda: VALUE)
    one, two = place.iterdir()
    assert one.read_bytes() == two.read_bytes()


def test_what_compute_raises_passes_through(place):
    with pytest.raises(ZeroDivisionError):
        fetch("key", Pair, lambda: 1 / 0)
    assert not place.exists()


@given(st.data())
def test_damage_is_repaired(tmp_path_factory, data):
    folder = tmp_path_factory.mktemp("cache")
    path = folder / "key.npz"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("JFSF_CACHE", str(folder))
        fetch("key", Pair, lambda: VALUE)
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
        assert same(fetch("key", Pair, lambda: VALUE))
        assert same(fetch("key", Pair, lambda: VALUE))


def test_a_damaged_shape_does_not_cut_a_record(place):
    # So long that numpy does not meet the checksum before its end.
    long = Pair(np.arange(9000.0).reshape(3000, 3), np.zeros(1))
    fetch("key", Pair, lambda: long)
    path = place / "key.npz"
    path.write_bytes(path.read_bytes().replace(b"(3000, 3)", b"(1000, 3)"))
    assert same(fetch("key", Pair, lambda: VALUE))


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
    assert same(fetch("key", Pair, lambda: VALUE))
    assert same(fetch("key", Pair, never))


def test_a_folder_that_cannot_be_made_is_done_without(place):
    place.write_text("a file stands here")
    assert same(fetch("key", Pair, lambda: VALUE))
    assert place.read_text() == "a file stands here"


@pytest.mark.parametrize("broken", ["replace", "savez"])
def test_a_record_that_cannot_be_stored_is_returned(place, monkeypatch, broken):
    def fail(*_, **__):
        raise PermissionError("read-only")

    monkeypatch.setattr({"replace": os, "savez": np}[broken], broken, fail)
    assert same(fetch("key", Pair, lambda: VALUE))
    assert list(place.iterdir()) == []


def test_a_written_file_is_whole(tmp_path):
    path = tmp_path / "a.txt"
    write_atomically(path, lambda file: file.write(b"old"))

    def write(file):
        file.write(b"new")
        # Until all is written, readers see the old file.
        assert path.read_bytes() == b"old"
        assert all(p == path or p.suffix == ".tmp" for p in tmp_path.iterdir())

    write_atomically(str(path), write)
    assert path.read_bytes() == b"new" and os.listdir(tmp_path) == ["a.txt"]
    write_text(path, "one\r\ntwo \u00e9\n")
    assert path.read_bytes() == b"one\r\ntwo \xc3\xa9\n"


@pytest.mark.parametrize(
    ("name", "written"),
    [
        # As Python holds them in an ASCII locale; the last is Latin-1 on disk.
        ("größe.ply", "größe.ply"),
        ("鼻.ply".encode().decode("ascii", "surrogateescape"), "鼻.ply"),
        (b"gr\xf6sse.ply".decode("utf-8", "surrogateescape"), "gr\\xf6sse.ply"),
        ("\ud800", "\\ud800"),
    ],
)
def test_names_that_the_locale_does_not_hold_are_written(tmp_path, name, written):
    write_text(path := tmp_path / "a.txt", f"of {name}")
    assert path.read_bytes().decode("utf-8") == f"of {written}"


@pytest.mark.parametrize(
    "error", [OSError(28, "full"), ValueError(), KeyboardInterrupt()]
)
def test_a_failed_write_leaves_the_old_file(tmp_path, error):
    path = tmp_path / "a.txt"
    write_text(path, "old")

    def write(file):
        file.write(b"new")
        raise error

    with pytest.raises(type(error)):
        write_atomically(path, write)
    assert path.read_text() == "old" and os.listdir(tmp_path) == ["a.txt"]


def test_a_failed_rename_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "a.txt"
    write_text(path, "old")

    def fail(*_):
        raise PermissionError("another program has it open")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(PermissionError, match="another program"):
        write_text(path, "new")
    assert path.read_text() == "old" and os.listdir(tmp_path) == ["a.txt"]


def test_a_folder_that_is_missing_or_a_file_is_an_error(tmp_path):
    with pytest.raises(FileNotFoundError):
        write_text(tmp_path / "none" / "a.txt", "")
    write_text(tmp_path / "a.txt", "")
    with pytest.raises(OSError):
        write_text(tmp_path / "a.txt" / "b.txt", "")
    assert os.listdir(tmp_path) == ["a.txt"]


def test_an_error_names_the_file_that_was_asked_for(tmp_path):
    path = tmp_path / "a.txt"

    def full(file):
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError) as caught:
        write_atomically(path, full)
    assert caught.value.errno == 28 and caught.value.filename == str(path)
    missing = tmp_path / "none" / "a.txt"
    for call in (check_writable, lambda path: write_text(path, "")):
        with pytest.raises(FileNotFoundError) as caught:
            call(missing)
        assert caught.value.filename == str(missing)

    def other(file):
        raise FileNotFoundError(2, "No such file", "other.txt")

    with pytest.raises(FileNotFoundError) as caught:
        write_atomically(path, other)
    assert caught.value.filename == "other.txt"


def test_what_is_unfinished_can_be_removed(tmp_path):
    path = tmp_path / "a.txt"
    write_text(path, "old")

    def write(file):
        file.write(b"new")
        assert len(os.listdir(tmp_path)) == 2
        remove_unfinished()
        assert os.listdir(tmp_path) == ["a.txt"]
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_atomically(path, write)
    remove_unfinished()
    assert path.read_text() == "old" and os.listdir(tmp_path) == ["a.txt"]


def test_only_what_this_package_left_unfinished_is_removed(tmp_path):
    mine = tmp_path / "below" / f".{'0af1' * 8}.tmp"
    foreign = tmp_path / "draft.tmp", tmp_path / ".swap.tmp", tmp_path / "below/a.tmp"
    mine.parent.mkdir()
    for path in (mine, *foreign):
        path.touch()
    folder = tmp_path / f".{'0af2' * 8}.tmp"
    folder.mkdir()
    remove_left_over(tmp_path)
    assert not mine.exists() and folder.is_dir() and all(p.exists() for p in foreign)


def test_what_can_be_written_is_left_as_it_was(tmp_path):
    path = tmp_path / "a.txt"
    check_writable(path)
    assert os.listdir(tmp_path) == []
    write_text(path, "old")
    check_writable(str(path))
    assert path.read_text() == "old" and os.listdir(tmp_path) == ["a.txt"]
    with pytest.raises(IsADirectoryError):
        check_writable(tmp_path)
    with pytest.raises(OSError):
        check_writable(path / "b.txt")


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
    assert (storage.key(*one) == storage.key(*two)) == equal
    assert storage.key(*one) == storage.key(*one)


def test_neighbours_do_not_run_together():
    assert storage.key(1, 23) != storage.key(12, 3)
    assert storage.key(np.zeros(2), 1) != storage.key(np.zeros((2, 1)), 1)
    grid = np.arange(6.0).reshape(2, 3)
    assert storage.key(grid.T) == storage.key(np.ascontiguousarray(grid.T))


NAMES = [f"{digit}" * 64 for digit in "abcd"]


def stored(place, name, size, used, suffix=".npz"):
    """A file of the cache, last used `used` seconds after the year 1970."""
    place.mkdir(parents=True, exist_ok=True)
    path = place / f"{name}{suffix}"
    path.write_bytes(bytes(size))
    os.utime(path, (used, used))
    return path


def limit(monkeypatch, num_bytes):
    monkeypatch.setenv("JFSF_CACHE_LIMIT", f"{num_bytes / 1e9:.9f}")


def test_the_least_recently_used_files_go_first(place, monkeypatch):
    limit(monkeypatch, 250)
    spectrum = stored(place, NAMES[0], 100, used=3)
    program = stored(place / "programs", NAMES[1], 100, 2, ".program")
    oldest = stored(place, NAMES[2], 100, used=1)
    make_room()
    assert spectrum.exists() and program.exists() and not oldest.exists()
    limit(monkeypatch, 150)
    make_room()
    assert spectrum.exists() and not program.exists()


def test_what_is_read_is_used(place):
    fetch(NAMES[0], Pair, lambda: VALUE)
    path = place / f"{NAMES[0]}.npz"
    os.utime(path, (1, 1))
    fetch(NAMES[0], Pair, never)
    assert path.stat().st_mtime > 1e9


def test_storing_makes_room(place, monkeypatch):
    old = stored(place, NAMES[0], 10_000, used=1)
    limit(monkeypatch, 9_000)
    fetch(NAMES[1], Pair, lambda: VALUE)
    assert not old.exists() and (place / f"{NAMES[1]}.npz").exists()


def test_only_files_of_the_cache_are_removed(place, monkeypatch):
    limit(monkeypatch, 1)
    strange = [
        stored(place, "thesis", 100, used=1),
        stored(place, NAMES[0], 100, 1, ".npy"),
        stored(place, NAMES[0].upper(), 100, used=1),
        stored(place, NAMES[0][1:], 100, used=1),
        stored(place / "mine", NAMES[0], 100, used=1),
        stored(place.parent / "elsewhere", NAMES[0], 100, used=1),
    ]
    (place / f"{NAMES[1]}.npz").mkdir()
    (place / f"{NAMES[2]}.npz").symlink_to(strange[0])
    (place / "programs").symlink_to(place.parent / "elsewhere")
    own = stored(place, NAMES[3], 100, used=1)
    make_room()
    assert not own.exists() and all(path.exists() for path in strange)
    assert (place / f"{NAMES[1]}.npz").is_dir()
    assert (place / f"{NAMES[2]}.npz").is_symlink()


def test_files_that_vanish_meanwhile_are_no_error(place, monkeypatch):
    paths = [stored(place, name, 100, used=n) for n, name in enumerate(NAMES)]
    files = stored_files()
    assert [file.path for file in files] == paths
    paths[0].unlink()
    limit(monkeypatch, 250)
    monkeypatch.setattr(storage._cache, "stored_files", lambda: files)
    make_room()
    # The first counts as removed.
    assert [path.exists() for path in paths] == [False, False, True, True]


def test_a_file_that_cannot_be_removed_stays(place, monkeypatch):
    first, second = (stored(place, name, 100, used=1) for name in NAMES[:2])
    limit(monkeypatch, 150)
    real = type(first).unlink

    def unlink(path, missing_ok=False):
        if path == first:
            raise PermissionError("another's")
        real(path, missing_ok)

    monkeypatch.setattr(type(first), "unlink", unlink)
    make_room()
    assert first.exists() and not second.exists()


@pytest.mark.parametrize("text", ["much", "0", "-1", "nan", "10 GB"])
def test_a_wrong_limit_is_an_error_before_the_work(place, monkeypatch, text):
    monkeypatch.setenv("JFSF_CACHE_LIMIT", text)
    with pytest.raises(ValueError, match=f"JFSF_CACHE_LIMIT is '{text}'; give gigab"):
        fetch("key", Pair, never)


def test_the_limit_follows_the_environment(monkeypatch):
    for text, expected in (("", 10e9), ("2.5", 2.5e9), ("inf", np.inf)):
        monkeypatch.setenv("JFSF_CACHE_LIMIT", text)
        assert limit_bytes() == expected


def test_without_a_home_directory_the_error_names_what_to_set(monkeypatch):
    def no_home(name):
        raise RuntimeError("could not determine the home directory for '~/.cache'")

    monkeypatch.delenv("JFSF_CACHE", raising=False)
    monkeypatch.setattr(platformdirs, "user_cache_dir", no_home)
    with pytest.raises(ValueError, match="no home directory .* JFSF_CACHE name a fol"):
        storage.folder()

"""Damaged files of every format: refused in the package's own words, or sound."""

import numpy as np
import pytest

pytest.importorskip("resource", reason="measures memory as POSIX does")

from clock import clocks  # noqa: E402
from fuzz import Reader, findings  # noqa: E402
from fuzz_damage import damaged  # noqa: E402
from fuzz_formats import FORMATS, formats  # noqa: E402


@pytest.fixture(scope="module")
def reader():
    reader = Reader(seconds=10)
    yield reader
    reader.close()


@pytest.mark.parametrize("name", FORMATS)
def test_what_is_not_damaged_is_read(reader, tmp_path, name):
    (path := tmp_path / f"a{FORMATS[name].suffix}").write_bytes(FORMATS[name].data)
    assert not reader.read(path, sound=True)


def test_sound_files_are_the_same_in_every_run(monkeypatch):
    # So that a finding of one run is found by its number in another.
    for _ in clocks(monkeypatch):
        data = {name: form.data for name, form in formats().items()}
        assert data == {name: form.data for name, form in FORMATS.items()}


@pytest.mark.parametrize("name", FORMATS)
def test_damage_is_damage_and_comes_from_its_seed(name, monkeypatch):
    form = FORMATS[name]
    found, again = (
        [damaged(form, seed) for seed in range(40)] for _ in clocks(monkeypatch)
    )
    assert found == again
    assert len(set(found)) > 30 and np.mean([d != form.data for d in found]) > 0.8


@pytest.mark.parametrize(
    "suffix, said",
    [
        ("die", "the process ended with -6"),
        ("hang", "took more than"),
        ("warn", "warning: of it"),
        ("wrong", "IndexError: list index"),
        # Each needs a new process.
        pytest.param("grow", "MB", marks=pytest.mark.slow),
        pytest.param("nameless", "ValueError: invalid", marks=pytest.mark.slow),
        pytest.param("unsound", "AssertionError", marks=pytest.mark.slow),
        pytest.param("print", "loud", marks=pytest.mark.slow),
    ],
)
def test_whatever_goes_wrong_is_noticed(reader, tmp_path, suffix, said, monkeypatch):
    if suffix == "hang":
        monkeypatch.setattr(reader, "seconds", 2)
    assert said in reader.read(tmp_path / f"a.{suffix}")
    monkeypatch.undo()
    # And the next file is read.
    (path := tmp_path / "a.txt").write_bytes(FORMATS["txt"].data)
    assert not reader.read(path)


def test_scipy_does_not_begin_with_a_damaged_compressed_variable(reader, tmp_path):
    path, form = tmp_path / "a.mat", FORMATS["mat -v7"]
    files = [damaged(form, 9090)]  # it ended the process
    for at in range(136, len(form.data), 5):
        changed = bytearray(form.data)
        changed[at] ^= 0x55
        files.append(bytes(changed))
    for data in files:
        path.write_bytes(data)
        assert not reader.read(path)


def cases(count):
    names = list(FORMATS)
    return [(names[i % len(names)], i) for i in range(count)]


@pytest.mark.slow
def test_damaged_files_are_refused_or_sound(tmp_path):
    assert not findings(tmp_path, cases(2000))


@pytest.mark.slow  # 20 000 files
def test_many_damaged_files_are_refused_or_sound(tmp_path):
    assert not findings(tmp_path, cases(20_000))

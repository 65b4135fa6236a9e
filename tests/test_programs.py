"""Programs that are compiled early, with options, or kept on disk: same results."""

import copy
import hashlib
import operator
import os
import pickle
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import cloudpickle
import jax
import jax.numpy as jnp
import numpy as np
import platformdirs
import pytest

import jfsf
from jfsf import storage
from jfsf.matching import Settings
from jfsf.runtime import _program_files, _programs
from jfsf.runtime._programs import compile_ahead, large_jit
from jfsf.runtime._shared import shared_context
from jfsf.storage._cache import read_private, stored_files, write_private


def centred(x, *, axis):
    return x - x.mean(axis, keepdims=True)


def test_the_result_is_that_of_jit():
    x = jnp.arange(12.0).reshape(3, 4)
    moved = large_jit(centred, "cpu", static_argnames="axis")
    np.testing.assert_allclose(moved(x, axis=1), centred(x, axis=1))


def test_it_compiles_once():
    runs = [large_jit(centred, "cpu", static_argnames="axis") for _ in range(2)]
    assert runs[0] is runs[1]


def test_options_that_this_xla_lacks_are_left_out():
    known = {"xla_backend_optimization_level": 1}
    assert _programs.supported(known | {"xla_of_another_year": 1}) == known


class Halves(NamedTuple):
    low: Any
    high: Any


traced = []


def split(halves, scale, *, at):
    traced.append(at)
    factor = jnp.linalg.cholesky(scale * jnp.eye(2, dtype=halves.low.dtype))[0, 0]
    return Halves(factor * halves.low[:at], halves.high)


def run(function, *args, **options):
    return compile_ahead(function, *args, **options)(*args)


def ask(scale=4.0, at=2):
    halves = Halves(jnp.arange(5.0), None)
    return run(split, halves, scale, at=at)


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """Programs are kept in this folder, and none is known yet.

    The code of this file counts as the package's.
    """
    monkeypatch.setenv("JFSF_CACHE", str(tmp_path / "jfsf"))
    monkeypatch.setattr(_program_files, "OWN", ("jfsf", __name__))
    _programs.known.clear()
    traced.clear()
    yield tmp_path / "jfsf" / "programs"
    _programs.known.clear()


def another_process():
    _programs.known.clear()
    traced.clear()


def test_a_kept_program_is_not_traced_again(kept):
    for _ in range(2):
        found = ask()
        assert isinstance(found, Halves) and found.high is None
        np.testing.assert_allclose(found.low, [0, 2])
    assert traced == [2]
    another_process()
    # What is not static may have other values.
    np.testing.assert_allclose(ask(scale=9.0).low, [0, 3])
    assert not traced and len(list(kept.iterdir())) == 1


def test_other_options_or_settings_of_jax_are_other_programs(kept):
    ask()
    assert len(ask(at=3).low) == 3
    with jax.numpy_rank_promotion("warn"):
        ask()
    assert traced == [2, 3, 2] and len(list(kept.iterdir())) == 3


@pytest.mark.usefixtures("kept")
def test_other_code_functions_or_parts_are_other_names(monkeypatch):
    name = partial(_program_files.program_path, split, {})
    names = [name("one"), name("two"), _program_files.program_path(run, {}, "one")]
    assert name("one") == names[0]
    monkeypatch.setattr(_program_files, "CODE", "newer")
    assert len({*names, name("one")}) == 4


@pytest.mark.usefixtures("kept")
def test_no_two_options_have_one_name():
    # Numbers and their texts, functions and classes and their copies, and what holds
    # them: what differs has another name, or none.
    def own(value):
        return _program_files.program_path(split, {"how": value})

    options = [None, "None", 1, 1.0, True, "1", (1,), ((1,),), ("1",), "(1,)", (1, 2)]
    options += [partial(split, at=1), partial(split, at="1"), partial(split, 1)]
    options += [split, run, Halves, Halves(1, 2), Settings(), Settings(k=200)]
    options += [jfsf.convert.nearest, jfsf.convert.sinkhorn]
    names = [own(value) for value in options]
    assert None not in names and len(set(names)) == len(options)
    copies = [cloudpickle.loads(cloudpickle.dumps(value)) for value in options]
    assert [own(value) for value in copies] == names
    named_alike = jax.jit(jnp.negative)
    named_alike.__module__, named_alike.__qualname__ = __name__, "split"
    unknown = [lambda x: x, jax.jit(lambda x: 2 * x), jnp.ones(2), [1], object()]
    unknown += [np.float64(1), named_alike, copy.deepcopy(jax.jit(lambda x: 3 * x))]
    assert [own(value) for value in unknown] == [None] * len(unknown)


def with_settings(x, *, settings):
    return settings.converter(x)


def test_settings_are_part_of_the_name(kept):
    # A changed number is another program, also for another process.
    x = jnp.ones(2)
    for _ in range(2):
        for settings in (Settings(), Settings(bend_rounds=3)):
            compile_ahead(described, x, settings=settings)
        another_process()
    assert len(list(kept.iterdir())) == 2


def described(x, *, settings):
    return settings.bend_rounds * x


def test_a_program_with_code_from_elsewhere_is_not_kept(kept):
    # Its name could not tell when that code has changed.
    settings = Settings(converter=operator.neg)
    assert run(with_settings, jnp.ones(()), settings=settings) == -1
    assert not kept.exists()


def test_a_damaged_program_is_compiled_again(kept):
    ask()
    (file,) = kept.iterdir()
    whole = bytearray(file.read_bytes())
    whole[len(whole) // 2] ^= 255
    file.write_bytes(whole)
    another_process()
    np.testing.assert_allclose(ask().low, [0, 2])
    assert traced == [2]


@pytest.mark.parametrize("ends_well", [True, False])
def test_two_processes_compile_a_program_once(kept, monkeypatch, ends_well):
    ask()
    (path,) = kept.iterdir()
    whole = path.read_bytes()
    path.unlink()
    another_process()
    # The other process compiles, and this one waits for it; but not for ever.
    monkeypatch.setattr(_program_files, "LOCK_SECONDS", 60 if ends_well else 1)
    with ExitStack() as lock, ThreadPoolExecutor(1) as pool:
        lock.enter_context(_program_files.program_lock(path))
        found = pool.submit(ask)
        with pytest.raises(TimeoutError):
            found.result(timeout=0.5)
        assert not traced
        if ends_well:
            write_private(path, whole)
            lock.close()
        np.testing.assert_allclose(found.result().low, [0, 2])
    assert traced == ([] if ends_well else [2])
    assert [path.suffix for path in kept.iterdir()] == [".program"]


def loud(x):
    jax.debug.print("{}", x)
    return 2 * x


def test_what_cannot_be_kept_runs(kept):
    assert run(loud, jnp.ones(())) == 2
    assert not list(kept.iterdir())


def test_it_keeps_nothing_unasked(kept):
    halves = Halves(jnp.arange(5.0), None)
    run(split, halves, 4.0, keep=False, at=2)
    assert not kept.exists()


def test_what_jax_prints_or_keeps_is_no_part_of_the_name(kept, monkeypatch):
    ask()
    for name, value in (
        ("jax_compilation_cache_dir", str(kept.parent / "xla")),
        ("jax_logging_level", "ERROR"),
    ):
        monkeypatch.setitem(jax.config.values, name, value)
    another_process()
    ask()
    assert not traced and len(list(kept.iterdir())) == 1


def test_a_folder_that_cannot_be_made_is_no_error(kept, monkeypatch, tmp_path):
    file = tmp_path / "file"
    file.write_text("")
    monkeypatch.setenv("JFSF_CACHE", str(file / "jfsf"))
    np.testing.assert_allclose(ask().low, [0, 2])


def asked_by_a_new_process() -> str:
    """What `ask` gives there, and what it traced."""
    script = f"""
import sys
from pathlib import Path
import jax
jax.config.update("jax_enable_x64", True)
sys.path.insert(0, {str(Path(__file__).parent)!r})
import test_programs
test_programs._program_files.OWN += ("test_programs",)
print(test_programs.ask().low, test_programs.traced)
"""
    return subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    ).stdout.strip()


def test_a_new_process_runs_what_another_compiled(tmp_path, monkeypatch):
    # In one that has not lowered any, a factorisation would crash.
    monkeypatch.setenv("JFSF_CACHE", str(tmp_path / "jfsf"))
    said = [asked_by_a_new_process() for _ in range(2)]
    assert said == ["[0. 2.] [2]", "[0. 2.] []"]


def test_what_jaxs_own_cache_gives_is_not_kept_without_its_code(tmp_path, monkeypatch):
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path / "jax"))
    monkeypatch.setenv("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    for folder in "one", "another", "another":
        monkeypatch.setenv("JFSF_CACHE", str(tmp_path / folder))
        assert asked_by_a_new_process().startswith("[0. 2.]"), folder
    # What was compiled is kept, and that of the cache is not.
    programs = [list((tmp_path / f / "programs").glob("*")) for f in ("one", "another")]
    assert list(map(len, programs)) == [1, 0]


WITH_OWNERS = pytest.mark.skipif(not hasattr(os, "getuid"), reason="needs file owners")
AS_ROOT = pytest.mark.skipif(
    not hasattr(os, "getuid") or os.getuid() != 0, reason="only root gives files away"
)


class Hostile:
    """A pickle that makes a file when it is read."""

    def __init__(self, marker):
        self.marker = marker

    def __reduce__(self):
        return Path.touch, (self.marker,)


@pytest.fixture
def hostile(kept, tmp_path):
    """A file at the place of `ask`'s program that would run; and what it would make."""
    ask()
    (path,) = kept.iterdir()
    marker = tmp_path / "marker"
    payload = pickle.dumps(Hostile(marker))
    path.write_bytes(hashlib.sha256(payload).digest() + payload)
    another_process()
    return path, marker


def in_a_world_writable_folder(path):
    path.parent.chmod(0o777)


def in_a_sticky_folder(path):
    path.parent.chmod(0o1777)


def of_another_user(path):
    os.chown(path, 12345, -1)


def in_a_folder_of_another_user(path):
    os.chown(path.parent, 12345, -1)


def as_a_link(path):
    path.rename(path.parent.parent / "elsewhere")
    path.symlink_to(path.parent.parent / "elsewhere")


def in_a_linked_folder(path):
    path.parent.rename(path.parent.parent / "elsewhere")
    path.parent.symlink_to(path.parent.parent / "elsewhere")


def group_writable(path):
    path.chmod(0o660)


def in_a_group_writable_folder(path):
    path.parent.chmod(0o770)


@WITH_OWNERS
@pytest.mark.parametrize(
    ("expose", "said"),
    [
        (in_a_world_writable_folder, r"programs \(mode 0777\).*chmod 700"),
        (in_a_sticky_folder, r"programs \(mode 1777\).*chmod 700"),
        (in_a_group_writable_folder, r"programs \(mode 0770\).*chmod 700"),
        (group_writable, r"\.program \(mode 0660\).*chmod 600"),
        (as_a_link, r"\.program is a symbolic link"),
        (in_a_linked_folder, "programs is a symbolic link"),
        pytest.param(of_another_user, r"\.program belongs to user 1", marks=AS_ROOT),
        pytest.param(
            in_a_folder_of_another_user, "programs belongs to user 1", marks=AS_ROOT
        ),
    ],
)
def test_what_another_user_may_have_written_does_not_run(hostile, expose, said):
    path, marker = hostile
    expose(path)
    before = path.read_bytes()
    with pytest.warns(RuntimeWarning, match=said) as raised:
        for _ in range(2):
            np.testing.assert_allclose(ask().low, [0, 2])
            _programs.known.clear()
    assert len(raised) == 1 and "JFSF_CACHE" in str(raised[0].message)
    assert traced == [2, 2] and not marker.exists()
    # Nothing is written there either.
    assert path.read_bytes() == before and list(path.parent.iterdir()) == [path]


@WITH_OWNERS
def test_what_is_swapped_after_the_check_is_not_read(hostile, monkeypatch):
    # Folder and file are checked as opened: another folder of that name is not read.
    path, marker = hostile
    private = path.read_bytes()
    real = storage._cache._open_folder

    def swapped(folder):
        opened = real(folder)
        folder.rename(folder.parent / "before")
        folder.mkdir()
        (folder / path.name).write_bytes(b"another's")
        return opened

    monkeypatch.setattr(storage._cache, "_open_folder", swapped)
    assert read_private(path) == private
    assert not marker.exists()


@WITH_OWNERS
def test_the_marker_shows_that_a_program_ran(hostile):
    # By a user's own hand it does run: so the tests above show something.
    _, marker = hostile
    np.testing.assert_allclose(ask().low, [0, 2])
    assert marker.exists()


@WITH_OWNERS
@pytest.mark.parametrize("umask", [0, 0o002, 0o077])
def test_programs_are_private_whatever_the_umask(kept, umask):
    before = os.umask(umask)
    try:
        ask()
    finally:
        os.umask(before)
    (path,) = kept.iterdir()
    assert not (path.stat().st_mode | kept.stat().st_mode) & 0o022
    another_process()
    ask()
    assert not traced


FIND = f"""
import os
import sys
from pathlib import Path
sys.path.insert(0, {str(Path(__file__).parent)!r})
import test_programs
import jax
import jax.numpy as jnp
from jfsf.runtime._program_files import load_program
from jfsf.storage._cache import programs_folders
jax.jit(jnp.linalg.cholesky)(jnp.eye(1))
# Python itself may be where that user cannot read.
os.setgroups([])
os.setgid(12345)
os.setuid(12345)
print(programs_folders()[0])
try:
    print(load_program(Path(sys.argv[1]), 2)[0] is not None)
except Exception as error:
    print(error)
"""


@pytest.mark.slow
@AS_ROOT
@pytest.mark.parametrize("owner, read", [(0, True), (54321, False)])
def test_another_user_runs_what_root_has_compiled_and_nobody_else(kept, owner, read):
    # As in a container: the image is built by root, and run as somebody.
    ask()
    (path,) = kept.iterdir()
    for place in (kept, path):
        os.chown(place, owner, -1)
    home = kept.parent.parent / "home"
    home.mkdir()
    for place in home.parents:
        if place.stat().st_uid == os.getuid() and place != Path("/"):
            place.chmod(place.stat().st_mode | 0o055)
    os.chown(home, 12345, 12345)
    said = subprocess.run(
        [sys.executable, "-c", FIND, str(path)],
        env={**os.environ, "HOME": str(home), "XDG_CACHE_HOME": ""},
        capture_output=True,
        text=True,
        check=True,
    ).stdout.splitlines()
    if read:
        assert said == [str(home / ".cache" / "jfsf" / "programs"), "True"]
    else:
        assert said[0] == str(kept) and "belongs to user 54321" in said[1]


def test_without_owners_only_the_platforms_folder_is_trusted(
    kept, monkeypatch, tmp_path
):
    monkeypatch.delattr(os, "getuid", raising=False)
    own = tmp_path / "own"
    monkeypatch.setattr(platformdirs, "user_cache_dir", lambda name: str(own / name))
    ask()
    another_process()
    ask()
    assert not traced and not kept.exists()
    assert len(list((own / "jfsf" / "programs").iterdir())) == 1
    assert len(stored_files()) == 1


def test_the_least_recently_used_program_is_dropped(kept, monkeypatch):
    monkeypatch.setattr(_programs, "MOST_KNOWN", 2)
    for at in (2, 3, 2, 4):
        ask(at=at)
    assert traced == [2, 3, 4] and len(_programs.known) == 2
    ask(at=2)
    assert traced == [2, 3, 4]
    ask(at=3)  # dropped, and on disk
    assert traced == [2, 3, 4] and len(_programs.known) == 2
    shutil.rmtree(kept)
    np.testing.assert_allclose(ask(at=4).low, [0, 2, 4, 6])
    assert traced == [2, 3, 4, 4]


def test_a_program_that_is_loaded_is_as_good_as_new(kept, monkeypatch):
    ask()
    (path,) = kept.iterdir()
    os.utime(path, (1, 1))
    another_process()
    ask()
    assert path.stat().st_mtime > 1e9


def test_programs_make_room_for_each_other(kept, monkeypatch):
    ask()
    (first,) = kept.iterdir()
    os.utime(first, (1, 1))
    gigabytes = 1.5 * first.stat().st_size / 1e9
    monkeypatch.setenv("JFSF_CACHE_LIMIT", f"{gigabytes:.9f}")
    ask(at=3)
    assert len(list(kept.iterdir())) == 1 and not first.exists()


def test_a_wrong_limit_is_an_error_before_the_work(kept, monkeypatch):
    monkeypatch.setenv("JFSF_CACHE_LIMIT", "much")
    with pytest.raises(ValueError, match="JFSF_CACHE_LIMIT is 'much'"):
        ask()
    assert not traced
    halves = Halves(jnp.arange(5.0), None)
    run(split, halves, 4.0, keep=False, at=2)


def test_fitted_constants_are_part_of_the_code(tmp_path):
    """What stands in a JSON of the package is compiled into programs too."""
    copy = tmp_path / "jfsf"
    shutil.copytree(_program_files.PACKAGE, copy)
    ask = [
        sys.executable,
        "-c",
        "from jfsf.runtime import _program_files as p;print(p.CODE)",
    ]
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    codes = set()
    for ending in ("", " "):
        constants = copy / "matching/confidence.json"
        constants.write_text(constants.read_text() + ending)
        done = subprocess.run(ask, env=environment, capture_output=True, cwd=tmp_path)
        codes.add(done.stdout)
    assert len(codes) == 2 and b"" not in codes


def test_threads_set_back_what_the_first_found():
    values, found = [0], []

    @shared_context
    def changed():
        before, values[0] = values[0], 1
        yield
        values[0] = before

    one, other = changed(), changed()
    for step in (one.__enter__, other.__enter__, lambda: one.__exit__(*[None] * 3)):
        step()
        found.append(values[0])
    other.__exit__(None, None, None)
    assert found == [1, 1, 1] and values == [0]
    with pytest.raises(KeyError), changed():
        raise KeyError
    assert values == [0]

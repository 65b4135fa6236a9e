"""Programs that are compiled early, with options, or kept on disk: same results."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jfsf import storage
from jfsf.settings import Settings
from jfsf.storage import _programs


def centred(x, *, axis):
    return x - x.mean(axis, keepdims=True)


def test_the_result_is_that_of_jit():
    x = jnp.arange(12.0).reshape(3, 4)
    moved = storage.large_jit(centred, "cpu", static_argnames="axis")
    np.testing.assert_allclose(moved(x, axis=1), centred(x, axis=1))


def test_it_compiles_once():
    runs = [storage.large_jit(centred, "cpu", static_argnames="axis") for _ in range(2)]
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
    return storage.compile_ahead(function, *args, **options)(*args)


def ask(scale=4.0, at=2):
    halves = Halves(jnp.arange(5.0), None)
    return run(split, halves, scale, at=at)


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """Programs are kept in this folder, and none is known yet."""
    monkeypatch.setenv("JFSF_CACHE", str(tmp_path / "jfsf"))
    _programs.known.clear()
    traced.clear()
    yield tmp_path / "jfsf"
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


def test_other_code_or_parts_are_other_names():
    names = [
        _programs.program_key(split, "one"),
        _programs.program_key(split, "two"),
        _programs.program_key(run, "one"),
        _programs.program_key(split, "one", code="newer"),
    ]
    assert len(set(names)) == 4
    assert names[0] == _programs.program_key(split, "one")


def with_settings(x, *, settings):
    return settings.converter(x)


def doubled(x):
    return 2 * x


def test_settings_are_part_of_the_name(kept):
    # A changed number is another program, also for another process.
    x = jnp.ones(2)
    for _ in range(2):
        for settings in (Settings(), Settings(bend_rounds=3)):
            storage.compile_ahead(described, x, settings=settings)
        another_process()
    assert len(list(kept.iterdir())) == 2


def described(x, *, settings):
    return settings.bend_rounds * x


def test_a_program_with_code_from_elsewhere_is_not_kept(kept):
    # Its name could not tell when that code has changed.
    settings = Settings(converter=doubled)
    assert run(with_settings, jnp.ones(()), settings=settings) == 2
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
    monkeypatch.setattr(_programs, "LOCK_SECONDS", 60 if ends_well else 1)
    release = _programs._lock(path)
    with ThreadPoolExecutor(1) as pool:
        found = pool.submit(ask)
        with pytest.raises(TimeoutError):
            found.result(timeout=0.5)
        assert not traced
        if ends_well:
            path.write_bytes(whole)
            release()
        np.testing.assert_allclose(found.result().low, [0, 2])
    assert traced == ([] if ends_well else [2])
    release()
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


def test_a_folder_that_cannot_be_made_is_no_error(kept, monkeypatch):
    (kept.parent / "file").write_text("")
    monkeypatch.setenv("JFSF_CACHE", str(kept.parent / "file" / "jfsf"))
    np.testing.assert_allclose(ask().low, [0, 2])


def test_a_new_process_runs_what_another_compiled(tmp_path, monkeypatch):
    # In one that has not lowered any, a factorisation would crash.
    script = f"""
import sys
from pathlib import Path
import jax
jax.config.update("jax_enable_x64", True)
sys.path.insert(0, {str(Path(__file__).parent)!r})
import test_programs
print(test_programs.ask().low, test_programs.traced)
"""
    monkeypatch.setenv("JFSF_CACHE", str(tmp_path / "jfsf"))
    said = [
        subprocess.run(
            [sys.executable, "-c", script], capture_output=True, text=True, check=True
        ).stdout.strip()
        for _ in range(2)
    ]
    assert said == ["[0. 2.] [2]", "[0. 2.] []"]

"""How the stages of a match are run: pair by pair, many vmapped, or only compiled.

A stage is a `partial` of a pure function of arrays, with static options. A runner maps
it over a list of inputs; what calls a runner need not know which one it is.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from functools import partial
from typing import Any, NamedTuple, Protocol

import jax
import jax.numpy as jnp

from jfsf.runtime._map_pairs import PAIRS, map_pairs
from jfsf.runtime._programs import Program, compile_ahead

# Bytes of a shape of some 120 000 vertices. Two larger ones at a time need twice the
# memory and save nothing: one keeps all cores busy.
LARGE_BYTES = 1 << 26


class Runner(Protocol):
    """Maps a stage over inputs."""

    def map(
        self, name: str, stage: partial, inputs: Sequence[tuple], at_a_time: int = 1
    ) -> list[Any]:
        """stage(*input) for each of `inputs`.

        Args:
            name: of the stage, for people.
            stage: a `partial` of a function of arrays.
            inputs: tuples of records of arrays.
            at_a_time: small inputs that may be run side by side on a CPU.
        """
        ...


class OneByOne(NamedTuple):
    """A program a stage, compiled ahead (`compile_ahead`), for one input after another.

    keep: keep the programs on disk.
    progress: called with the name of a stage as it begins.
    """

    keep: bool = True
    progress: Callable[[str], object] | None = None

    def map(self, name, stage, inputs, at_a_time=1) -> list[Any]:
        """As `Runner` says; a result is there when it is returned."""
        if self.progress is not None:
            self.progress(name)
        # Not in the threads: they see neither `with jax.default_device(...)` nor
        # `with jax.enable_x64(...)` around.
        inputs = [jax.tree.map(_on_device, args) for args in inputs]
        options = {**stage.keywords, "keep": self.keep}
        programs = [compile_ahead(stage.func, *args, **options) for args in inputs]
        run = lambda program, args: jax.block_until_ready(program(*args))
        if at_a_time == 1 or any(map(_is_large, inputs)):
            return list(map(run, programs, inputs))
        with ThreadPoolExecutor(at_a_time) as pool:
            return list(pool.map(run, programs, inputs))


class Vmapped(NamedTuple):
    """Many inputs a call, vmapped and shared by the devices: see `map_pairs`."""

    devices: Sequence[Any] | None = None
    pairs: int = PAIRS
    batch_size: int | None = None

    def map(self, name, stage, inputs, at_a_time=1) -> list[Any]:
        """As `Runner` says; results are numpy arrays."""
        del name, at_a_time
        options = {**self._asdict(), **stage.keywords}
        return map_pairs(stage.func, inputs, called=None, fast_compile=True, **options)


class CompileOnly(NamedTuple):
    """Compiles the programs of `OneByOne`; inputs and results are shapes and types.

    keep: keep the programs on disk.
    pool: compiles, beside the caller; without it, the caller waits.
    programs: a list to which all programs are added.
    """

    keep: bool
    pool: Executor | None = None
    programs: list[Program] | None = None

    def map(self, name, stage, inputs, at_a_time=1) -> list[Any]:
        """As `Runner` says."""
        del name, at_a_time
        options = {**stage.keywords, "keep": self.keep, "pool": self.pool}
        programs = [compile_ahead(stage.func, *args, **options) for args in inputs]
        if self.programs is not None:
            self.programs.extend(programs)
        return [program.result for program in programs]


def _on_device(leaf):
    return leaf if isinstance(leaf, jax.Array) else jnp.asarray(leaf)


def _is_large(args: tuple) -> bool:
    return (
        sum(getattr(leaf, "nbytes", 0) for leaf in jax.tree.leaves(args)) > LARGE_BYTES
    )

"""Shapes that were checked -> all attempts, and the match. Host side.

`warm_up` compiles the programs of `match` before there are shapes.
"""

from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from time import perf_counter
from typing import NamedTuple

import jax
import jax.numpy as jnp

from jfsf.initial import orientation_sign
from jfsf.matching._arguments import MatchInputs, padded_inputs
from jfsf.matching._pairs import PairState
from jfsf.matching._policy import attempt_pairs, compile_copies, compile_first_attempt
from jfsf.matching._settings import Settings
from jfsf.matching._shapes import MatchedShape, basis_of
from jfsf.runtime._runners import CompileOnly, OneByOne
from jfsf.runtime._shared import one_blas_thread
from jfsf.runtime._sizes import common_size, padded, padded_shapes, spectrum_like
from jfsf.types import Match


class Host(NamedTuple):
    """What is kept on disk, and who is told of the stages."""

    keep_programs: bool
    keep_spectra: bool
    progress: Callable[[str], object] | None = None

    def say(self, name: str) -> None:
        if self.progress is not None:
            self.progress(name)


def match_shapes(
    shapes: Mapping[str, MatchedShape],
    inputs: MatchInputs,
    settings: Settings,
    host: Host,
) -> Match:
    """Of the first shape and the last, which may be one."""
    return attempted(shapes, inputs, settings, host).result(settings)


def attempted(
    shapes: Mapping[str, MatchedShape],
    inputs: MatchInputs,
    settings: Settings,
    host: Host,
) -> PairState:
    """All attempts of the first shape and the last, which may be one; padded."""
    host.say("spectra")
    started = perf_counter()
    surfaces = [shape.surface for shape in shapes.values()]
    k = settings.eigenpairs(min(len(mesh.vertices) for mesh in surfaces))
    sizes = padded_shapes(k, [(len(m.vertices), len(m.faces)) for m in surfaces])
    given = padded_inputs(inputs, sizes)
    # Threads for the spectra, and two that compile.
    threads = ThreadPoolExecutor(len(shapes) + 2)
    with one_blas_thread(), threads as pool:
        # Two spectra with two threads each take longer than one after the other.
        alone, keep = len(shapes) == 1, host.keep_spectra
        specs = pool.map(
            lambda item: basis_of(item[1], item[0], settings, keep, threads=alone),
            shapes.items(),
        )
        # Compiling or loading the programs takes as long as the spectra, or longer.
        like = [spectrum_like(size) for size in sizes]
        compiler = CompileOnly(host.keep_programs, pool, programs := [])
        like_pair = PairState((like[0], like[-1]), given)
        compile_first_attempt(like_pair, compiler, settings=settings)
        specs = [
            jax.tree.map(jnp.asarray, padded(spec, size))
            for spec, size in zip(specs, sizes, strict=True)
        ]
        if not all(program.ready() for program in programs):
            host.say("compiling, once for shapes of about this size")
    unpadded = len(surfaces[0].vertices), len(surfaces[-1].vertices)
    pair = PairState((specs[0], specs[-1]), given, unpadded=unpadded)
    pair.seconds["spectra"] = perf_counter() - started

    runner = OneByOne(host.keep_programs, host.progress)
    attempt_pairs([pair], runner, settings=settings)
    return pair


def warm_up(
    vertices: Iterable[int] = (5000,),
    *,
    settings: Settings = Settings(),
    progress: Callable[[str], object] | None = None,
) -> int:
    """Compile what `match` needs for meshes of these sizes, and keep it on disk.

    Then the first `match` of such a pair on this machine compiles nothing: for the
    image of a container, or before a batch. Programs are kept by what they depend on
    (`compile_ahead`), so they serve `match` with the same settings, in
    jax's same precision, on the same kind of processor.

    Args:
        vertices: numbers of vertices of the meshes. Shapes are padded, so each number
            stands for a range: 5000 for 2561 to 5120 (`common_size`). A mesh has at
            most twice as many faces. A pair takes the size of its larger shape. Shapes
            with fewer than 4 `Settings.k` vertices have fewer eigenpairs, and programs
            of their own for most numbers of vertices.
        settings: those that `match` will be called with.
        progress: called with a line as each step begins.

    Returns:
        The number of programs, including those that were there already.

    Raises:
        ValueError: fewer vertices than `match` takes, or devices other than one CPU,
            whose programs are not kept.
    """
    vertices = list(vertices)
    if few := [n for n in vertices if n < settings.min_vertices]:
        raise ValueError(
            f"warm_up: {few[0]} vertices; matching needs {settings.min_vertices}"
        )
    if (kinds := [device.platform for device in jax.devices()]) != ["cpu"]:
        raise ValueError(
            f"warm_up: the devices are {', '.join(kinds)}; programs are kept on disk "
            "for one CPU alone, set JAX_PLATFORMS=cpu"
        )
    say = progress or (lambda line: None)
    runner = CompileOnly(True, programs=(programs := []))
    sizes = sorted({(common_size(n), settings.eigenpairs(n)) for n in vertices})
    for size, k in sizes:
        say(f"programs for up to {size} vertices")
        pair = _like(size, k)
        compile_first_attempt(pair, runner, settings=settings)
    say("programs for pairs in doubt")
    # A shape of fewer vertices is its own coarse copy.
    few = settings.coarse_vertices
    for size, k in sorted({(min(size, few), k) for size, k in sizes}):
        copy = _like(size, k)
        compile_copies(copy, runner, settings=settings)
    return len(set(map(id, programs)))


def _like(size: int, eigenpairs: int) -> PairState:
    """Two meshes of one size, without values."""
    shapes = padded_shapes(eigenpairs, [(size, 2 * size)] * 2)
    x, y = map(spectrum_like, shapes)
    return PairState((x, y), MatchInputs(sign=orientation_sign("preserve")))

"""Shapes that were checked -> all attempts, and the match. Host side."""

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from time import perf_counter
from typing import NamedTuple

import jax
import jax.numpy as jnp

from jfsf.matching._arguments import MatchInputs, padded_inputs
from jfsf.matching._pairs import PairState
from jfsf.matching._policy import attempt_pairs, compile_first_attempt
from jfsf.matching._settings import Settings
from jfsf.matching._shapes import MatchedShape, basis_of
from jfsf.runtime._runners import CompileOnly, OneByOne
from jfsf.runtime._shared import one_blas_thread
from jfsf.runtime._sizes import padded, padded_shapes, spectrum_like
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

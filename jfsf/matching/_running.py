"""The stages of a match as compiled programs, on the host: one program a stage.

So the largest, the search, serves shapes of all sizes, and starts that nobody needs are
neither compiled nor tried. `jfsf.match_spectra` is the same in one program.
"""

from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jfsf.pipeline import InitialMap, misses_landmarks, run_stages, stage_name
from jfsf.settings import Settings
from jfsf.sizes import Given
from jfsf.storage import Program, compile_ahead
from jfsf.types import Match, Spectrum

# Bytes of a shape of some 120 000 vertices. Two larger ones at a time need twice the
# memory and save nothing: one keeps all cores busy.
LARGE = 1 << 26


def compile_stages(
    like_x: Spectrum,
    like_y: Spectrum,
    given: Given,
    settings: Settings,
    *,
    keep: bool,
    pool: Executor,
) -> None:
    """Have the programs compiled that every pair needs; few pairs need others.

    Args:
        like_x, like_y: shapes and types of the spectra (`jfsf.sizes.spectrum_like`).
        given: the other arguments, padded.
        settings: of all stages.
        keep: see `jfsf.storage.compile_ahead`.
        pool: compiles, beside the caller.
    """
    stage_result = partial(_result_shapes, keep=keep, pool=pool)
    run_stages(
        *(like_x, like_y, *given),
        settings=settings,
        run=stage_result,
        run_sides=lambda stage, *sides: [stage_result(stage, *s) for s in sides],
        most_confident=lambda attempt, first, *_: attempt(first),
    )


def run_compiled(
    spec_x: Spectrum,
    spec_y: Spectrum,
    given: Given,
    settings: Settings,
    *,
    keep: bool,
    progress: Callable[[str], object] | None = None,
    coarse: Callable[[], InitialMap | None] | None = None,
) -> Match:
    """The match, stage by stage; programs that are missing are compiled.

    Args:
        spec_x, spec_y, given: padded.
        settings: of all stages.
        keep: see `jfsf.storage.compile_ahead`.
        progress: called with the name of each stage as it begins.
        coarse: see `jfsf.pipeline.run_stages`.
    """
    run, run_sides = partial(run_stage, keep=keep), partial(_run_sides, keep=keep)
    if progress is not None:
        run, run_sides = _announced(run, progress), _announced(run_sides, progress)
    return run_stages(
        *(spec_x, spec_y, *given),
        settings=settings,
        run=run,
        run_sides=run_sides,
        most_confident=most_confident,
        most_promising=most_promising,
        coarse=coarse,
    )


def most_confident(attempt, first, others, retry_below: float) -> Match:
    """As `jfsf.pipeline.run_stages` asks for, without starts that nobody needs."""
    found = attempt(first)
    # Not so with nan: there is nothing to compare.
    doubtful = found.certificate.confidence < retry_below
    if not (doubtful or misses_landmarks(found)):
        return found
    for make in others:
        for start in _each(make()):
            other = attempt(start)
            if other.certificate.confidence > found.certificate.confidence:
                found = other
            if found.certificate.confidence >= retry_below:
                return found
    return found


def most_promising(promise, starts: InitialMap, num: int) -> InitialMap:
    """As `jfsf.pipeline.run_stages` asks for."""
    if len(starts.gap) <= num:
        return starts
    promised = np.array([float(promise(start)) for start in _each(starts)])
    order = np.argsort(-np.nan_to_num(promised, nan=-1.0), stable=True)[:num]
    return jax.tree.map(lambda values: np.asarray(values)[order], starts)


def _each(starts: InitialMap) -> list[InitialMap]:
    """The starts one by one."""
    host = jax.device_get(starts)
    one = lambda i: jax.tree.map(lambda values: jnp.asarray(values[i]), host)
    return [one(i) for i in range(len(host.gap))]


def run_stage(stage: partial, *args: Any, **options: Any) -> Any:
    """What the stage returns."""
    return _program(stage, *args, **options)(*args)


def _result_shapes(stage: partial, *args: Any, **options: Any) -> Any:
    """Shapes of what the stage returns; it compiles."""
    return _program(stage, *args, **options).result


def _run_sides(stage: partial, x: tuple, y: tuple, **options: Any) -> tuple[Any, Any]:
    """What the stage returns for either shape. On a CPU both run at a time if small."""
    # Not in the threads: they do not see a `with jax.default_device(...)` around this.
    x, y = jax.tree.map(jnp.asarray, (x, y))
    programs = [_program(stage, *side, **options) for side in (x, y)]
    with ThreadPoolExecutor(1 if _is_large(x) else 2) as pool:
        run = lambda program, side: jax.block_until_ready(program(*side))
        found_x, found_y = pool.map(run, programs, (x, y))
    return found_x, found_y


def _is_large(args: tuple) -> bool:
    return sum(leaf.nbytes for leaf in jax.tree.leaves(args)) > LARGE


def _announced(run: Callable, progress: Callable[[str], object]) -> Callable[..., Any]:
    """`run`, where each stage ends before the next is named."""

    def announced(stage, *args, **options):
        progress(stage_name(stage))
        return jax.block_until_ready(run(stage, *args, **options))

    return announced


def _program(stage: partial, *args, **options) -> Program:
    """The compiled stage for arguments of these shapes."""
    return compile_ahead(stage.func, *args, **stage.keywords, **options)

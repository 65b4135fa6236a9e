"""Compile the programs of `match` before there are shapes."""

from collections.abc import Callable, Iterable

import jax

from jfsf.initial import orientation_sign
from jfsf.matching._arguments import MatchInputs
from jfsf.matching._pairs import PairState
from jfsf.matching._policy import compile_copies, compile_first_attempt
from jfsf.matching._settings import Settings
from jfsf.runtime._runners import CompileOnly
from jfsf.runtime._sizes import common_size, padded_shapes, spectrum_like


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
                most
            twice as many faces. A pair takes the size of its larger shape. Shapes with
            fewer than 4 `Settings.k` vertices have fewer eigenpairs, and programs for
            most numbers of vertices.
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

"""jfsf warm-up: compile before there are shapes."""

from time import perf_counter
from typing import Annotated

import typer
from rich.console import Console

from jfsf.apps.cli._stages import stage_bar
from jfsf.storage._folder import programs_folders


def warm_up(
    vertices: Annotated[
        list[int] | None,
        typer.Argument(
            help="Vertices of the meshes that will be matched; 5000 when absent.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Compile what jfsf match needs, and keep it in the cache folder.

    Then the first match on this machine takes no longer than later ones: for the image
    of a container, or the nodes of a cluster. Meshes are padded to common sizes, so one
    number stands for a range, 5000 for 2561 to 5120 vertices. Programs serve one kind
    of processor, and one version of jfsf and jax.

    Example: jfsf warm-up 1000 5000 20000
    """
    from jfsf import matching

    asked = vertices or [5000]
    started = perf_counter()
    with stage_bar() as begin:
        number = matching.warm_up(asked, progress=begin)
    seconds = perf_counter() - started
    Console().print(
        f"{number} programs in {programs_folders()[0]}, {seconds:.0f} s",
        soft_wrap=True,
        markup=False,
        highlight=False,
    )

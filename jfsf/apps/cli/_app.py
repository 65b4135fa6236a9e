"""jfsf: the application, its small commands, and exit codes.

Exit codes: 0 done, 1 bad input (one line on stderr says which), 2 wrong usage, 130
interrupted.
"""

from pathlib import Path
from time import perf_counter
from typing import Annotated

import typer
from typer.core import TyperGroup

from jfsf.apps.cli._batch import batch
from jfsf.apps.cli._collection import collection
from jfsf.apps.cli._evaluate import evaluate
from jfsf.apps.cli._files import can_write_in, need_matplotlib
from jfsf.apps.cli._info import info
from jfsf.apps.cli._match import match
from jfsf.apps.cli._morphometrics import morphometrics
from jfsf.apps.cli._print import (
    print_any_letter,
    say,
    say_result,
    sentence,
    stage_bar,
)
from jfsf.apps.cli._register import register
from jfsf.apps.cli._transfer import transfer
from jfsf.storage._cache import (
    PROGRAM,
    SPECTRUM,
    limit_bytes,
    programs_folders,
    remove_stored,
    stored_files,
)


class _OneLine(TyperGroup):
    """Turns an error about the input into one line on stderr and exit code 1."""

    def invoke(self, ctx):
        """Run the command."""
        try:
            return super().invoke(ctx)
        except (ValueError, ImportError, OSError) as error:
            typer.echo(f"jfsf: {sentence(error)}", err=True)
            raise typer.Exit(1) from None


app = typer.Typer(
    name="jfsf",
    cls=_OneLine,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)


def main() -> None:
    """Run the command line, and end the process."""
    print_any_letter()
    app()


def _version(asked: bool) -> None:
    if asked:
        from jfsf import __version__

        typer.echo(f"jfsf {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            callback=_version,
            is_eager=True,
            help="Print the version and exit.",
        ),
    ] = False,
) -> None:
    """Dense maps between non-rigid 3D shapes: Fast Sinkhorn Filters in JAX."""


@app.command()
def demo(
    pair: Annotated[
        tuple[str, str], typer.Option(help="Two embedded shapes, X and Y.")
    ] = ("man_walk", "man_up"),
    out: Annotated[Path, typer.Option(help="Folder for the JSON and the PNG.")] = Path(
        "jfsf-demo"
    ),
    report: Annotated[
        bool, typer.Option("--report", help="Also write a report (.html).")
    ] = False,
) -> None:
    """Match two embedded shapes; compare nearest neighbours with Sinkhorn.

    Example: jfsf demo --pair man_walk woman_up --out results --report
    """
    from jfsf.apps.cli._demo import measure, table, write, write_page

    if report:
        need_matplotlib()
    can_write_in(out)
    with stage_bar() as stage:
        result = measure(*pair, stage)
        stage("drawing")
        written = write(result, out)
        if report:
            stage("report")
            written.append(write_page(result, out))
    say_result([table(result.record)], (), (), written)


for _command in (
    match,
    register,
    transfer,
    batch,
    collection,
    morphometrics,
    evaluate,
    info,
):
    app.command()(_command)


@app.command("warm-up")
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

    Then the first match on this machine takes no longer than later ones: for container
    images, or the nodes of a cluster. Meshes are padded to common sizes, so one number
    stands for a range, 5000 for 2561 to 5120 vertices. Programs serve one kind of
    processor, and one version of jfsf and jax.

    Example: jfsf warm-up 1000 5000 20000
    """
    from jfsf import matching

    asked = vertices or [5000]
    started = perf_counter()
    with stage_bar() as begin:
        number = matching.warm_up(asked, progress=begin)
    seconds = perf_counter() - started
    say(f"{number} programs in {programs_folders()[0]}, {seconds:.0f} s")


@app.command()
def shapes(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="FOLDER", help="Folder for the files; created if needed."
        ),
    ],
) -> None:
    """Write the embedded shapes as mesh files: twelve posed people, under CC0.

    Each is NAME.ply, of about 5000 vertices, in metres, y up. The vertices of no two
    shapes correspond. Files that are there already stay as they are.

    Example: jfsf shapes bodies
    """
    from jfsf.apps.export import export_mesh
    from jfsf.data import load, names

    can_write_in(folder)
    folder.mkdir(parents=True, exist_ok=True)
    written = 0
    for name in names():
        # A new date would make `jfsf collection` do all of its work again.
        if not (path := folder / f"{name}.ply").exists():
            export_mesh(path, load(name).mesh)
            written += 1
    said = f"wrote {written} shapes to {folder}"
    if there := len(names()) - written:
        said += f", {there} were there"
    say(said)


@app.command()
def cache(
    clear: Annotated[
        bool, typer.Option("--clear", help="Remove all spectra and programs.")
    ] = False,
) -> None:
    """Show the cache folder: how much it holds, and its limit.

    JFSF_CACHE names the folder and JFSF_CACHE_LIMIT its limit in gigabytes; beyond it
    the least recently used files are removed. Other files are left alone.

    Example: jfsf cache --clear
    """
    from jfsf import storage

    limit = limit_bytes()
    files = stored_files()
    lines = [f"folder: {storage.folder()}"]
    lines += [
        f"folder of programs: {place}"
        for place in programs_folders()
        if place.parent != storage.folder()
    ]
    for name, suffix in (("spectra", SPECTRUM), ("programs", PROGRAM)):
        sizes = [file.size for file in files if file.path.suffix == suffix]
        lines.append(f"{name}: {len(sizes)}, {_size(sum(sizes))}")
    lines.append(f"limit: {_size(limit)}")
    if clear:
        freed = [remove_stored(file) for file in files]
        kept = sum(file.path.exists() for file in files)
        lines.append(f"removed: {len(files) - kept} files, {_size(sum(freed))} freed")
        if kept:
            lines.append(f"not removed: {kept} files of another user")
    say(*lines)


def _size(num_bytes: float) -> str:
    return (
        f"{num_bytes / 1e6:.1f} MB" if num_bytes < 1e9 else f"{num_bytes / 1e9:.3g} GB"
    )

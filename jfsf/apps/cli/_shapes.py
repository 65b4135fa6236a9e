"""jfsf shapes: the embedded shapes as files, to try the other commands on."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from jfsf.apps.cli._files import can_write_in


def shapes(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="For the files; made if need be.")
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
    Console().print(said, soft_wrap=True, markup=False)

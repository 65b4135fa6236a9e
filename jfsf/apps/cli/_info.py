"""jfsf info: what is in a mesh file, what is wrong with it, and what would mend it."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

from jfsf.apps.cli import _options as opt
from jfsf.apps.cli._files import can_export, pieces_beside, sides_in_doubt
from jfsf.apps.cli._print import said, say, say_result
from jfsf.types import Mesh


def info(
    path: Annotated[Path, typer.Argument(metavar="MESH", help=opt.FORMATS)],
    repair: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write the repaired mesh: .ply, .obj or .glb. Its vertices are "
            "renumbered; in Python jfsf.mesh.repair returns both numberings.",
        ),
    ] = None,
) -> None:
    """Examine a mesh file: whether it can be matched, and what would mend it.

    A repair removes vertices whose coordinates are not finite; merges vertices with
    equal coordinates; removes duplicate faces, small components and vertices without a
    face; mends spikes and faces without area; and winds the faces outward. Exit code 0
    if the mesh can be matched (after the repair, if --repair is given), 1 if not.

    Example: jfsf info scan.obj --repair scan.ply
    """
    from jfsf.apps.export import export_mesh
    from jfsf.matching import check_matchable
    from jfsf.mesh import MeshError, check, read_noted, reconstruct, without_strays
    from jfsf.mesh import repair as repaired
    from jfsf.mesh._partners import without_nonfinite

    if repair is not None:
        can_export([repair], (path,))
    file, notes = read_noted(path, finite=False)
    mesh = without_nonfinite(file, name=str(path)).mesh
    notes = *notes, *_not_finite(file), *_flaws(mesh)
    say_result([_table(path.name, check(mesh))], notes, (), ())
    try:
        mended = repaired(file, name=str(path))
    except MeshError as error:
        say(f"cannot be matched: {said(error)}")
        raise typer.Exit(1) from None
    if mended.done:
        would = "would mend" if repair is None else "mended"
        say(f"--repair {would}: {', '.join(mended.done)}")
    if repair is not None:
        export_mesh(repair, mended.mesh)
        say(f"wrote {repair}")
        mesh, file, path = mended.mesh, mended.mesh, repair
    try:
        check_matchable(without_strays(file).mesh, name=str(path))
    except MeshError as error:
        say(f"cannot be matched: {said(error)}")
        if mended.done and repair is None:
            say(_after(mended.mesh, path))
        raise typer.Exit(1) from None
    sides = ""
    if len(mesh.faces) == 0:
        sides = "; its points have no clear outside: no left can be told from right"
        if len(reconstruct(mesh).surface.faces):
            sides = "; the surface through its points tells left from right"
    elif doubt := sides_in_doubt(mesh):
        sides = f"; {doubt}, so left and right may be swapped"
    say(f"can be matched{sides}")


def _table(name: str, report) -> Table:
    shown = Table(title=escape(name), show_header=False)
    for row, value in report._asdict().items():
        if value is not None:
            words = {True: "yes", False: "no"}
            text = words[value] if isinstance(value, bool) else f"{value:.6g}"
            shown.add_row(row.replace("_", " "), text)
    return shown


def _not_finite(file: Mesh) -> list[str]:
    """Which vertices have coordinates that are not finite."""
    bad = np.flatnonzero(~np.isfinite(file.vertices).all(axis=1))
    if not len(bad):
        return []
    first = ", ".join(map(str, bad[:5])) + (", ..." if len(bad) > 5 else "")
    number = f"{len(bad)} of {len(file.vertices)} vertices"
    return [f"not finite: {number} ({first}), left out here; --repair removes them"]


def _pieces(mesh: Mesh) -> list[str]:
    """What there is beside the largest component."""
    from jfsf.mesh import largest_component

    if len(mesh.faces) == 0:
        return []
    counts, share = pieces_beside(mesh, largest_component(mesh).index)
    if len(counts) == 0:
        return []
    low, high = int(counts.min()), int(counts.max())
    size = f"{low} to {high} faces" if low < high else f"{low} face{'s' * (low > 1)}"
    each = " each" * (low == high and len(counts) > 1)
    return [
        f"separate pieces: {len(counts)} beside the largest, of {size}{each}, "
        f"{share:.2%} of the area"
    ]


def _flaws(mesh: Mesh) -> list[str]:
    """What the matching takes away itself, what it is misled by, and what mends it."""
    from jfsf.mesh import (
        orient,
        rounding,
        surface_area,
        unclear_winding,
        without_holes,
        without_strays,
    )
    from jfsf.mesh._denoise import noise, spikes, without_spikes
    from jfsf.mesh._winding import MAX_UNCLEAR

    flaws = []
    if (coarse := rounding(mesh)) is not None:
        flaws.append(f"rounded: {coarse}")
    flaws += _pieces(mesh)
    if number := len(mesh.vertices) - len(without_strays(mesh).mesh.vertices):
        flaws.append(f"vertices without a face: match leaves out {number}")
    if number := int(spikes(mesh).sum()):
        flaws.append(f"spikes: match flattens them, at {number} or more vertices")
    if size := noise(without_spikes(mesh)):
        share = size / np.sqrt(surface_area(mesh))
        flaws.append(f"noise: {share:.2%} of sqrt(area); match smooths it away")
    share = unclear_winding(mesh)
    if 0 < share <= MAX_UNCLEAR:
        flaws.append(
            f"unclear winding: {share:.2%} of the area; the rest tells left from right"
        )
    wound = orient(mesh)
    if number := len(without_holes(wound).faces) - len(wound.faces):
        flaws.append(f"small holes: match closes them, with {number} new faces")
    return flaws


def _after(mesh: Mesh, path: Path) -> str:
    from jfsf.matching import check_matchable
    from jfsf.mesh import MeshError

    try:
        check_matchable(mesh, name=str(path))
    except MeshError as error:
        return f"repaired, it still could not: {said(error)}"
    return "repaired, it can be: pass --repair to match"

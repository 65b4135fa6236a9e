"""jfsf match --components: shapes of several pieces, matched piece to piece."""

from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from jfsf.apps.cli._files import Shape, sides_in_doubt
from jfsf.apps.cli._pair import Pictures, Seen, draw
from jfsf.apps.cli._print import WARNING, counted, say_result, stage_bar
from jfsf.apps.report._words import verdict, warnings_of


def check_components_options(given: dict[str, Any]) -> None:
    """ValueError if options were given that do not go with --components.

    Args:
        given: the values of the other options, by name; None, False and empty ones were
            not given.
    """
    # Not by equality: the base 0 is an option that was given.
    absent = [
        value is None or value is False or value == [] for value in given.values()
    ]
    wrong = [name for name, left in zip(given, absent, strict=True) if not left]
    if wrong:
        what = "leave it out" if len(wrong) == 1 else "leave them out"
        if "--repair" in wrong:
            what += "; jfsf info X --repair FILE writes a repaired mesh"
        raise ValueError(f"--components does not go with {', '.join(wrong)}: {what}")


def match_pieces(
    paths: tuple[Path, Path],
    out: Path,
    orientation: str,
    pictures: Pictures,
    *,
    cache: bool,
) -> None:
    """Match two files piece to piece, write the map, and print what was found."""
    from jfsf.apps.pieces import match_components
    from jfsf.apps.pieces._match import write_components
    from jfsf.mesh import MeshError, read_noted

    read = [read_noted(path) for path in paths]
    notes = [
        f"{path}: {note}"
        for path, (_, passed) in zip(paths, read, strict=True)
        for note in passed
    ]
    with stage_bar() as stage:
        try:
            found = match_components(
                *(mesh for mesh, _ in read),
                orientation=orientation,  # type: ignore
                cache=cache,
                progress=stage,
            )
        except MeshError as error:
            x, y = map(str, paths)
            name = {"mesh_x": x, "mesh_y": y}.get(error.name, error.name)
            raise error.named(name) from None
        stage("writing")
        notes += _said(paths, found) + _doubts(paths, found, orientation)
        write_components(out, found, notes=notes)
        x, y = (Shape(mesh, None, None, mesh) for mesh, _ in read)
        notes = draw(pictures, (x, y), paths, _seen(found)) + notes
    written = out, pictures.png, *pictures.exports
    say_result([pieces_table(found)], notes, (), written)


def _seen(found) -> Seen:
    """Of all pieces; what has no partner is grey."""
    there = tuple(np.asarray(T) >= 0 for T in (found.T_xy, found.T_yx))
    return Seen(np.where(there[0], found.T_xy, 0), *there)


def pieces_table(found) -> Table:
    """A row for each pair of pieces (`MatchedComponents`), counted from 0."""
    shown = Table(title="pieces that were matched")
    for name in ("pair", "vertices of X", "of Y", "area of X", "of Y", "confidence"):
        shown.add_column(name, justify="right")
    shown.add_column("reading")
    for number, pair in enumerate(found.pairs):
        shown.add_row(
            str(number),
            *(str(len(piece.index)) for piece in (pair.x, pair.y)),
            *(f"{piece.share:.1%}" for piece in (pair.x, pair.y)),
            f"{pair.confidence:.3f}",
            verdict(pair.confidence) + (", a tie" if pair.tied else ""),
        )
    return shown


def _said(paths: tuple[Path, Path], found) -> list[str]:
    """A line for what was left out and what has no partner."""
    lines = []
    for path, alone, left_out in zip(
        paths,
        (found.alone_x, found.alone_y),
        (found.left_out_x, found.left_out_y),
        strict=True,
    ):
        for out in left_out:
            vertices = counted(out.vertices, "vertex", "vertices")
            if not out.pieces:
                lines.append(f"{path}: leaves out {vertices} {out.why}")
                continue
            lines.append(
                f"{path}: leaves out {counted(out.pieces, 'piece', 'pieces')} "
                f"{out.why}: {vertices}, {out.share:.2%} of the area"
            )
        lines += [
            f"{path}: the piece with vertex {piece.index[0]} has no partner: "
            f"{len(piece.index)} vertices, {piece.share:.2%} of the area"
            for piece in alone
        ]
    return lines


def _doubts(paths: tuple[Path, Path], found, orientation: str) -> list[str]:
    """Warnings: pieces that could be exchanged, and maps in doubt."""
    lines = []
    tied = [str(number) for number, pair in enumerate(found.pairs) if pair.tied]
    if tied:
        which = f"pair {tied[0]}" if len(tied) == 1 else f"pairs {', '.join(tied)}"
        lines.append(
            f"{which}: other pieces fit as well, and the places of the pieces decided; "
            "this holds if the axes of both files agree"
        )
    for number, pair in enumerate(found.pairs):
        for path, piece in zip(paths, (pair.x, pair.y), strict=True):
            if doubt := sides_in_doubt(piece.mesh):
                lines.append(f"pair {number}: {path}: {doubt}; check left and right")
        doubts = warnings_of(pair.match.certificate, orientation)
        lines += [f"pair {number}: {doubt}" for doubt in doubts]
    return [WARNING + line for line in lines]

"""What `jfsf match` and `jfsf batch` say of the meshes of a pair, beside its map."""

from pathlib import Path

from jfsf.apps.cli._files import UNTOUCHED, Shape, sides_in_doubt

WARNING = "warning: "


def check_units(paths: tuple[Path, Path], shapes: tuple[Shape, Shape]) -> str:
    """Why the files of two parts may be in different units; "" if they are in one.

    Raises:
        ValueError: they must be in different units.
    """
    from jfsf.matching._arguments import TWO_UNITS, doubtful_units
    from jfsf.mesh._geometry import boundary_edges

    x, y = (shape.mesh for shape in shapes)
    # Clouds are refused, and closed shapes matched as wholes, at any scale.
    if not (len(x.faces) and len(y.faces)):
        return ""
    if not any(len(boundary_edges(mesh.faces)) for mesh in (x, y)):
        return ""
    names = str(paths[0]), str(paths[1])
    if doubt := doubtful_units(x, y, names=names, above=TWO_UNITS):
        raise ValueError(f"--partial: {doubt}, or give --any-unit")
    return doubtful_units(x, y, names=names)


def notes_of(
    paths: tuple[Path, Path],
    shapes: tuple[Shape, Shape],
    *,
    partial: bool,
    said: tuple[str, ...] = (),
    brief: bool = False,
) -> list[str]:
    """A line for each thing that was done to a mesh, then for each doubt about one.

    Args:
        paths: of X and Y.
        shapes: what was matched of them.
        partial: whether they were matched as parts.
        said: of the landmarks (`jfsf.apps.cli._landmarks.KnownPairs.said`).
        brief: without a line on a repair that had nothing to do.

    Returns:
        Lines without ends; doubts begin with `WARNING`.
    """
    from jfsf.matching.parts import likely_part

    lines = []
    for path, shape in zip(paths, shapes, strict=True):
        said_of_it = [line for line in shape.said if not brief or line != UNTOUCHED]
        lines += [f"{path}: {line}" for line in said_of_it]
    lines += said
    for path, shape in zip(paths, shapes, strict=True):
        if doubt := sides_in_doubt(shape.mesh):
            lines.append(f"{WARNING}{path}: {doubt}; check left and right")
    x, y = (shape.mesh for shape in shapes)
    if not partial and likely_part(x, y):
        lines.append(
            f"{WARNING}one shape has a long boundary: if it is a part, pass --partial"
        )
    return lines

"""jfsf morphometrics: the landmarks of many specimens, compared."""

import csv
import io
import re
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import typer

from jfsf.apps.cli._files import can_write_beside, can_write_in, need_matplotlib
from jfsf.apps.cli._print import counted, say_result

MOST_SHOWN = 3  # components, and specimens far from the mean, on the screen
ENDS = 2  # components whose ends are written, those of the picture
# Beside the landmarks, where `jfsf collection` writes them; options that take them.
BESIDE = {
    "curveslide.csv": "curves",
    "surfslide.csv": "surfaces",
    "landmark_pairs.csv": "pairs",
}
# Not in every run: those of an earlier one are removed.
OPTIONAL = "symmetric.csv", "asymmetric.csv", "allometry.csv", "allometry.png"


class Slide(StrEnum):
    """`procrustes`'s slide, as choices of an option."""

    bending = "bending"
    procrustes = "procrustes"


class Template(NamedTuple):
    """A mesh, and landmarks of the specimens on it.

    mesh: as in its file.
    at: numbers of the landmarks that it has, among those of the specimens.
    points: of these, in its coordinates.
    """

    mesh: Any
    at: np.ndarray
    points: np.ndarray


def morphometrics(
    landmarks: Annotated[
        Path,
        typer.Argument(
            metavar="LANDMARKS",
            help="Landmarks of all specimens: landmarks.csv or landmarks.tps of jfsf "
            "collection, or any .tps, .csv, .tsv or .txt like them. Missing ones are "
            "estimated by thin-plate spline.",
        ),
    ],
    out: Annotated[
        Path, typer.Option(metavar="FOLDER", help="Folder for the results.")
    ],
    curves: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Semilandmarks of curves, as geomorph's curveslide.csv: before, slide "
            "and after, numbers of landmarks from 1.",
        ),
    ] = None,
    surfaces: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Semilandmarks of surfaces, as geomorph's surfslide.csv: a number of "
            "a landmark, from 1, on each line.",
        ),
    ] = None,
    slide: Annotated[
        Slide,
        typer.Option(
            help="Semilandmarks slide by least bending energy, or least Procrustes "
            "distance."
        ),
    ] = Slide.bending,
    pairs: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Paired landmarks, left and right, numbers from 1; the others are on "
            "the midline. Components and allometry then are those of the symmetric "
            "part of each specimen, and the asymmetric part is written too.",
        ),
    ] = None,
    groups: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="A table with titles: names of specimens, and columns of your own.",
        ),
    ] = None,
    group: Annotated[
        str | None,
        typer.Option(
            metavar="COLUMN",
            help="The column of --groups that is shown in colours; by default the "
            "second.",
        ),
    ] = None,
    template: Annotated[
        Path | None,
        typer.Option(
            metavar="MESH",
            help="A mesh to warp to the ends of the components, in its own place and "
            "size: that of a specimen, NAME.ply, or another with "
            "--template-landmarks. Without it the ends are landmarks (.fcsv).",
        ),
    ] = None,
    template_landmarks: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="The landmarks on --template, in any format that is read; paired by "
            "name or by order.",
        ),
    ] = None,
) -> None:
    """Superimpose the landmarks of many specimens, and compare their shapes.

    Procrustes analysis, sliding semilandmarks, principal components with a picture,
    the regression of shape on size, and specimens that are far from the others. The
    numbers are those of geomorph's gpagen.

    Example: jfsf morphometrics model/landmarks.csv --out shape --groups species.csv
    """
    from jfsf.apps import morphometrics as room
    from jfsf.apps.landmarks import read_specimens
    from jfsf.apps.morphometrics import _tables as tables

    need_matplotlib()
    can_write_in(out)
    if slide is Slide.procrustes and curves is None and surfaces is None:
        raise ValueError("--slide is for semilandmarks; give --curves or --surfaces")
    if group is not None and groups is None:
        raise ValueError("--group names a column of --groups; give that table too")
    if template_landmarks is not None and template is None:
        raise ValueError("--template-landmarks lie on a mesh; give --template too")
    found = read_specimens(landmarks)
    names, number = found.specimens, len(found.landmarks)
    numbers = {
        option: path and tables.read_numbers(path, titles, number)
        for option, path, titles in (
            ("curves", curves, tables.CURVES),
            ("surfaces", surfaces, tables.SURFACES),
            ("pairs", pairs, tables.PAIRS),
        )
    }
    title, labels = "", [""] * len(names)
    if groups is not None:
        title, labels = tables.read_groups(groups, names, group)
    mesh = template and _template(template, template_landmarks, found)
    inputs = [landmarks, curves, surfaces, pairs, groups, template, template_landmarks]
    if out.is_dir():
        kept = [out / name for name in ("aligned.csv", "sizes.csv", "scores.csv")]
        can_write_beside(kept, [path for path in inputs if path is not None])
    allometry, why = None, ""
    try:
        points = room.estimate_missing(found.points)
        aligned = room.procrustes(
            points,
            curves=numbers["curves"],
            surfaces=numbers["surfaces"],
            slide=slide.value,
        )
        parts = None
        if numbers["pairs"] is not None:
            parts = room.symmetric_parts(aligned.shapes, numbers["pairs"])
        shapes = aligned.shapes if parts is None else parts.symmetric
        modes = room.components(shapes)
    except ValueError as error:
        raise ValueError(f"{landmarks}: {_named(error, found)}") from None
    try:
        allometry = room.allometry(shapes, aligned.sizes)
    except ValueError as error:
        why = f"no {error}"
    texts = _texts(found, aligned, modes, allometry, parts, title, labels)
    ends = _ends(modes, aligned.sizes.mean(), mesh)
    written = _write(out, texts, ends, found, mesh)
    written += _draw(out, modes, allometry, aligned.sizes, names, labels)
    lines = _estimated(found)
    lines += _summary(found, aligned, modes, allometry, parts, numbers, slide, why)
    doubts = []
    for name, option in BESIDE.items():
        if numbers[option] is None and (there := landmarks.parent / name).exists():
            doubts.append(f"{there} is there and was not used; add --{option} {there}")
    if groups is not None and (alone := _without(names, labels)):
        doubts.append(f"{groups}: has no {title} of {alone}")
    say_result([], lines, doubts, written)


def _named(error, found) -> str:
    """The message of an error, with names of specimens and landmarks for numbers."""
    text = str(error).split(": ", 1)[-1]
    for what, names in (("specimen", found.specimens), ("landmark", found.landmarks)):
        name = lambda m, names=names: repr(names[int(m[1])] or int(m[1]) + 1)
        text = re.sub(rf"(?<={what} )(\d+)", name, text)
    return text


def _template(path: Path, file: Path | None, found) -> Template:
    """A mesh, and which landmarks of the specimens it has, and where."""
    from jfsf.apps.landmarks import Landmarks, pair_landmarks, read_landmarks
    from jfsf.apps.landmarks._place import on_surface
    from jfsf.mesh import read

    mesh = read(path)
    if file is not None:
        own = read_landmarks(file)
        every = Landmarks(found.landmarks, np.zeros((len(found.landmarks), 3)))
        at, rows = pair_landmarks(every, own).rows.T
        places = on_surface(own, mesh).points if own.points is None else own.points
        points = np.asarray(places)[rows]
    elif path.stem in found.specimens:
        points = found.points[found.specimens.index(path.stem)]
        at = np.flatnonzero(np.isfinite(points).all(1))
        points = points[at]
    else:
        raise ValueError(
            f"{path}: no specimen has the name {path.stem!r}; give the landmarks of "
            "this mesh as --template-landmarks"
        )
    on_surface(Landmarks(tuple(found.landmarks[i] for i in at), points), mesh)
    return Template(mesh, at, points)


def _ends(modes, size: float, template: Template | None) -> dict[str, np.ndarray]:
    """The mean shape, and the specimens at the ends of the first components.

    They have the mean centroid size, or the place and the size of a template.

    Args:
        modes: the components.
        size: mean centroid size.
        template: the mesh to warp.
    """
    from jfsf.apps.morphometrics._procrustes import rotations

    shapes = {"mean": modes.mean}
    for k, axis in enumerate(modes.axes[:ENDS]):
        for end in ("min", "max"):
            score = getattr(modes.scores[:, k], end)()
            shapes[f"PC{k + 1}_{end}"] = modes.mean + score * axis
    if template is None:
        return {name: size * shape for name, shape in shapes.items()}
    mean, own = modes.mean[template.at], template.points
    centred = own - own.mean(0)
    scale = np.linalg.norm(centred) / np.linalg.norm(mean - mean.mean(0))
    # One motion for all, that of the mean, so that the ends lie on each other.
    every = (np.stack(list(shapes.values())) - mean.mean(0)) * scale
    turn = rotations(centred, every[:1, template.at])[0]
    return dict(zip(shapes, every @ turn.T + own.mean(0), strict=True))


def _write(out: Path, texts, ends, found, template: Template | None) -> list[Path]:
    """Write tables, and the ends of components as meshes or landmarks."""
    from jfsf.apps.export import export_mesh
    from jfsf.apps.landmarks import Landmarks, write_landmarks
    from jfsf.apps.morphometrics import warp
    from jfsf.storage._atomic import write_text
    from jfsf.types import Mesh

    folder = out / "shapes"
    meshes = {}
    if template is not None:
        for name, shape in ends.items():
            moved = warp(template.mesh.vertices, template.points, shape[template.at])
            meshes[name] = Mesh(moved, template.mesh.faces)
    folder.mkdir(parents=True, exist_ok=True)
    for name in OPTIONAL:
        if name not in texts:
            (out / name).unlink(missing_ok=True)
    for name, text in texts.items():
        write_text(out / name, text)
    for name, shape in ends.items():
        write_landmarks(folder / f"{name}.fcsv", Landmarks(found.landmarks, shape))
        if name in meshes:
            export_mesh(folder / f"{name}.ply", meshes[name])
        else:
            (folder / f"{name}.ply").unlink(missing_ok=True)
    return [*(out / name for name in texts), folder]


def _draw(out: Path, modes, allometry, sizes, names, groups) -> list[Path]:
    from jfsf.apps.morphometrics._draw import draw_allometry, draw_components

    written = [out / "components.png"]
    draw_components(written[0], modes, names, groups)
    if allometry is not None:
        written.append(out / "allometry.png")
        draw_allometry(written[1], allometry, sizes, names, groups)
    return written


def _texts(found, aligned, modes, allometry, parts, title, groups) -> dict[str, str]:
    """The text of each table, by its name."""
    from jfsf.apps.landmarks._morphometrics import specimens_csv

    names, landmarks = found.specimens, found.landmarks
    columns = {
        "centroid_size": aligned.sizes,
        "log_centroid_size": np.log(aligned.sizes),
        "distance": aligned.distances,
        "estimated": np.isnan(found.points).all(2).sum(1),
    }
    scores = {title: groups} if title else {}
    scores |= {f"PC{k}": column for k, column in enumerate(modes.scores.T, 1)}
    texts = {"aligned.csv": specimens_csv(names, landmarks, aligned.shapes)}
    if parts is not None:
        columns["asymmetry"] = parts.distances
        texts["symmetric.csv"] = specimens_csv(names, landmarks, parts.symmetric)
        texts["asymmetric.csv"] = specimens_csv(names, landmarks, parts.asymmetric)
    if allometry is not None:
        scores["regression_score"] = allometry.scores
        texts["allometry.csv"] = _table(_anova(allometry, len(names)))
    texts["sizes.csv"] = _table({"specimen": names} | columns)
    texts["scores.csv"] = _table({"specimen": names} | scores)
    number = range(1, 1 + len(modes.share))
    spread = {"component": number, "variance": modes.variance, "share": modes.share}
    return texts | {"components.csv": _table(spread)}


def _anova(found, specimens: int) -> dict[str, list]:
    """The columns of the table of the regression, as geomorph's procD.lm has them."""
    free = [1, specimens - 2, specimens - 1]
    squares = [
        square / degrees for square, degrees in zip(found.sums, free, strict=True)
    ]
    return {
        "source": ["log_centroid_size", "residuals", "total"],
        "Df": free,
        "SS": list(found.sums),
        "MS": [*squares[:2], ""],
        "Rsq": [found.share, 1 - found.share, ""],
        "F": [found.F, "", ""],
        "p": [found.p, "", ""],
        "orders": [found.orders, "", ""],
    }


def _table(columns) -> str:
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(columns)
    for row in zip(*columns.values(), strict=True):
        table.writerow([x.item() if isinstance(x, np.generic) else x for x in row])
    return text.getvalue()


def _estimated(found) -> list[str]:
    """Which landmarks are estimated, in words."""
    lost = np.isnan(found.points).all(2)
    if not lost.any():
        return []
    specimens = np.flatnonzero(lost.any(1))
    lines = [
        f"{counted(int(lost.sum()), 'missing landmark', 'missing landmarks')} of "
        f"{counted(len(specimens), 'specimen', 'specimens')}: estimated from the "
        "others by thin-plate spline"
    ]
    for i in specimens:
        own = [found.landmarks[at] or str(at + 1) for at in np.flatnonzero(lost[i])]
        lines.append(f"  {found.specimens[i]}: {', '.join(own)}")
    return lines


def _summary(found, aligned, modes, allometry, parts, numbers, slide, why):
    """What was found, in words."""
    lines = [f"{len(found.specimens)} specimens, {len(found.landmarks)} landmarks"]
    slid = {
        f"on {w}": len(numbers[w])
        for w in ("curves", "surfaces")
        if numbers[w] is not None
    }
    if slid:
        words = " and ".join(f"{number} {where}" for where, number in slid.items())
        by = "bending energy" if slide is Slide.bending else "Procrustes distance"
        lines[0] += f"; slid: {words}, by {by}"
    if parts is not None:
        directional = np.linalg.norm(parts.asymmetric.mean(0))
        lines.append(
            "asymmetry: mean Procrustes distance from the symmetric part "
            f"{parts.distances.mean():.3g}, of it directional {directional:.3g}; what "
            "follows is of the symmetric part"
        )
    shown = (
        f"PC{k} {share:.1%}" for k, share in enumerate(modes.share[:MOST_SHOWN], 1)
    )
    lines.append(f"variance: {', '.join(shown) or 'none'}")
    if allometry is None:
        lines.append(why)
    else:
        lines.append(
            f"allometry: R2 {allometry.share:.1%}, F {allometry.F:.3g}, p "
            f"{allometry.p:.3g} ({allometry.orders} orders of the specimens, seed 0)"
        )
    return [*lines, *_unusual(found.specimens, aligned.distances)]


def _unusual(names, distances) -> list[str]:
    """The specimens farthest from the mean, and which are outliers."""
    order = np.argsort(-distances)[:MOST_SHOWN]
    shown = ", ".join(f"{names[i]} {distances[i]:.3g}" for i in order)
    line = f"farthest from the mean: {shown}; median {np.median(distances):.3g}"
    low, high = np.quantile(distances, [0.25, 0.75])
    # Tukey's fence, as geomorph's plotOutliers.
    far = [
        names[i]
        for i in np.argsort(-distances)
        if distances[i] > 2.5 * high - 1.5 * low
    ]
    if not far:
        return [line]
    return [line, f"look at the landmarks of {', '.join(far)}: often one is misplaced"]


def _without(names, groups) -> str:
    """Names of specimens without a group."""
    alone = [name for name, own in zip(names, groups, strict=True) if not own]
    return ", ".join(alone[:5]) + (", ..." if len(alone) > 5 else "")

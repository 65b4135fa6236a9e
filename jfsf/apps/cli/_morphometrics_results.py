"""The results of `jfsf morphometrics`: tables, the ends of components, and pictures."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jfsf.apps.export import export_mesh
from jfsf.apps.landmarks import (
    Landmarks,
    pair_landmarks,
    read_landmarks,
    write_landmarks,
)
from jfsf.apps.landmarks._morphometrics import Specimens, specimens_csv
from jfsf.apps.landmarks._place import on_surface
from jfsf.apps.landmarks._record import csv_text
from jfsf.apps.morphometrics import warp
from jfsf.apps.morphometrics._draw import draw_allometry, draw_components
from jfsf.apps.morphometrics._procrustes import rotations
from jfsf.mesh import read
from jfsf.storage._atomic import write_text
from jfsf.types import Mesh

ENDS = 2  # components whose ends are written, those of the picture
# Not in every run: those of an earlier one are removed.
OPTIONAL = "symmetric.csv", "asymmetric.csv", "allometry.csv", "allometry.png"


class Compared(NamedTuple):
    """What was computed of the specimens.

    found: their landmarks, as read.
    aligned: superimposed (`Superimposed`).
    parts: symmetric and asymmetric (`SymmetricParts`); None without pairs.
    modes: their `Components`.
    allometry: as `allometry` returns it; None where there is none.
    title: of the column of groups; "" without.
    groups: of each specimen; "" for one without.
    """

    found: Specimens
    aligned: Any
    parts: Any
    modes: Any
    allometry: Any
    title: str
    groups: list[str]


class Template(NamedTuple):
    """A mesh, and landmarks of the specimens on it.

    mesh: as in its file.
    at: numbers of the landmarks that it has, among those of the specimens.
    points: of these, in its coordinates.
    """

    mesh: Any
    at: np.ndarray
    points: np.ndarray


def template_of(path: Path, file: Path | None, found: Specimens) -> Template:
    """A mesh, and which landmarks of the specimens it has, and where.

    Args:
        path: of the mesh; named as a specimen, it has the landmarks of that.
        file: its landmarks; else None.
        found: the specimens.

    Raises:
        ValueError: the mesh has landmarks of no specimen, or they lie far from it.
    """
    mesh, number = read(path), len(found.landmarks)
    if file is not None:
        own = read_landmarks(file)
        every = Landmarks(found.landmarks, np.zeros((number, 3)))
        try:
            at, rows = pair_landmarks(every, own).rows.T
            placed = own.points if own.vertices is None else on_surface(own, mesh)[2]
        except ValueError as error:
            raise ValueError(f"the specimens (X), {file} (Y): {error}") from None
        points = np.asarray(placed)[rows]
    elif path.stem in found.specimens:
        points = found.points[found.specimens.index(path.stem)]
        at = np.flatnonzero(np.isfinite(points).all(1))
        points = points[at]
    else:
        raise ValueError(
            f"{path}: no specimen has the name {path.stem!r}; give the landmarks of "
            "this mesh as --template-landmarks"
        )
    try:
        on_surface(Landmarks(tuple(found.landmarks[i] for i in at), points), mesh)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return Template(mesh, at, points)


def ends_of(modes: Any, size: float, template: Template | None) -> dict[str, Any]:
    """Landmarks of the mean, and of the ends of the first components, by name.

    An end has the least or the largest score of the specimens, and the mean of all
    other components. They have the mean centroid size, or lie on a template.

    Args:
        modes: the `Components`.
        size: mean centroid size.
        template: the mesh to warp.
    """
    shapes = {"mean": modes.mean}
    for k, (axis, scores) in enumerate(zip(modes.axes, modes.scores.T, strict=True), 1):
        if k <= ENDS:
            shapes[f"PC{k}_min"] = modes.mean + scores.min() * axis
            shapes[f"PC{k}_max"] = modes.mean + scores.max() * axis
    every = np.stack(list(shapes.values()))
    if template is None:
        return dict(zip(shapes, size * every, strict=True))
    mean, own = modes.mean[template.at], template.points
    centred = own - own.mean(0)
    every = every - mean.mean(0)
    every *= np.linalg.norm(centred) / np.linalg.norm(every[0, template.at])
    # One rotation for all, that of the mean, so that the ends lie on each other.
    turn = rotations(centred, every[:1, template.at])[0]
    return dict(zip(shapes, every @ turn.T + own.mean(0), strict=True))


def meshes_of(ends: dict[str, Any], template: Template | None) -> dict[str, Mesh]:
    """A template warped to each of some landmarks, by name; none without a template.

    Raises:
        ValueError: its landmarks lie in a plane, or two at one place.
    """
    if template is None:
        return {}
    (vertices, faces), at, points = template.mesh[:2], template.at, template.points
    moved = {name: warp(vertices, points, shape[at]) for name, shape in ends.items()}
    return {name: Mesh(vertices, faces) for name, vertices in moved.items()}


def write_results(
    out: Path, compared: Compared, ends: dict[str, Any], meshes: dict[str, Mesh]
) -> list[Path]:
    """Write tables, shapes and pictures; returns what was written.

    Args:
        out: the folder; made if it is not there.
        compared: what was computed.
        ends: of `ends_of`.
        meshes: of `meshes_of`.
    """
    folder, found = out / "shapes", compared.found
    folder.mkdir(parents=True, exist_ok=True)
    texts = _texts(compared)
    for name in OPTIONAL:
        if name not in texts:
            (out / name).unlink(missing_ok=True)
    for name, text in texts.items():
        write_text(out / name, text)
    for name, shape in ends.items():
        write_landmarks(folder / f"{name}.fcsv", Landmarks(found.landmarks, shape))
        (folder / f"{name}.ply").unlink(missing_ok=True)
        if name in meshes:
            export_mesh(folder / f"{name}.ply", meshes[name])
    written = [*(out / name for name in texts), folder, out / "components.png"]
    shown = found.specimens, compared.groups
    draw_components(written[-1], compared.modes, *shown)
    if compared.allometry is not None:
        written.append(out / "allometry.png")
        draw_allometry(written[-1], compared.allometry, compared.aligned.sizes, *shown)
    return written


def _texts(compared: Compared) -> dict[str, str]:
    """The text of each table, by its name."""
    found, aligned, parts, modes, allometry, title, groups = compared
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


def _anova(found: Any, specimens: int) -> dict[str, list]:
    """The columns of the table of the regression, as geomorph's procD.lm has them."""
    free = [1, specimens - 2, specimens - 1]
    return {
        "source": ["log_centroid_size", "residuals", "total"],
        "Df": free,
        "SS": list(found.sums),
        "MS": [found.sums[0], found.sums[1] / free[1], ""],
        "Rsq": [found.share, 1 - found.share, ""],
        "F": [found.F, "", ""],
        "p": [found.p, "", ""],
        "orders": [found.orders, "", ""],
    }


def _table(columns: dict[str, Any]) -> str:
    return csv_text(list(columns), zip(*columns.values(), strict=True))

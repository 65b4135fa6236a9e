"""What `jfsf morphometrics` computes: superimposed, in two parts, components, size."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jfsf.apps.landmarks import Landmarks, pair_landmarks, read_landmarks
from jfsf.apps.landmarks._morphometrics import Specimens
from jfsf.apps.landmarks._place import as_points
from jfsf.apps.landmarks._record import titles_of
from jfsf.apps.morphometrics import (
    allometry,
    components,
    estimate_missing,
    procrustes,
    symmetric_parts,
    warp,
)
from jfsf.apps.morphometrics._procrustes import Superimposed, rotations
from jfsf.apps.morphometrics._statistics import Allometry, Components
from jfsf.apps.morphometrics._symmetry import SymmetricParts
from jfsf.apps.morphometrics._tables import ALONE
from jfsf.mesh import read
from jfsf.types import Mesh

ENDS = 2  # components whose ends are written, those of the picture


class TwoSided(NamedTuple):
    """What is known of left and right.

    found: the specimens with the landmarks of their symmetric shapes: all, or those
        that have a partner or are on the midline.
    kept: their numbers among all.
    pairs: of these, left and right; None if sides are not told apart.
    alone: names of the others.
    """

    found: Specimens
    kept: np.ndarray
    pairs: np.ndarray | None
    alone: list[str]


class Compared(NamedTuple):
    """What was computed of the specimens.

    aligned: superimposed.
    parts: symmetric and asymmetric; None without pairs.
    modes: the components of the aligned shapes, or of their symmetric parts.
    ends: landmarks of the mean and of the ends of components, by name.
    meshes: the template, warped to these; none without.
    allometry: of the same shapes; or why there is none.
    """

    aligned: Superimposed
    parts: SymmetricParts | None
    modes: Components
    ends: dict[str, np.ndarray]
    meshes: dict[str, Mesh]
    allometry: Allometry | str


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
    mesh, every = read(path), found.landmarks
    at = np.arange(len(every))
    if file is not None:
        own = read_landmarks(file)
    elif path.stem in found.specimens:
        points = found.points[found.specimens.index(path.stem)]
        at = at[np.isfinite(points).all(1)]
        own = Landmarks(tuple(every[i] for i in at), points[at])
    else:
        raise ValueError(
            f"{path}: no specimen has the name {path.stem!r}; give the landmarks of "
            "this mesh as --template-landmarks"
        )
    try:
        points = np.asarray(as_points(own, mesh).points, float)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    if file is not None:
        try:
            pairs = pair_landmarks(Landmarks(every, np.zeros((len(every), 3))), own)
        except ValueError as error:
            raise ValueError(f"the specimens (X), {file} (Y): {error}") from None
        at, points = pairs.rows[:, 0], points[pairs.rows[:, 1]]
    return Template(mesh, at, points)


def two_sided(found: Specimens, pairs: np.ndarray | None) -> TwoSided:
    """Leave out the landmarks without a partner.

    Args:
        found: the specimens.
        pairs: of `read_list`; None without.
    """
    kept = np.arange(len(found.landmarks))
    if pairs is None:
        return TwoSided(found, kept, None, [])
    lost = pairs[:, 1] == ALONE
    kept = np.setdiff1d(kept, alone := pairs[lost, 0])
    names, titles = found.landmarks, titles_of(found.landmarks)
    own = tuple(names[i] for i in kept), found.points[:, kept]
    numbers = np.searchsorted(kept, pairs[~lost])
    return TwoSided(
        Specimens(found.specimens, *own), kept, numbers, [titles[i] for i in alone]
    )


def compare(
    found: Specimens, two: TwoSided, template: Template | None, **options: Any
) -> Compared:
    """Superimpose the specimens, and compare them.

    Args:
        found: the specimens.
        two: of `two_sided`.
        template: the mesh to warp.
        options: of `procrustes`.

    Raises:
        PointsError: they, or the template's landmarks, cannot be compared.
    """
    aligned = procrustes(estimate_missing(found.points), **options)
    shapes, parts = aligned.shapes, None
    if two.pairs is not None:
        parts = symmetric_parts(np.take(shapes, two.kept, 1), two.pairs)
        shapes = parts.symmetric
    modes = components(shapes)
    ends = _ends_of(modes, aligned.sizes.mean(), template)
    meshes = {}
    if template is not None:
        (vertices, faces), at, points = template.mesh[:2], template.at, template.points
        for name, shape in ends.items():
            meshes[name] = Mesh(warp(vertices, points, shape[at]), faces)
    try:
        by_size = allometry(shapes, aligned.sizes)
    except ValueError as error:
        by_size = str(error)
    return Compared(aligned, parts, modes, ends, meshes, by_size)


def _ends_of(modes: Components, size: float, template: Template | None):
    """Landmarks of the mean, and of the ends of the first components, by name.

    An end has the least or the largest score of the specimens, and the mean of all
    other components. They have the mean centroid size, or lie on a template.
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

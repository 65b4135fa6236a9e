"""Coarse copies of a pair: further starts are tried on them, large shapes bent first.

Host side. A copy has the eigenfunctions of the whole shape, read at its own few
vertices. So it needs no spectrum, and a functional map between copies is one between
the whole shapes.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import KDTree

from jfsf.matching._arguments import MatchInputs, padded_inputs
from jfsf.matching._settings import Settings
from jfsf.mesh import decimate
from jfsf.mesh._geometry import vertex_areas, vertex_normals
from jfsf.refine._rest import at_rest, follow, rotations_of
from jfsf.runtime._sizes import padded, padded_shapes
from jfsf.types import ArrayLike, Mesh, Spectrum

# Share of the mean area that a vertex of a copy has at least: mass 0 is padding.
LEAST_MASS = 1e-3
# Vertices of a copy that a vertex of the whole follows, and half the distance that
# opposite normals count for among these, in sqrt(area): more than between neighbours.
CARRIED_BY, NORMAL = 4, 0.05
# The same in the search for the vertex of the whole that is nearest to one of a copy.
# With 0 some are found on another limb that touches, and read its eigenfunctions.
# `experiments/fit/choose_copies.py --jumps` counts the edges where that happens.
READ_NORMAL = 0.03


class CoarseCopy(NamedTuple):
    """A shape at few vertices, and how they lie on the whole one.

    spectrum: evals of the whole, evecs of the whole at the nearest vertices; mass,
        faces and vertices of the copy.
    on_whole: (n_copy,), the vertex of the whole nearest to each of the copy, among
        those that face the same way.
    on_copy: (n,), the vertex of the copy nearest to each of the whole, among those that
        face the same way.
    """

    spectrum: Spectrum
    on_whole: ArrayLike
    on_copy: ArrayLike


def coarse_copy(spec: Spectrum, *, settings: Settings) -> CoarseCopy:
    """The copy of a shape that has faces.

    Args:
        spec: padding at the end is left out.
        settings: `coarse_vertices`. A shape of fewer vertices is its own copy, and one
            of which fewer than `min_vertices` would be left.
    """
    evals, evecs, mass, faces, vertices = map(np.asarray, spec)
    n = int(np.sum(mass > 0))
    real = (faces[:, 0] != faces[:, 1]) | (faces[:, 1] != faces[:, 2])
    whole = Mesh(vertices[:n], faces[real])
    mesh = decimate(whole, settings.coarse_vertices)
    if len(mesh.vertices) < settings.min_vertices:
        mesh = whole
    areas = vertex_areas(mesh.vertices, mesh.faces)
    areas = np.maximum(areas / areas.sum(), LEAST_MASS / len(areas))
    on_whole, on_copy = (
        _nearest(whole, mesh, READ_NORMAL),
        _nearest(mesh, whole, NORMAL),
    )
    copy: Any = (
        evals,
        evecs[on_whole],
        (areas / areas.sum()).astype(mass.dtype),
        np.asarray(mesh.faces, faces.dtype),
        np.asarray(mesh.vertices, vertices.dtype),
    )
    return CoarseCopy(Spectrum(*copy), on_whole, on_copy)


def padded_copies(
    copies: Sequence[CoarseCopy], inputs: MatchInputs
) -> tuple[tuple[Spectrum, Spectrum], MatchInputs]:
    """Spectra and inputs of the copies of X and Y, in common sizes.

    Args:
        copies: of X and Y.
        inputs: of the whole shapes; an initial map is left out.
    """
    x, y = copies
    specs = x.spectrum, y.spectrum
    k = len(x.spectrum.evals)
    sizes = padded_shapes(k, [(len(s.mass), len(s.faces)) for s in specs])
    landmarks, descriptors = inputs.landmarks, inputs.descriptors
    if landmarks is not None:
        sides = zip(copies, landmarks, strict=True)
        landmarks = tuple(
            np.asarray(copy.on_copy[np.asarray(at)], np.int32) for copy, at in sides
        )
    if descriptors is not None:
        sides = zip(copies, descriptors, strict=True)
        descriptors = tuple(np.asarray(all_)[copy.on_whole] for copy, all_ in sides)
    own = inputs._replace(landmarks=landmarks, descriptors=descriptors, initial=None)
    pair = padded(specs[0], sizes[0]), padded(specs[1], sizes[1])
    return pair, padded_inputs(own, sizes)


def carried(
    moved: ArrayLike, copy: CoarseCopy, spec: Spectrum, *, mirrored: bool = False
) -> np.ndarray:
    """Positions of a whole shape, each moved as the near vertices of its copy.

    Each vertex of the copy moves rigidly, by the rotation that fits the edges around it
    best; those of the whole follow (`follow`).

    Args:
        moved: positions of the copy; rows of padding at the end are not read. Near
            those that are nan, the whole shape is nan.
        copy: how it lies on the whole.
        spec: of the whole shape.
        mirrored: whether `moved` is a mirror image.

    Returns:
        (n, 3), 0 on padding.
    """
    sign = -1 if mirrored else 1
    mesh = Mesh(copy.spectrum.vertices, copy.spectrum.faces)
    rest = at_rest(mesh, sign)
    moved = np.asarray(moved, float)[: len(mesh.vertices)]
    rotation = rotations_of(rest, np.nan_to_num(moved))
    n = int(np.sum(np.asarray(spec.mass) > 0))
    whole = np.asarray(spec.vertices)[:n], np.asarray(spec.faces)
    tree = KDTree(_with_normals(*mesh))
    away, near = tree.query(_with_normals(*whole), CARRIED_BY, workers=-1)
    points = whole[0] * np.array([sign, 1, 1])
    found = np.zeros((len(spec.mass), 3))
    found[:n] = follow(
        points, rest.mesh.vertices, moved, rotation, np.asarray(near), away
    )
    return found


def _nearest(points: Mesh, queries: Mesh, weight: float) -> np.ndarray:
    """(q,) int32, the vertex of `points` nearest to each vertex of `queries`."""
    known, asked = (_with_normals(*mesh, weight) for mesh in (points, queries))
    return np.asarray(KDTree(known).query(asked)[1], np.int32)


def _with_normals(
    points: ArrayLike, faces: ArrayLike, weight: float = NORMAL
) -> np.ndarray:
    """Points in six dimensions: sides of a surface that touch are not near in these."""
    return np.concatenate([points, weight * vertex_normals(points, faces)], 1)

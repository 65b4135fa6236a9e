"""Coarse copies of large shapes, on which starts are compared. Host side."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.spatial import KDTree

from jfsf.arguments import MatchInputs
from jfsf.initial import Start
from jfsf.mesh import decimate
from jfsf.runtime import PaddedShape, common_size
from jfsf.settings import Settings
from jfsf.types import ArrayLike, Match, Mesh, Spectrum


class CoarseCopy(NamedTuple):
    """A mesh of fewer vertices, and how it lies on the whole one.

    mesh: the copy.
    on_whole: (n_copy,), the vertex of the whole nearest to each of the copy.
    on_copy: (n,), the vertex of the copy nearest to each of the whole.
    """

    mesh: Mesh
    on_whole: ArrayLike
    on_copy: ArrayLike


def have_copies(
    surfaces: list[Mesh], shapes: list[PaddedShape], settings: Settings
) -> bool:
    """Whether these shapes, padded so, get copies: small ones gain nothing.

    Nor does a cloud without a surface.
    """
    few = settings.coarse_vertices
    large = any(shape.vertices > 2 * common_size(few) for shape in shapes)
    return few > 0 and large and all(len(mesh.faces) for mesh in surfaces)


def coarse_copy(mesh: Mesh, settings: Settings) -> CoarseCopy:
    """The copy of a shape that has faces."""
    copy = decimate(mesh, settings.coarse_vertices)
    return CoarseCopy(copy, _nearest(mesh, copy), _nearest(copy, mesh))


def at_copies(inputs: MatchInputs, x: CoarseCopy, y: CoarseCopy) -> MatchInputs:
    """Landmarks and descriptors of the whole shapes, at the copies."""
    landmarks, descriptors = inputs.landmarks, inputs.descriptors
    if landmarks is not None:
        sides = zip((x, y), landmarks, strict=True)
        landmarks = tuple(jnp.asarray(copy.on_copy)[at] for copy, at in sides)
    if descriptors is not None:
        sides = zip((x, y), descriptors, strict=True)
        descriptors = tuple(values[copy.on_whole] for copy, values in sides)
    return inputs._replace(landmarks=landmarks, descriptors=descriptors)


def start_from_copies(
    match: Match,
    copies: tuple[CoarseCopy, CoarseCopy],
    spec_x: Spectrum,
    spec_y: Spectrum,
    *,
    settings: Settings,
) -> Start:
    """The map of the copies as a start for the whole shapes.

    Args:
        match: of the copies.
        copies: of X and Y.
        spec_x, spec_y: spectra of the whole shapes, padding included.
        settings: of the search: as many functions as it finds, and its weight of
            descriptors for shapes of other proportions.
    """
    x, y = copies
    k = settings.search.final_ks[-1]
    T_xy = y.on_whole[np.asarray(match.T_xy)[x.on_copy]]
    n = len(T_xy)
    evecs_x, evecs_y = (np.asarray(spec.evecs)[:, :k] for spec in (spec_x, spec_y))
    back = (evecs_x[:n] * np.asarray(spec_x.mass)[:n, None]).T
    C_yx = jnp.asarray(back @ evecs_y[T_xy])
    unknown = jnp.full((), jnp.nan, C_yx.dtype)
    weight = jnp.full_like(unknown, settings.search.nonisometric_descriptor_weight)
    return Start(C_yx, match.certificate.orientation, unknown, weight)


def _nearest(points: Mesh, queries: Mesh) -> ArrayLike:
    """The vertex of `points` nearest to each of `queries`."""
    return KDTree(points.vertices).query(queries.vertices)[1].astype(np.int32)

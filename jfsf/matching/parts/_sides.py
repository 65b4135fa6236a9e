"""Both shapes in one unit, with what the search for a region reads of them. Host side.

Coarse copies of both are for the first steps, which try many starts.

How the surfaces curve is read at several scales. Two open surfaces that lie on each
other slide along each other at little cost; what keeps them in place is that a bump
lies on a bump. It is read from the surface within sqrt(t), so a cut changes it only
there. `jfsf.spectral.curvature` is for whole shapes: it reads eigenfunctions, which a
cut changes everywhere.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from jfsf.geometry import GeodesicSolver
from jfsf.learned._places import Places
from jfsf.matching.parts._register import Whole, whole_at_rest
from jfsf.matching.parts._samples import PartSamples, part_samples
from jfsf.matching.parts._settings import PartSettings
from jfsf.matching.parts._surfaces import outward
from jfsf.mesh import decimate, orient, surface_area
from jfsf.mesh._closest import nearest_vertices
from jfsf.mesh._geometry import farthest_vertices, vertex_normals
from jfsf.spectral._laplacian import definite_solver, operators
from jfsf.types import ArrayLike, Mesh

# Heat times that are compared, in squared sqrt(area of the whole).
TIMES = 0.0003, 0.001, 0.003
MAX_CURVATURE = 3.0  # in standard deviations; a greater one counts as this
# Of a normal distribution: the standard deviation over the median absolute value.
SPREAD = 1.4826
TINY = 1e-9
STEP = 0.4  # at most, between logarithms of times


class Curvatures(NamedTuple):
    """Curvature of one mesh at many times, for that at any time between.

    log_times: (k,) logarithms of the times, evenly spaced.
    values: (n, k) `curvature`.
    """

    log_times: np.ndarray
    values: np.ndarray

    def at(self, times: ArrayLike) -> np.ndarray:
        """(n, times), linear in the logarithm of the time; beyond the ends as there."""
        first, last = self.log_times[[0, -1]]
        place = np.clip(np.log(times), first, last) - first
        place *= (len(self.log_times) - 1) / (last - first)
        before = np.minimum(place.astype(int), len(self.log_times) - 2)
        share = place - before
        low, high = self.values[:, before], self.values[:, before + 1]
        return (1 - share) * low + share * high


def curvatures(mesh: Mesh, least: float, most: float) -> Curvatures:
    """For times from `least` to `most`, in squared units of the mesh."""
    num = 2 + int(np.log(most / least) / STEP)
    log_times = np.linspace(np.log(least), np.log(most), num)
    return Curvatures(log_times, curvature(mesh, np.exp(log_times)))


def curvature(mesh: Mesh, times: ArrayLike) -> np.ndarray:
    """(n, times) how far heat moves each vertex along the outward normal.

    An implicit step of mean curvature flow (Desbrun et al., 1999),
    (M + t L) p = M vertices, then <p - vertices, normal> / sqrt(t): negative where the
    surface is convex, and no unit. A mirror image has the same.

    Args:
        mesh: wound outward.
        times: t, in squared units of the mesh.
    """
    at, normal = np.asarray(mesh.vertices, float), vertex_normals(*mesh)
    stiffness, area = operators(mesh)
    mass = sp.diags(area)
    columns = []
    for time in np.asarray(times):
        diffused = definite_solver(mass + time * stiffness)(area[:, None] * at)
        columns.append(np.sum((diffused - at) * normal, 1) / np.sqrt(time))
    return np.stack(columns, 1)


def usual_curvature(values: np.ndarray) -> np.ndarray:
    """(times,) what `standard_curvature` divides by: a standard deviation.

    It is made from the median, so a few sharp vertices hardly change it.
    """
    return SPREAD * np.sqrt(np.median(values**2, 0)) + TINY


def standard_curvature(values: np.ndarray, usual: np.ndarray) -> np.ndarray:
    """(n, times) rows whose squared distance is the mean square of the differences.

    Args:
        values: `curvature`.
        usual: what counts as 1, the same for both shapes.
    """
    return np.clip(values / usual, -MAX_CURVATURE, MAX_CURVATURE) / np.sqrt(
        values.shape[1]
    )


COARSE_PART, COARSE_WHOLE = 600, 1000  # vertices of the coarse copies
# Where units may differ: factors of the part's lengths that are tried once the geodesic
# diameters are the same, and by how much there are more starts: there are more sizes.
ANY_SCALES = tuple(float(scale) for scale in np.exp(np.linspace(-0.9, 0.9, 19)))
ANY_UNIT_FACTOR = 1.5
BEYOND = 1.2  # factor by which the size that is found may lie outside of those tried
ENDS = 5  # vertices far apart; the diameter begins at what is farthest from one


class Sides(NamedTuple):
    """Both shapes in the unit of Y, and coarse copies of both.

    Where units may differ X is brought to the geodesic diameter of Y instead.

    coarse_x: the copy of X.
    whole: the copy of Y, at rest.
    on_x: the vertex of X nearest to each of its copy.
    from_y: the vertex of the copy nearest to each of Y.
    on_y: the vertex of Y nearest to each of its copy.
    curvatures_x: of X, at its own size.
    usual_curvature: (times,) of Y.
    curvature_y: (n_y, times) of Y in these units.
    sign: -1 for maps that mirror, and the whole is mirrored.
    settings: with the scales that are tried, and the numbers of starts.
    same_unit: whether both shapes were in one unit.
    factor: by which X was enlarged beside Y, to be as long; 1 in one unit.
    places: where on a person the vertices of both copies lie; None if it is not known.
    """

    x: PartSamples
    y: PartSamples
    coarse_x: Mesh
    whole: Whole
    on_x: np.ndarray
    from_y: np.ndarray
    on_y: np.ndarray
    curvatures_x: Curvatures
    usual_curvature: np.ndarray
    curvature_y: np.ndarray
    sign: int
    settings: PartSettings
    same_unit: bool = True
    factor: float = 1.0
    places: Places | None = None

    def curvature_x(self, scale: float) -> np.ndarray:
        """(n_x, times) of X at that size, like `curvature_y`."""
        # It has no unit: only the time does.
        values = self.curvatures_x.at(np.array(TIMES) / scale**2)
        return standard_curvature(values, self.usual_curvature)


def both_sides(
    mesh_x: Mesh,
    mesh_y: Mesh,
    *,
    landmarks: ArrayLike | None = None,
    descriptors: tuple[ArrayLike, ArrayLike] | None = None,
    places: Places | None = None,
    same_unit: bool = True,
    settings: PartSettings,
) -> Sides:
    """For maps that keep left and right.

    Args:
        mesh_x, mesh_y: both shapes.
        landmarks: rows (vertex of X, vertex of Y).
        descriptors: of X and of Y, a row for each vertex.
        places: of X and of Y, a row for each vertex.
        same_unit: whether both are in one unit; else the size of X is not read.
        settings: how many samples and starts, and which scales, in one unit.
    """
    oriented, factor = (orient(mesh_x), orient(mesh_y)), 1.0
    if not same_unit:
        factor = _diameter(oriented[1]) / _diameter(oriented[0])
        more = lambda number: round(ANY_UNIT_FACTOR * number)
        settings = replace(
            settings,
            assignments=more(settings.assignments),
            alignments=more(settings.alignments),
            registered_again=more(settings.registered_again),
            scales=ANY_SCALES,
        )
    unit = np.sqrt(surface_area(mesh_y))
    at = ((), ()) if landmarks is None else np.asarray(landmarks).T
    given = (None, None) if descriptors is None else descriptors

    meshes = (
        Mesh(np.asarray(own.vertices, float) / length, np.asarray(own.faces))
        for own, length in zip(oriented, (unit / factor, unit), strict=True)
    )
    nums = settings.samples_of_part, settings.samples_of_whole
    x, y = (
        part_samples(mesh, num, landmarks=own, descriptors=desc)
        for mesh, num, own, desc in zip(meshes, nums, at, given, strict=True)
    )
    coarse_x = decimate(x.mesh, COARSE_PART)
    coarse_y = decimate(y.mesh, COARSE_WHOLE)
    on_x = nearest_vertices(x.mesh, coarse_x)
    out = outward(coarse_y, vertex_normals(*coarse_y))
    whole = whole_at_rest(coarse_y, out)
    from_y, on_y = (
        nearest_vertices(coarse_y, y.mesh),
        nearest_vertices(y.mesh, coarse_y),
    )
    copies = coarse_x, whole, on_x, from_y, on_y
    scales = settings.scales
    # The size that is found may lie a little beyond those that are tried.
    ends = (
        min(TIMES) / (BEYOND * max(scales)) ** 2,
        max(TIMES) * (BEYOND / min(scales)) ** 2,
    )
    curvatures_x = curvatures(x.mesh, *ends)
    curved = curvature(y.mesh, TIMES)
    usual = usual_curvature(curved)
    curved = standard_curvature(curved, usual)
    curved_both = curvatures_x, usual, curved
    if places is not None:
        places = np.asarray(places[0])[on_x], np.asarray(places[1])[on_y]
    return Sides(x, y, *copies, *curved_both, 1, settings, same_unit, factor, places)


def _diameter(mesh: Mesh) -> float:
    """The greatest geodesic distance, or a little less."""
    # A view of a body is about as long as the body, but has far less area.
    solver = GeodesicSolver(mesh)
    opposite = solver.rows(farthest_vertices(mesh, ENDS)).argmax(1)
    return float(solver.rows(opposite).max())


def mirrored(sides: Sides) -> Sides:
    """For maps that exchange left and right, of which the places say nothing."""
    mesh, out = sides.whole.mesh, sides.whole.outward
    return sides._replace(whole=whole_at_rest(mesh, out, -1), sign=-1, places=None)


def landmarks_within(sides: Sides, index_x, index_y) -> np.ndarray:
    """Rows (vertex of the cut of X, of the cut of Y) of landmarks that are in both.

    Args:
        sides: of which both are cut.
        index_x, index_y: the vertices of the cuts.
    """
    rows = []
    for own, index in ((sides.x, index_x), (sides.y, index_y)):
        number = np.full(len(own.mesh.vertices), -1, np.int32)
        number[index] = np.arange(len(index))
        rows.append(number[own.at[own.landmarks]])
    both = np.stack(rows, 1)
    return both[(both >= 0).all(1)]

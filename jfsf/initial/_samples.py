"""Features -> SearchSamples: a shape at samples, all that the search reads of it.

Geodesic distances between samples are shortest paths on a graph of their cells: Floyd
and Warshall find all of them, one matrix operation a sample.

What an extremity looks like, whatever its size: where arms are longer than legs, a map
that turns a body upside down may stretch less than the right one. Three numbers without
a unit tell the ends of limbs apart: how slender they are, and how much they are curved
in sum, since five fingers have more tips than one toe cap.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jfsf._exported import exported
from jfsf.array import matmul
from jfsf.array._jit import jit
from jfsf.geometry._surface import corner_sides, divergence, sum_at_vertices, surface
from jfsf.initial._settings import FIT_SIZE, SearchSettings
from jfsf.initial._terms import ShapeTerms, shape_terms
from jfsf.neighbours import neighbours
from jfsf.spectral import Features, farthest_points
from jfsf.spectral._sampling import biharmonic
from jfsf.types import Spectrum


@jit
def sample_cells(spec: Spectrum, samples: Int[Array, " s"]) -> Int[Array, "n 2"]:
    """The two nearest samples of each vertex, in biharmonic distance.

    The first is the sample whose cell has the vertex. Padding lies at the origin of the
    biharmonic embedding.
    """
    points = biharmonic(spec)
    return neighbours(points, points[samples], k0=2).idx


@jit
def sample_geodesics(
    spec: Spectrum, samples: Int[Array, " s"], cells: Int[Array, "n 2"]
) -> Float[Array, "s s"]:
    """Geodesic distances between samples, the mean over the shape being 1.

    Two samples are joined where a mesh edge runs from the cell of one to the cell of
    the other, and where they are the two nearest samples of a vertex (the witness graph
    of de Silva and Carlsson, 2004), which is all that a point cloud has.

    Args:
        spec: of the whole shape, with vertices; faces or none.
        samples: vertices.
        cells: `sample_cells`.

    Returns:
        Distances, symmetric; a sample that no path reaches has the largest of all.
    """
    num = len(samples)
    faces, cell = spec.faces, cells[:, 0]
    ends = jnp.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    witness = jnp.where((spec.mass > 0)[:, None], cells, cells[:, :1])
    ends = jnp.concatenate([cell[ends], witness])
    at = spec.vertices[samples]
    length = jnp.linalg.norm(at[ends[:, 0]] - at[ends[:, 1]], axis=1)
    graph = jnp.full((num, num), jnp.inf, length.dtype)
    graph = graph.at[ends[:, 0], ends[:, 1]].min(length)
    graph = jnp.minimum(graph, graph.T)
    graph = jnp.where(jnp.eye(num, dtype=bool), 0, graph)

    def through(k, dist):
        return jnp.minimum(dist, dist[:, k, None] + dist[None, k])

    dist = jnp.asarray(jax.lax.fori_loop(0, num, through, graph))
    longest = jnp.max(dist, initial=0, where=jnp.isfinite(dist))
    dist = jnp.minimum(dist, longest)
    mass = jnp.zeros(num, spec.mass.dtype).at[cell].add(spec.mass)
    share = mass / mass.sum()
    mean = matmul(share, matmul(dist, share))
    return dist / jnp.where(mean > 0, mean, 1)


# An end reaches from the tip to this share of the way to the middle of the shape.
REACH = 0.5
# Width of its border: 1 / SHARPNESS of that reach.
SHARPNESS = 8.0
# Added to an area: an end without samples is not infinitely slender.
LEAST_AREA = 1e-3


@jit
def total_curvatures(
    spec: Spectrum, samples: Int[Array, " s"], cells: Int[Array, "n 2"]
) -> Float[Array, "s 2"]:
    """Total curvature of the cell of each sample: both scale-invariant.

    Args:
        spec: of the whole shape; without faces nothing is curved.
        samples: vertices.
        cells: `sample_cells`.

    Returns:
        The integral of |K|, by angle defects, and of H^2 (Willmore energy), by the
        cotangent Laplacian. Vertices on a boundary count 0.
    """
    faces = spec.faces
    _, _, rest, stiff = surface(spec.vertices, faces, spec.mass)

    def at_vertices(values):
        return sum_at_vertices(values, faces, len(spec.mass))

    to, fro = corner_sides(rest)
    across = jnp.linalg.norm(jnp.cross(to, fro), axis=2)
    angle = at_vertices(jnp.arctan2(across, jnp.sum(to * fro, 2)))
    laplacian = divergence(stiff * rest, faces, len(spec.mass))
    # The edges opposite to a vertex make a closed loop, unless it is on a boundary.
    gap = jnp.linalg.norm(at_vertices(rest), axis=1)
    around = at_vertices(jnp.linalg.norm(rest, axis=2))
    inside = (angle > 0) & (gap < 1e-3 * around) & (spec.mass > 0)
    # Not the mass: it may have another unit than the vertices.
    area = jnp.where(inside, at_vertices(across) / 6, 1)
    values = jnp.stack(
        [jnp.abs(2 * jnp.pi - angle), jnp.sum(laplacian**2, 1) / (4 * area)], 1
    )
    values = jnp.where(inside[:, None], values, 0)
    return jnp.zeros((len(samples), 2), values.dtype).at[cells[:, 0]].add(values)


def tip_descriptors(
    geodesics: Float[Array, "e s"],
    reach: Float[Array, " e"],
    mass: Float[Array, " s"],
    total_curvatures: Float[Array, "s 2"],
) -> Float[Array, "e 3"]:
    """Slenderness and total curvatures of the ends of limbs, as logarithms.

    Args:
        geodesics: from each tip to all samples.
        reach: from each tip to the middle of the shape.
        mass: of samples, in sum 1.
        total_curvatures: see there.
    """
    tiny = jnp.finfo(geodesics.dtype).tiny
    border = REACH * jnp.maximum(reach, tiny)[:, None]
    inside = jax.nn.sigmoid(SHARPNESS * (1 - geodesics / border))
    slender = jnp.log(matmul(inside, mass[:, None]) + LEAST_AREA) - 2 * jnp.log(border)
    return jnp.concatenate([slender, jnp.log(1 + matmul(inside, total_curvatures))], 1)


@exported
class SearchSamples(NamedTuple):
    """A shape at samples.

    search_points: features at `SearchSettings.samples` vertices, on which maps are
        refined; all vertices if there are fewer.
    ranking_points: features at `SearchSettings.final_samples` vertices, on which the
        last candidates are ranked.
    fit: for the fits to descriptors.
    geodesics: distances between the search points, see `sample_geodesics`.
    total_curvatures: total curvatures of their cells.
    """

    search_points: Features
    ranking_points: Features
    fit: ShapeTerms
    geodesics: Float[Array, "s s"]
    total_curvatures: Float[Array, "s 2"]


@jit(static_argnames="settings")
def search_samples(
    features: Features,
    among: Int[Array, " p"] | None = None,
    *,
    settings: SearchSettings = SearchSettings(),
) -> SearchSamples:
    """The shape at farthest points; the only stage of the search that depends on n.

    Args:
        features: of the whole shape.
        among: vertices that samples are chosen from, see `farthest_points`.
        settings: how many samples.

    Raises:
        ValueError: fewer eigenpairs than the settings need.
    """
    spec = features.spec
    if len(spec.evals) < settings.eigenpairs:
        raise ValueError(
            f"search_samples: the spectrum has {len(spec.evals)} eigenpairs, the "
            f"search needs {settings.eigenpairs}"
        )
    num = min(settings.final_samples, len(spec.mass if among is None else among))
    chosen = farthest_points(spec, among, num=num)
    # Each point is the farthest from those before it, so the first are samples too.
    search_points, ranking_points = (
        features.at(chosen[:count])
        for count in (settings.samples, settings.final_samples)
    )
    fit = shape_terms(spec, features.descriptors, k=FIT_SIZE)
    at = chosen[: settings.samples]
    cells = sample_cells(spec, at)
    geodesics = sample_geodesics(spec, at, cells)
    return SearchSamples(
        search_points, ranking_points, fit, geodesics, total_curvatures(spec, at, cells)
    )

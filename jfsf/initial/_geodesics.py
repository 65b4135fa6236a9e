"""Geodesic distances between samples: shortest paths on a graph of their cells.

Floyd and Warshall find all of them, one matrix operation a sample.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jfsf.array import matmul
from jfsf.array._jit import jit
from jfsf.neighbours import neighbours
from jfsf.spectral._sampling import DISTANCE_PAIRS, biharmonic
from jfsf.types import Spectrum


@jit
def sample_cells(spec: Spectrum, samples: Int[Array, " s"]) -> Int[Array, "n 2"]:
    """The two nearest samples of each vertex, in biharmonic distance.

    The first is the sample whose cell has the vertex. Padding lies at the origin of the
    biharmonic embedding.
    """
    points = biharmonic(spec, DISTANCE_PAIRS)
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

"""Starts from extremities: hands, feet, heads, wing tips, in geodesic distance.

Shapes of different proportions share few eigenfunctions, but a limb of one is still a
limb of the other. Extremities are the sample of the largest mean geodesic distance, and
then the geodesically farthest from those before it. Every assignment of some of X's to
some of Y's is a start; those that change the distances between extremities most evenly
are tried. More are found than are assigned, so the fingers of a large hand or the
horns of a head may stay without a partner.

Distances are shortest paths on a graph of the samples, by Floyd and Warshall.
"""

from functools import lru_cache, partial
from itertools import combinations, permutations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jfsf.array import map_sides
from jfsf.initial._settings import SearchSettings
from jfsf.neighbours import neighbours
from jfsf.spectral import DISTANCE_PAIRS, Features, biharmonic
from jfsf.types import Spectrum


@partial(jax.jit, static_argnames="distance_pairs")
def sample_geodesics(
    spec: Spectrum, samples: Int[Array, " s"], *, distance_pairs: int = DISTANCE_PAIRS
) -> Float[Array, "s s"]:
    """Geodesic distances between samples, the mean over the shape being 1.

    Two samples are joined where a mesh edge runs from the cell of one to the cell of
    the other, and where they are the two nearest samples of a vertex (the witness graph
    of de Silva and Carlsson, 2004), which is all that a point cloud has.

    Args:
        spec: of the whole shape, with vertices; faces or none.
        samples: vertices.
        distance_pairs: of the biharmonic distance, by which a vertex has its cell.

    Returns:
        Distances, symmetric; a sample that no path reaches has the largest of all.
    """
    num = len(samples)
    points = biharmonic(spec, distance_pairs)
    near = neighbours(points, points[samples], k0=2).idx
    faces, cell = spec.faces, near[:, 0]
    ends = jnp.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    # Padded vertices lie at the origin of the biharmonic embedding.
    witness = jnp.where((spec.mass > 0)[:, None], near, near[:, :1])
    ends = jnp.concatenate([cell[ends], witness])
    at = spec.vertices[samples]
    length = jnp.linalg.norm(at[ends[:, 0]] - at[ends[:, 1]], axis=1)
    graph = jnp.full((num, num), jnp.inf, length.dtype)
    graph = graph.at[ends[:, 0], ends[:, 1]].min(length)
    graph = jnp.minimum(graph, graph.T)
    graph = jnp.where(jnp.eye(num, dtype=bool), 0, graph)

    def through(k, found):
        return jnp.minimum(found, found[:, k, None] + found[None, k])

    found = jnp.asarray(jax.lax.fori_loop(0, num, through, graph))
    longest = jnp.max(found, initial=0, where=jnp.isfinite(found))
    found = jnp.minimum(found, longest)
    mass = jnp.zeros(num, spec.mass.dtype).at[cell].add(spec.mass)
    share = mass / mass.sum()
    mean = share @ (found @ share)
    return found / jnp.where(mean > 0, mean, 1)


def extremities(
    geodesics: Float[Array, "s s"], mass: Float[Array, " s"], *, num: int
) -> Int[Array, " num"]:
    """`num` samples far out: the largest mean distance, then farthest points."""
    mean = geodesics @ mass
    real = mass > 0
    first = jnp.argmax(jnp.where(real, mean, -1))

    def step(far, _):
        new = jnp.argmax(far)
        return jnp.minimum(far, geodesics[new]), new

    far = jnp.where(real, geodesics[first], -1)
    _, others = jax.lax.scan(step, far, None, length=num - 1)
    return jnp.concatenate([first[None], others]).astype(jnp.int32)


def extremity_coordinates(
    x: tuple[Features, Float[Array, "s_x s_x"]],
    y: tuple[Features, Float[Array, "s_y s_y"]],
    *,
    settings: SearchSettings,
) -> tuple[Float[Array, "a s_x m"], Float[Array, "a s_y m"]]:
    """Distances to assigned extremities, for the assignments that fit best.

    Args:
        x, y: features at samples and `sample_geodesics` of each shape.
        settings: `extremities`, `assigned` and `assignments`.

    Returns:
        For each assignment, the distances of all samples of X and of Y to its
        extremities, each divided by its mean over the shape. They are comparable where
        the proportions differ, since the mean of a long limb is long.
    """

    def side(features, geodesics):
        mass = features.spec.mass / features.spec.mass.sum()
        at = extremities(geodesics, mass, num=settings.extremities)
        mean = (geodesics @ mass)[at]
        return geodesics[at][:, at], mean, geodesics[at] / mean[:, None]

    (between_x, mean_x, from_x), (between_y, mean_y, from_y) = map_sides(side, x, y)
    of_x, of_y = (
        jnp.asarray(ends)
        for ends in assignments(settings.extremities, settings.assigned)
    )
    i, j = np.triu_indices(settings.assigned, 1)
    tiny = jnp.finfo(between_x.dtype).tiny
    change = jnp.log(
        jnp.maximum(between_x[of_x[:, i], of_x[:, j]], tiny)
        / jnp.maximum(between_y[of_y[:, i], of_y[:, j]], tiny)
    )
    uneven = jnp.mean(jnp.abs(change - jnp.median(change, 1, keepdims=True)), 1)
    change = jnp.log(mean_x[of_x] / mean_y[of_y])
    further = jnp.mean(jnp.abs(change - jnp.mean(change, 1, keepdims=True)), 1)
    cost = uneven + further / 2
    _, best = jax.lax.top_k(-cost, min(settings.assignments, len(cost)))
    coordinates_x = jnp.swapaxes(from_x[of_x[best]], 1, 2)
    return coordinates_x, jnp.swapaxes(from_y[of_y[best]], 1, 2)


@lru_cache(maxsize=8)
def assignments(num: int, assigned: int) -> tuple[np.ndarray, np.ndarray]:
    """Every way to assign `assigned` of `num` things to as many of `num` others."""
    subsets = list(combinations(range(num), assigned))
    orders = list(permutations(range(num), assigned))
    of_x = np.repeat(np.asarray(subsets, np.int32), len(orders), axis=0)
    of_y = np.tile(np.asarray(orders, np.int32), (len(subsets), 1))
    return of_x, of_y

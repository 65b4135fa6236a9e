"""Farthest-point samples of a shape, and its spectrum seen from the samples only.

Sampled refinement is the "fast" ZoomOut of Melzi et al. (SIGGRAPH Asia 2019), with the
sampling done in the spectral embedding, so that it does not depend on the pose.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jfsf.knn import neighbours
from jfsf.largest import leader
from jfsf.tiles import spectral_tiles
from jfsf.types import Spectrum

DISTANCE_PAIRS = 30  # eigenpairs of the distance; more add detail below the spacing


@partial(jax.jit, static_argnames="num")
def farthest_points(spec: Spectrum, *, num: int) -> Int[Array, " num"]:
    """`num` vertices, each the farthest from those before it.

    The distance is the biharmonic one (Lipman et al., 2010): |Phi_i - Phi_j| weighted
    by 1 / lambda. It does not change with pose, sign flips or vertex order, except
    where two vertices are equally far. Padding (mass 0) is never chosen.

    Raises:
        ValueError: `num` is not in 1..n.
    """
    if not 1 <= num <= len(spec.mass):
        raise ValueError(
            f"farthest_points: num is {num}, the shape has {len(spec.mass)} vertices"
        )
    points = biharmonic(spec)
    far = jnp.where(spec.mass > 0, jnp.sum(points**2, 1), -1)

    def step(state, _):
        far, new = state
        gap = jnp.sum((points - points[new][None]) ** 2, 1)
        far = jnp.minimum(far, gap)
        return (far, leader(far, 0)), new

    # The start is the vertex farthest from the mean; its own distance must not count.
    start = leader(far, 0)
    far = jnp.where(spec.mass > 0, jnp.inf, -1).astype(points.dtype)
    _, chosen = jax.lax.scan(step, (far, start), None, length=num)
    return chosen.astype(jnp.int32)


@partial(jax.jit, static_argnames="num")
def tile_points(spec: Spectrum, *, num: int) -> Int[Array, " s"]:
    """The middle vertex of each of num to 2 num tiles, as many as there are vertices.

    Less even than `farthest_points`, but its time does not grow with `num`: for
    thousands of samples of large meshes.

    Raises:
        ValueError: `num` is not in 1..n.
    """
    n = len(spec.mass)
    if not 1 <= num <= n:
        raise ValueError(f"tile_points: num is {num}, the shape has {n} vertices")
    held = spectral_tiles(spec, size=n // num)
    points = biharmonic(spec)[held.member]
    weight = held.real.astype(points.dtype)
    share = weight / jnp.maximum(weight.sum(1), 1)[:, None]
    centre = jnp.einsum("tsd,ts->td", points, share)
    gap = jnp.sum((points - centre[:, None]) ** 2, 2)
    at = jnp.argmin(jnp.where(held.real, gap, jnp.inf), 1)
    return jnp.take_along_axis(held.member, at[:, None], 1)[:, 0]


@jax.jit
def restrict(spec: Spectrum, at: Int[Array, " s"]) -> Spectrum:
    """The spectrum at the vertices `at`, each with the mass of the cell around it.

    Eigenvectors are rows of the full ones, so they are orthonormal only roughly. The
    faces, which belong to the full mesh, are dropped.
    """
    points = biharmonic(spec)
    cell = neighbours(points, points[at], k0=1).idx[:, 0]
    mass = jnp.zeros(len(at), spec.mass.dtype).at[cell].add(spec.mass)
    return Spectrum(spec.evals, spec.evecs[at], mass, spec.faces[:0], spec.vertices[at])


def biharmonic(spec: Spectrum) -> Float[Array, "n d"]:
    """The embedding whose Euclidean distance is the biharmonic distance."""
    evals = spec.evals[1:DISTANCE_PAIRS]
    return spec.evecs[:, 1:DISTANCE_PAIRS] / jnp.maximum(evals, 1e-6)[None]

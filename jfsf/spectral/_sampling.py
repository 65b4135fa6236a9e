"""Farthest-point samples of a shape, and its spectrum seen from the samples only.

Sampled refinement is the "fast" ZoomOut of Melzi et al. (SIGGRAPH Asia 2019), with the
sampling done in the spectral embedding, so that it does not depend on the pose.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jfsf.array import argmax, einsum, matmul
from jfsf.array._jit import jit
from jfsf.array._loops import varying_as
from jfsf.neighbours import neighbours, spectral_tiles
from jfsf.types import Spectrum

# Eigenpairs of the biharmonic distance. More only add detail finer than the spacing of
# the samples.
DISTANCE_PAIRS = 30


@jit(static_argnames="num")
def farthest_points(
    spec: Spectrum,
    among: Int[Array, " p"] | None = None,
    *,
    num: int,
) -> Int[Array, " num"]:
    """`num` vertices, each the farthest from those before it.

    The distance is the biharmonic one (Lipman et al., 2010): |Phi_i - Phi_j| weighted
    by 1 / lambda. It does not change with pose, sign flips or vertex order, except
    where two vertices are equally far. Padding (mass 0) is never chosen.

    Args:
        spec: n vertices.
        among: the vertices to choose from; all when absent. Of a large shape, some that
            are spread evenly (`even_points`) save time.
        num: how many.

    Raises:
        ValueError: `num` is not in 1..n, or above the length of `among`.
    """
    count = len(spec.mass) if among is None else len(among)
    if not 1 <= num <= count:
        raise ValueError(
            f"farthest_points: num is {num}, there are {count} vertices to choose from"
        )
    points, mass = biharmonic(spec), spec.mass
    if among is not None:
        points, mass = points[among], mass[among]
    square = jnp.sum(points**2, 1)

    def step(state, _):
        far, new = state
        # A product takes half the time of a sum of squared differences.
        gap = square - 2 * matmul(points, points[new]) + square[new]
        # Rounding must not put a chosen vertex before another, nor behind padding.
        far = jnp.minimum(far, jnp.maximum(gap, 0)).at[new].set(-0.5)
        return (far, argmax(far, 0)), new

    # The first point is the vertex farthest from the mean. Its distance to the mean
    # must not take part afterwards.
    start = argmax(jnp.where(mass > 0, square, -1), 0)
    far = jnp.where(mass > 0, jnp.inf, -1).astype(points.dtype)
    begin = varying_as((far, start), points, square)
    _, chosen = jax.lax.scan(step, begin, None, length=num)
    chosen = chosen if among is None else among[chosen]
    return chosen.astype(jnp.int32)


@jit(static_argnames="num")
def tile_points(spec: Spectrum, *, num: int) -> Int[Array, " s"]:
    """The middle vertex of each of `num` tiles, if that is a power of two below n.

    Otherwise there are as many tiles as halving the shape makes: more than num / 2 and
    fewer than 2 num. A tile with nothing but padding gives padding, or a vertex again.

    Less even than `farthest_points`, but the time does not grow with `num`: use it for
    thousands of samples of large meshes.

    Raises:
        ValueError: `num` is not in 1..n.
    """
    n = len(spec.mass)
    if not 1 <= num <= n:
        raise ValueError(f"tile_points: num is {num}, the shape has {n} vertices")
    held = spectral_tiles(spec, size=-(-n // num))
    points = biharmonic(spec)[held.member]
    weight = held.valid.astype(points.dtype)
    share = weight / jnp.maximum(weight.sum(1), 1)[:, None]
    centre = einsum("tsd,ts->td", points, share)
    gap = jnp.sum((points - centre[:, None]) ** 2, 2)
    at = jnp.argmin(jnp.where(held.valid, gap, jnp.inf), 1)
    return jnp.take_along_axis(held.member, at[:, None], 1)[:, 0]


@jit(static_argnames="num")
def even_points(spec: Spectrum, *, num: int) -> Int[Array, " s"]:
    """`tile_points`, or all vertices, with padding behind, of a shape that has no more.

    Raises:
        ValueError: `num` is not in 1..n.
    """
    chosen = tile_points(spec, num=num)
    if len(chosen) != num:
        return chosen
    real = spec.mass > 0
    every = jnp.argsort(~real)[:num].astype(jnp.int32)
    return jnp.asarray(jnp.where(real.sum() <= num, every, chosen))


@jit
def restrict(spec: Spectrum, at: Int[Array, " s"]) -> Spectrum:
    """The spectrum at the vertices `at`, each with the mass of the cell around it.

    Eigenvectors are rows of the full ones, so they are orthonormal only roughly. The
    faces, which belong to the full mesh, are dropped. A sample that is padding, or that
    repeats another, has mass 0.

    Args:
        spec: n vertices.
        at: (s,) vertices, in range (not checked).
    """
    points = biharmonic(spec)
    cell = neighbours(points, points[at], spec.mass[at] > 0, k0=1).idx[:, 0]
    mass = jnp.zeros(len(at), spec.mass.dtype).at[cell].add(spec.mass)
    return Spectrum(spec.evals, spec.evecs[at], mass, spec.faces[:0], spec.vertices[at])


def biharmonic(spec: Spectrum, pairs: int = DISTANCE_PAIRS) -> Float[Array, "n d"]:
    """The embedding whose Euclidean distance is the biharmonic distance.

    Args:
        spec: mass-orthonormal eigenvectors.
        pairs: eigenpairs, the constant included; (n, pairs - 1) comes back.
    """
    evals = spec.evals[1:pairs]
    return spec.evecs[:, 1:pairs] / jnp.maximum(evals, 1e-6)[None]


def rms_distance(points: Float[Array, "n d"], mass: Float[Array, " n"]) -> Array:
    """Root mean squared distance of two random vertices: twice the variance."""
    centre = matmul(mass, points)
    return jnp.sqrt(2 * matmul(mass, jnp.sum((points - centre[None]) ** 2, 1)))

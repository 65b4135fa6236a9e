"""Starts from extremities: hands, feet, heads, wing tips, in geodesic distance.

Shapes of different proportions share few eigenfunctions, but a limb of one is still a
limb of the other. Extremities are the sample of the largest mean geodesic distance, and
then the geodesically farthest from those before it. Every assignment of some of X's to
some of Y's is a start; those that change the distances between extremities most evenly
are tried. More are found than are assigned, so the fingers of a large hand or the
horns of a head may stay without a partner. Beside the distances counts what an
extremity looks like (`tip_descriptors`): hands are not feet, however long the arms.
"""

from functools import lru_cache
from itertools import combinations, permutations
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jfsf.array import matmul
from jfsf.array._loops import map_sides, varying_as
from jfsf.initial._samples import SearchSamples, tip_descriptors

# Extremities that are looked for on each shape, and how many of them one start assigns.
# Two shapes may have unequal numbers of limbs.
EXTREMITIES = 7
ASSIGNED = 5


def extremities(
    geodesics: Float[Array, "s s"], mass: Float[Array, " s"], *, num: int
) -> Int[Array, " num"]:
    """`num` samples far out: the largest mean distance, then farthest points."""
    mean = matmul(geodesics, mass)
    real = mass > 0
    first = jnp.argmax(jnp.where(real, mean, -1))

    def step(far, _):
        new = jnp.argmax(far)
        return jnp.minimum(far, geodesics[new]), new

    far = jnp.where(real, geodesics[first], -1)
    far = varying_as(far, geodesics)
    _, others = jax.lax.scan(step, far, None, length=num - 1)
    return jnp.concatenate([first[None], others]).astype(jnp.int32)


class Assignments(NamedTuple):
    """Assigned extremities, the best first.

    from_x, from_y: for each assignment, the distances of all samples to its
        extremities, each divided by its mean over the shape. They are comparable where
        the proportions differ, since the mean of a long limb is long.
    difference: how much assigned extremities differ, see `tip_descriptors`.
    """

    from_x: Float[Array, "a s_x m"]
    from_y: Float[Array, "a s_y m"]
    difference: Float[Array, " a"]


def best_assignments(x: SearchSamples, y: SearchSamples, *, num: int) -> Assignments:
    """The assignments of extremities that fit best.

    Args:
        x, y: both shapes at samples.
        num: how many, at most.
    """

    def side(samples: SearchSamples):
        geodesics, mass = samples.geodesics, samples.search_points.spec.mass
        share = mass / mass.sum()
        mean = matmul(geodesics, share)
        at = extremities(geodesics, share, num=EXTREMITIES)
        middle = jnp.argmin(jnp.where(mass > 0, mean, jnp.inf))
        far = geodesics[at]
        tips = tip_descriptors(far, far[:, middle], share, samples.total_curvatures)
        return far[:, at], mean[at], far / mean[at][:, None], tips

    sides = map_sides(side, (x,), (y,))
    (between_x, mean_x, from_x, tips_x), (between_y, mean_y, from_y, tips_y) = sides
    of_x, of_y = (jnp.asarray(ends) for ends in assignments(EXTREMITIES, ASSIGNED))
    i, j = np.triu_indices(ASSIGNED, 1)
    tiny = jnp.finfo(between_x.dtype).tiny
    change = jnp.log(
        jnp.maximum(between_x[of_x[:, i], of_x[:, j]], tiny)
        / jnp.maximum(between_y[of_y[:, i], of_y[:, j]], tiny)
    )
    uneven = jnp.mean(jnp.abs(change - jnp.median(change, 1, keepdims=True)), 1)
    change = jnp.log(mean_x[of_x] / mean_y[of_y])
    further = jnp.mean(jnp.abs(change - jnp.mean(change, 1, keepdims=True)), 1)
    apart = jnp.mean(jnp.abs(tips_x[:, None] - tips_y[None]), 2)
    difference = jnp.mean(apart[of_x, of_y], 1)
    cost = uneven + further / 2 + difference
    _, best = jax.lax.top_k(-cost, min(num, len(cost)))
    return Assignments(
        jnp.swapaxes(from_x[of_x[best]], 1, 2),
        jnp.swapaxes(from_y[of_y[best]], 1, 2),
        difference[best],
    )


@lru_cache(maxsize=8)
def assignments(num: int, assigned: int) -> tuple[np.ndarray, np.ndarray]:
    """Every way to assign `assigned` of `num` things to as many of `num` others."""
    subsets = list(combinations(range(num), assigned))
    orders = list(permutations(range(num), assigned))
    of_x = np.repeat(np.asarray(subsets, np.int32), len(orders), axis=0)
    of_y = np.tile(np.asarray(orders, np.int32), (len(subsets), 1))
    return of_x, of_y

"""How well two shapes that were bent onto each other coincide, and how they stretch.

A wrong map asks for more than a surface that resists stretching gives: a distance is
left, and triangles are stretched in one direction and squeezed in the other. Where
proportions differ a right map stretches limbs too, but in both directions alike.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf.array import map_sides, matmul, safe_divide
from jfsf.types import Filtered, Maps, Spectrum

# The logarithm at which a triangle's ratio of stretches is cut off: some degenerate.
MAX_LOG_RATIO = 4.0


class Bending(NamedTuple):
    """Means over two shapes that were bent onto each other.

    residual: distance between a vertex and its image, in sqrt(area).
    distortion: conformal distortion, the logarithm of the ratio of the two principal
        stretches of a triangle; 0 for a similarity.
    """

    residual: Float[Array, ""]
    distortion: Float[Array, ""]


@jax.jit
def bending(
    maps: Filtered | Maps,
    emb_x: Float[Array, "n_x 12"],
    emb_y: Float[Array, "n_y 12"],
    spec_x: Spectrum,
    spec_y: Spectrum,
) -> Bending:
    """How well bent shapes coincide under `maps`, and how they are stretched.

    Args:
        maps: between the vertices.
        emb_x, emb_y: as `jfsf.refine.arap` returns them.
        spec_x, spec_y: both at rest. Of a point cloud nothing is stretched.
    """
    bent_x, bent_y = emb_x[:, :3], emb_y[:, 3:6]
    rest_x, rest_y = spec_x.vertices, spec_y.vertices
    both = map_sides(
        _one_way,
        (spec_x.mass, rest_x, spec_x.faces, bent_x, rest_y[maps.T_xy]),
        (spec_y.mass, rest_y, spec_y.faces, bent_y, rest_x[maps.T_yx]),
    )
    return Bending(*(jnp.mean(jnp.stack(pair)) for pair in zip(*both, strict=True)))


def _one_way(mass, rest, faces, bent, image):
    gap = _root(jnp.sum((bent - image) ** 2, 1))
    (e, f, g), (e1, f1, g1) = (_first_form(points, faces) for points in (rest, bent))
    square = e * g - f**2  # twice the area, squared
    # A triangle that is a line, or padding, has no shape that could be stretched.
    real = square > jnp.finfo(mass.dtype).eps * e * g
    square = jnp.where(real, square, 1)
    # Sum and product of the squares of both principal stretches.
    total = (e1 * g - 2 * f1 * f + g1 * e) / square
    product = (e1 * g1 - f1**2) / square
    root = _root(total**2 / 4 - product)
    large, small = total / 2 + root, total / 2 - root
    ratio = large / jnp.maximum(small, large * jnp.exp(-2 * MAX_LOG_RATIO))
    ratio = jnp.where(real & (large > 0), ratio, 1)
    weight = jnp.where(real, jnp.sqrt(square), 0)
    distortion = matmul(weight, jnp.log(ratio) / 2)
    return matmul(mass, gap) / mass.sum(), safe_divide(distortion, weight.sum())


def _root(square):
    """The square root; its derivative at 0 is 0, not infinite."""
    positive = square > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, square, 1)), 0)


def _first_form(points, faces):
    """E, F and G of each triangle: products of two of its edges."""
    corner = points[faces]
    a, b = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    return jnp.sum(a * a, 1), jnp.sum(a * b, 1), jnp.sum(b * b, 1)

"""A texture of Y -> a new image for X, and X's texture coordinates in it.

One texture coordinate a vertex smears: on a face across a seam of Y it runs through all
of the image between both sides. So each texel of the new image is a point of X, goes
to its point on Y, and takes the colour there.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Shaped, UInt8

from jfsf.apps.transfer._atlas import atlas
from jfsf.apps.transfer._nearest import Points, from_x_to_y
from jfsf.apps.transfer._overlay import Overlay
from jfsf.types import ArrayLike

SIZE = 2048
NO_COLOUR = 128  # grey, where Y has no surface or no texture
TEXELS = 200_000  # at a time


class Baked(NamedTuple):
    """A texture of X.

    image: (size, size, c), the first row at the top.
    uv: (m_x, 3, 2) of each corner of X's faces, u to the right, v up, in [0, 1].
    """

    image: UInt8[ArrayLike, "size size c"]
    uv: Float[ArrayLike, "m_x 3 2"]


def texture(
    overlay: Overlay,
    uv_y: Float[ArrayLike, "m_y 3 2"],
    image_y: Shaped[ArrayLike, "h w c"],
    *,
    size: int = SIZE,
) -> Baked:
    """A texture carried from Y to X, as a new image.

    Args:
        overlay: X and Y laid over each other (`overlay`); both with faces.
        uv_y: texture coordinates of the corners of Y's faces (`jfsf.mesh.read_uv`): u
            to the right, v up; the image repeats at whole numbers.
        image_y: the image, 8 bits for each channel, the first row at the top.
        size: width and height of the new image, a power of two.

    Returns:
        The image, where each face of X has a triangle of its own, and X's coordinates.
        Grey where Y has no surface or no coordinates.

    Raises:
        ValueError: uv_y is not that of Y's faces; no image of 8 bits; X or Y is a point
            cloud; or X has too many faces for the size.
    """
    uv_y, image_y = np.asarray(uv_y, np.float64), np.asarray(image_y)
    m_x, m_y = len(overlay.mesh_x.faces), len(overlay.mesh_y.faces)
    if not m_x or not m_y:
        raise ValueError(
            f"texture: X has {m_x} faces and Y {m_y}; a texture needs faces on both"
        )
    if uv_y.shape != (m_y, 3, 2):
        raise ValueError(
            f"texture: uv_y is {uv_y.shape}; give ({m_y}, 3, 2), two numbers a corner "
            "of Y's faces"
        )
    if image_y.ndim != 3 or image_y.dtype != np.uint8 or not image_y.size:
        raise ValueError(
            f"texture: image_y is {image_y.dtype} {image_y.shape}; give uint8 rows, "
            "columns and channels"
        )
    to_y = from_x_to_y(overlay)
    faces = np.asarray(overlay.mesh_x.faces)
    corners = np.asarray(overlay.mesh_x.vertices, np.float64)[faces]
    where = atlas(corners, size)
    grey = _grey(image_y)
    image = np.tile(grey.astype(np.uint8), (size, size, 1))
    for cells in where.cells:
        number = max(1, TEXELS // len(cells.weights))
        for start in range(0, len(cells.face), number):
            face = cells.face[start : start + number]
            first = cells.first[start : start + number]
            turned = np.take_along_axis(faces[face], where.turn[face], 1)
            vertices = np.repeat(turned, len(cells.weights), axis=0)
            weights = np.tile(cells.weights, (len(face), 1))
            points = Points(np.repeat(face, len(cells.weights)), vertices, weights)
            on_y = to_y(points)
            uv = np.einsum("qc,qcd->qd", on_y.weights, uv_y[on_y.face])
            colour = look_up(image_y, uv)
            colour[~overlay.known_x[vertices].all(1)] = grey
            texel = (first[:, None] + cells.texels[None]).reshape(-1, 2)
            image[texel[:, 0], texel[:, 1]] = np.rint(colour)
    return Baked(image, where.uv)


def look_up(
    image: Shaped[ArrayLike, "h w c"], uv: Float[ArrayLike, "q 2"]
) -> Float[ArrayLike, "q c"]:
    """The colours of an image at texture coordinates, bilinear between texels.

    Args:
        image: the first row at the top; it repeats.
        uv: u to the right, v up. nan gives grey.
    """
    image, uv = np.asarray(image), np.asarray(uv, np.float64)
    high, wide = image.shape[:2]
    known = np.isfinite(uv).all(1)
    u, v = np.where(known[:, None], uv, 0).T
    column, row = u * wide - 0.5, (1 - v) * high - 0.5
    left, top = np.floor(column), np.floor(row)
    right, down = (column - left)[:, None], (row - top)[:, None]
    at = lambda r, c: image[
        (top + r).astype(int) % high, (left + c).astype(int) % wide
    ].astype(np.float64)
    upper = at(0, 0) * (1 - right) + at(0, 1) * right
    lower = at(1, 0) * (1 - right) + at(1, 1) * right
    colour = upper * (1 - down) + lower * down
    return np.where(known[:, None], colour, _grey(image))


def _grey(image):
    """The colour of what has none, with the channels of an image: opaque."""
    grey = np.full(image.shape[2], NO_COLOUR)
    if len(grey) in (2, 4):
        grey[-1] = 255
    return grey

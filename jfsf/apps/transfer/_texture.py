"""A texture of Y -> a new image for X, and X's texture coordinates in it.

One texture coordinate a vertex smears: on a face across a seam of Y it runs through all
of the image between both sides. So each texel of the new image is a point of X, goes
to its point on Y, and takes the colour there.

Each face has a right-angled triangle of texels of its own, so that nothing of one face
is next to another by accident, and any mesh has an atlas. Two faces share a square; the
sides of squares are powers of two, so that they fill the image without gaps, the
largest first, along a curve of Morton (1966).

Corners lie on the centres of texels. What a bilinear look-up reads within a face
belongs to it: there is a margin of one texel around the triangle.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, Shaped, UInt8

from jfsf.apps.transfer._nearest import Points, from_x_to_y
from jfsf.apps.transfer._overlay import Overlay
from jfsf.types import ArrayLike

MARGIN = 5  # texels of the side of a square that are not along a leg
SMALLEST = 8  # the side of a square
LARGEST = 16384  # the side of the image: what graphics cards take
STEPS = 60  # of the bisection for the scale


class Cells(NamedTuple):
    """Faces whose triangles in the image are alike.

    face: (c,) these faces.
    first: (c, 2) row and column of the first texel of the square of each.
    texels: (t, 2) rows and columns within the square that belong to the face.
    weights: (t, 3) barycentric coordinates of their centres in the face, 0 or more.
    corners: (3, 2) rows and columns, within the square, of the corners of a face.
    """

    face: Int[ArrayLike, " c"]
    first: Int[ArrayLike, "c 2"]
    texels: Int[ArrayLike, "t 2"]
    weights: Float[ArrayLike, "t 3"]
    corners: Int[ArrayLike, "3 2"]


class Atlas(NamedTuple):
    """An image with a place for each of m faces.

    cells: the faces, each in one of them.
    uv: (m, 3, 2) texture coordinates of the corners: u to the right, v up, in [0, 1].
    turn: (m, 3) the corner of the face for each corner of a cell: its right angle lies
        at the widest angle of the face.
    """

    cells: tuple[Cells, ...]
    uv: Float[ArrayLike, "m 3 2"]
    turn: Int[ArrayLike, "m 3"]


def check_size(m: int, size: int) -> None:
    """ValueError unless an image of this size has places for m faces.

    Args:
        m: number of faces.
        size: width and height in texels.
    """
    if not SMALLEST <= size <= LARGEST or size & (size - 1):
        raise ValueError(
            f"the size of the image is {size}; give a power of two from {SMALLEST} to "
            f"{LARGEST}"
        )
    if -(-m // 2) * SMALLEST**2 > size**2:
        raise ValueError(
            f"{m} faces do not fit into an image of {size} by {size} texels; make it "
            "larger, or the mesh coarser"
        )


def atlas(corners: Float[ArrayLike, "m 3 3"], size: int) -> Atlas:
    """Give each face a triangle of its own in a square image, larger for longer faces.

    Args:
        corners: positions of the corners of the faces.
        size: width and height of the image, a power of two.

    Raises:
        ValueError: as `check_size`.
    """
    corners = np.asarray(corners, np.float64)
    check_size(len(corners), size)
    opposite = [corners[:, (i + 2) % 3] - corners[:, (i + 1) % 3] for i in range(3)]
    length = np.linalg.norm(np.stack(opposite, 1), axis=2)
    first = length.argmax(1)
    turn = (first[:, None] + np.arange(3)) % 3
    legs = np.take_along_axis(length, turn[:, 1:], 1).max(1)
    side = _sides(legs, size)
    cells, uv = [], np.zeros((len(corners), 3, 2))
    offset = 0
    for length_s in np.unique(side)[::-1].tolist():
        faces = np.flatnonzero(side == length_s)
        squares = -(-len(faces) // 2)
        at = offset + length_s**2 * np.arange(squares)
        offset += length_s**2 * squares
        square = np.stack(_morton(at), 1)
        for half in range(2):
            own = _cells(faces[half::2], square[: len(faces[half::2])], length_s, half)
            cells.append(own)
            texel = own.first[:, None] + own.corners[None]
            place = np.stack([texel[..., 1] + 0.5, size - texel[..., 0] - 0.5], 2)
            rows = own.face[:, None]
            uv[rows, turn[own.face]] = place / size
    return Atlas(tuple(cells), uv, turn)


def _sides(legs, size: int):
    """Sides (m,) of the squares: as many texels a length as fit."""
    longest = max(float(legs.max()), 1e-300)

    def sides(scale):
        wanted = legs / longest * scale + MARGIN
        power = 2.0 ** np.floor(np.log2(np.maximum(wanted, SMALLEST)))
        return np.minimum(power, size).astype(int)

    def fits(scale):
        side, count = np.unique(sides(scale), return_counts=True)
        return (-(-count // 2) * side**2).sum() <= size**2

    low, high = 0.0, float(2 * size)
    for _ in range(STEPS):
        middle = (low + high) / 2
        low, high = (middle, high) if fits(middle) else (low, middle)
    return sides(low)


def _cells(faces, first, side: int, half: int) -> Cells:
    """The lower or the upper triangles of squares: the rows grow downward."""
    last = side - MARGIN  # texels along a leg
    row, column = np.meshgrid(np.arange(side), np.arange(side), indexing="ij")
    if half == 0:
        corners = np.array([[1, 1], [1 + last, 1], [1, 1 + last]])
        own = row + column <= side - 2
    else:
        far = side - 2
        corners = np.array([[far, far], [far - last, far], [far, far - last]])
        own = row + column >= side - 1
    texels = np.stack([row[own], column[own]], 1)
    two = (texels - corners[0]) * (1 - 2 * half) / last
    # The margin repeats what is about the nearest.
    weights = np.maximum(np.column_stack([1 - two.sum(1), two]), 0)
    weights /= weights.sum(1, keepdims=True)
    return Cells(faces, first, texels, weights, corners)


def _morton(at):
    """Rows and columns of places along the curve: the bits of `at` by turns."""
    row, column = np.zeros_like(at), np.zeros_like(at)
    for bit in range(32):
        column |= ((at >> (2 * bit)) & 1) << bit
        row |= ((at >> (2 * bit + 1)) & 1) << bit
    return row, column


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

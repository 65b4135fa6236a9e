"""Rigid motions that lay one shape on the other, where they are in similar poses.

Host side. Scans of standing bodies, or of animals, often differ by a motion and a
little bending. A cut changes geodesics, but not where the surface is and which way it
faces. Motions that are off by a tenth of the shape will do: the whole is drawn onto the
part from there (`_register`).
"""

from typing import NamedTuple, cast

import numpy as np
from scipy import fft
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from jfsf.matching.parts._register import NORMAL_WEIGHT, Whole
from jfsf.matching.parts._settings import ANY_UNIT_BANDS
from jfsf.mesh._geometry import vertex_areas, vertex_normals
from jfsf.types import Mesh

ROTATIONS = 400  # that are tried, spread over all
# Factors of the part's lengths that are tried with each rotation, where both shapes are
# in one unit and where units may differ.
SCALES = 0.9, 1.15
ANY_SCALES = tuple(float(scale) for scale in np.exp(np.linspace(-0.75, 0.75, 6)))
# Lengths are in sqrt(area of the whole). Cells of the grid of shifts, and the width of
# the Gaussian by which both surfaces are blurred.
CELL, BLUR = 0.1, 0.1
DENSITY = 0.3  # how much a surface counts beside its normals
MIN_DISTANCE = 0.15  # mean distance of where two motions that are kept lay the part
AT_A_TIME = 20  # rotations, so that the grids stay in the cache
# Super-Fibonacci spirals: sqrt(2) and the real root of psi^4 = psi + 4.
PHI, PSI = np.sqrt(2.0), 1.533751168755204288118041
# Of the grid, in sums of the radii of both shapes: shifts that differ by a period are
# one, and at the greater of them next to nothing overlaps.
PERIOD = 1.3
COMPARED = 60  # points by which alignments are told apart


class Alignment(NamedTuple):
    """A motion, with a change of size: p goes to scale * rotation p + shift.

    overlap: how much of both surfaces then lies together and faces the same way, an
        area over the scale. Large is good.
    """

    scale: float
    rotation: np.ndarray
    shift: np.ndarray
    overlap: float

    def apply(self, points: np.ndarray) -> np.ndarray:
        """(n, 3) the points of X, laid on Y."""
        return self.scale * points @ self.rotation.T + self.shift


def aligned(
    x: Mesh, whole: Whole, number: int, *, same_unit: bool = True
) -> list[tuple[np.ndarray, float]]:
    """A map from X to the whole, and the scale of X, of each of the best motions.

    Args:
        x: the part.
        whole: a mirror image where the maps are to mirror.
        number, same_unit: as `alignments`.
    """
    y, weight = whole.mesh, NORMAL_WEIGHT
    normal_x, normal_y = vertex_normals(*x), whole.rest.normal_sign * vertex_normals(*y)
    tree = KDTree(np.concatenate([y.vertices, weight * normal_y], 1))
    maps = []
    both = x, y, normal_x, normal_y
    for one in alignments(*both, number, same_unit=same_unit):
        facing = weight * normal_x @ one.rotation.T
        laid = np.concatenate([one.apply(x.vertices), facing], 1)
        maps.append((tree.query(laid)[1], one.scale))
    return maps


def alignments(
    x: Mesh,
    y: Mesh,
    normal_x: np.ndarray,
    normal_y: np.ndarray,
    number: int,
    *,
    same_unit: bool = True,
) -> list[Alignment]:
    """The best motions that differ, the best first.

    Of each rotation R and scale s the shift t is that with the largest overlap

        s sum_ij a_i b_j (<R n_i, m_j> + c) (g * g)(s R p_i + t - q_j),

    g a Gaussian of width `BLUR`, c `DENSITY`, a and b the areas of
    vertices, n and m normals, p and q positions. The blurred normals of both sides of
    a thin limb cancel, and c lets it count. One Fourier transform finds it for all t.

    Args:
        x, y: both shapes, in the unit of Y.
        normal_x, normal_y: (n, 3) outward unit normals.
        number: motions, at most.
        same_unit: whether both are in one unit. Else more scales are tried, and each of
            `ANY_UNIT_BANDS` bands of scales has equally many motions.
    """
    if not number:
        return []
    scales, num_bands = (SCALES, 1) if same_unit else (ANY_SCALES, ANY_UNIT_BANDS)
    both = _surface(x, normal_x), _surface(y, normal_y)
    bands = np.arange(len(scales)) * num_bands // len(scales)
    some = x.vertices[:: -(-len(x.vertices) // COMPARED)]
    most = -(-number // num_bands)
    chosen: list[Alignment] = []
    for band in np.unique(bands):
        motions: list[Alignment] = []
        for i in np.flatnonzero(bands == band):
            motions += _of_scale(*both, scales[i])
        motions.sort(key=lambda one: -one.overlap)
        chosen += _different(motions, some, most, MIN_DISTANCE)
    return sorted(chosen, key=lambda one: -one.overlap)


class _Surface(NamedTuple):
    """A shape about its middle: places, what is compared at them, areas, and radius.

    compared: (n, 4), the normal, and the root of `DENSITY`.
    """

    middle: np.ndarray
    at: np.ndarray
    compared: np.ndarray
    area: np.ndarray
    radius: float


def _surface(mesh: Mesh, normal: np.ndarray) -> _Surface:
    area = vertex_areas(*mesh)
    middle = area @ mesh.vertices / area.sum()
    at = mesh.vertices - middle
    solid = np.full((len(at), 1), np.sqrt(DENSITY))
    radius = float(np.linalg.norm(at, axis=1).max())
    return _Surface(middle, at, np.concatenate([normal, solid], 1), area, radius)


def _of_scale(x: _Surface, y: _Surface, scale: float) -> list[Alignment]:
    """The best shift of each rotation."""
    cell, turns = CELL, _rotations(ROTATIONS)
    n = 1 + int(PERIOD * (scale * x.radius + y.radius) / cell)
    n = cast(int, fft.next_fast_len(n, real=True))
    field_y = _field(y.at[None] / cell, (y.area[:, None] * y.compared)[None], n)
    found = []
    for start in range(0, len(turns), AT_A_TIME):
        rotation = turns[start : start + AT_A_TIME]
        compared = np.repeat(x.compared[None], len(rotation), 0)
        compared[..., :3] = compared[..., :3] @ rotation.swapaxes(1, 2)
        places = scale * x.at @ rotation.swapaxes(1, 2) / cell
        field_x = _field(places, scale * x.area[:, None] * compared, n)
        overlap = correlation(field_x, field_y, BLUR / cell)
        overlap = overlap.reshape(len(rotation), -1)
        steps = np.stack(np.unravel_index(overlap.argmax(1), (n, n, n)), 1)
        steps = np.where(steps > n // 2, steps - n, steps)
        shift = y.middle + cell * steps - scale * rotation @ x.middle
        best = overlap.max(1).tolist()
        found += [
            Alignment(scale, *one) for one in zip(rotation, shift, best, strict=True)
        ]
    return found


def correlation(field_x: np.ndarray, field_y: np.ndarray, blur: float) -> np.ndarray:
    """(b, n, n, n) sum over u of <x(u), y(u + t)> for each t, of blurred fields.

    Args:
        field_x: (b, c, n, n, n), on a grid that is periodic.
        field_y: (1, c, n, n, n), on the same grid.
        blur: width of the Gaussian, in cells, by which both are blurred.
    """
    n, axes = field_x.shape[-1], (2, 3, 4)
    k, last = 2 * np.pi * fft.fftfreq(n), 2 * np.pi * fft.rfftfreq(n)
    square = k[:, None, None] ** 2 + k[None, :, None] ** 2 + last[None, None] ** 2
    kernel = np.exp(-(blur**2) * square).astype(field_x.dtype)
    other = kernel * np.asarray(fft.rfftn(field_y, axes=axes))[0]
    own = np.conj(np.asarray(fft.rfftn(field_x, axes=axes, workers=-1)))
    both = np.einsum("cxyz,bcxyz->bxyz", other, own)
    return np.asarray(fft.irfftn(both, s=(n, n, n), axes=(1, 2, 3), workers=-1))


def _field(places: np.ndarray, values: np.ndarray, n: int) -> np.ndarray:
    """(b, c, n, n, n) float32: values (b, p, c) added to the nearest cells."""
    cells = np.rint(places).astype(int) % n
    batch = np.arange(len(places))[:, None]
    at = (((batch * n + cells[..., 0]) * n + cells[..., 1]) * n + cells[..., 2]).ravel()
    size = len(places) * n**3
    sums = [np.bincount(at, own.ravel(), size) for own in np.moveaxis(values, 2, 0)]
    grids = np.stack(sums).astype(np.float32).reshape(-1, len(places), n, n, n)
    return grids.swapaxes(0, 1)


def _rotations(num: int) -> np.ndarray:
    """(num, 3, 3) spread evenly over all rotations (Alexa, CVPR 2022)."""
    at = np.arange(num) + 0.5
    inner, outer = np.sqrt(at / num), np.sqrt(1 - at / num)
    a, b = 2 * np.pi * at / PHI, 2 * np.pi * at / PSI
    pairs = (inner, a), (outer, b)
    columns = [r * turn(at) for r, at in pairs for turn in (np.sin, np.cos)]
    return Rotation.from_quat(np.stack(columns, 1)).as_matrix()


def _different(
    found: list[Alignment], points: np.ndarray, most: int, apart: float
) -> list[Alignment]:
    """The first that lay points further from where those before lay them."""
    chosen: list[Alignment] = []
    images: list[np.ndarray] = []
    for one in found:
        own = one.apply(points)
        away = (np.linalg.norm(own - other, axis=1).mean() for other in images)
        if len(chosen) < most and all(far > apart for far in away):
            chosen.append(one)
            images.append(own)
    return chosen

"""As rigid as possible: bend each shape onto the other, compare where vertices come to.

A map read from eigenfunctions slides along the surface, as nothing in them forbids. A
shape that is bent by its map onto the other, and resists stretching (Sorkine and Alexa,
SGP 2007), slides less: where its vertices and normals come to is what the next
conversion compares. Both are bent, so that neither direction has a say of its own.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.sparse.linalg import cg
from jaxtyping import Array, Float, Int

from jfsf.descriptors import normals
from jfsf.fmap import uniform
from jfsf.refine.zoomout import Converter
from jfsf.sides import both
from jfsf.types import Maps, Spectrum, Tiles

REACH = 0.04  # what a map does within this length is smoothed; sqrt(area) is 1
NORMAL = 0.03  # half the distance that opposite normals count for
TURNS = 2  # rotations, each with a solve, in a bend
STEPS = 60  # of conjugate gradients, at most
CLOSE = 1e-3  # relative residual that they stop at
STIFF = 0.01, 100.0  # an obtuse corner's cotangent is negative, a sliver's infinite
SQUARINGS = 8  # of the 256th power of a matrix, the leading eigenvector is left


class Surface(NamedTuple):
    """A mesh at rest.

    faces, mass: as in `Spectrum`.
    rest: the edge opposite to each corner.
    stiff: half the cotangent of that corner.
    """

    faces: Int[Array, "m 3"]
    mass: Float[Array, " n"]
    rest: Float[Array, "m 3 3"]
    stiff: Float[Array, "m 3 1"]


@partial(jax.jit, static_argnames=("rounds", "converter"))
def arap(
    spec_x: Spectrum,
    spec_y: Spectrum,
    maps: Maps,
    handed: Float[Array, ""] | float = 1.0,
    *,
    rounds: int = 8,
    converter: Converter,
    tiles: tuple[Tiles, Tiles] | None = None,
) -> tuple[Float[Array, "n_x 12"], Float[Array, "n_y 12"]]:
    """Refine maps that are nearly right; convert what it returns for the final ones.

    Args:
        spec_x, spec_y: vertices, mass and faces, wound outward, are read, not the
            eigenpairs; mass 0 is padding.
        maps: the start, both ways.
        handed: -1 for maps that mirror, else 1.
        rounds: times that both shapes are bent, with a conversion in between.
        converter: `nearest`, `sinkhorn` or any other with their signature.
        tiles: of X and of Y (`jfsf.tiles.spectral_tiles`), handed to the converter.

    Returns:
        Aligned embeddings (emb_x, emb_y) in units of sqrt(area): the place of a vertex
        on Y and on X, on the other shape after bending, and its normals there.

    Raises:
        ValueError: rounds is below 1, or a shape has no faces.
    """
    if rounds < 1:
        raise ValueError(f"arap: rounds is {rounds}, it must be positive")
    if len(spec_x.faces) == 0 or len(spec_y.faces) == 0:
        raise ValueError(
            f"arap: X has {len(spec_x.faces)} faces and Y {len(spec_y.faces)}; a point "
            "cloud does not bend"
        )
    if tiles is not None:
        converter = partial(converter, tiles=tiles)
    marginals = uniform(spec_x.mass), uniform(spec_y.mass)

    def still(spec):
        return surface(spec, handed), NORMAL * normals(spec.vertices, spec.faces)

    (surface_x, normal_x), (surface_y, normal_y) = both(still, (spec_x,), (spec_y,))

    def one_way(surface, target, start):
        bent = bend(surface, target, start)
        return bent, handed * NORMAL * normals(bent, surface.faces)

    def embed(bent_x, turned_x, bent_y, turned_y):
        emb_x = jnp.concatenate([bent_x, spec_x.vertices, turned_x, normal_x], 1)
        emb_y = jnp.concatenate([spec_y.vertices, bent_y, normal_y, turned_y], 1)
        return emb_x, emb_y

    def convert(embs):
        found = converter(*embs, *marginals)
        return found.T_xy.astype(jnp.int32), found.T_yx.astype(jnp.int32)

    given = maps.T_xy.astype(jnp.int32), maps.T_yx.astype(jnp.int32)

    def step(embs, first):
        # One body for all rounds, the first included, is one program.
        T_xy, T_yx = jax.lax.cond(first, lambda _: given, convert, embs)
        bent = both(
            one_way,
            (surface_x, spec_y.vertices[T_xy], embs[0][:, :3]),
            (surface_y, spec_x.vertices[T_yx], embs[1][:, 3:6]),
        )
        return embed(*bent[0], *bent[1]), None

    # Before they are bent all vertices lie where the maps send them; no normals yet.
    start_x, start_y = spec_y.vertices[given[0]], spec_x.vertices[given[1]]
    start = embed(start_x, 0 * start_x, start_y, 0 * start_y)
    return jax.lax.scan(step, start, jnp.arange(rounds) == 0)[0]


def surface(spec: Spectrum, handed: Float[Array, ""] | float = 1.0) -> Surface:
    """The mesh of `spec`, mirrored where `handed` is -1."""
    mirror = jnp.ones((1, 3), spec.vertices.dtype).at[0, 0].set(handed)
    rest = _edges(spec.vertices * mirror, spec.faces)
    to, fro = _ahead(rest, 2), -_ahead(rest, 1)
    across = jnp.sum(jnp.cross(to, fro) ** 2, 2, keepdims=True)
    flat = across == 0
    across = jnp.sqrt(jnp.where(flat, 1, across))
    cotangent = jnp.sum(to * fro, 2, keepdims=True) / across
    # Flat faces, those of padding among them, hold nothing together.
    stiff = jnp.where(flat, 0, jnp.clip(cotangent, *STIFF) / 2)
    return Surface(spec.faces, spec.mass, rest, stiff)


def bend(
    surface: Surface, target: Float[Array, "n 3"], start: Float[Array, "n 3"]
) -> Float[Array, "n 3"]:
    """Where vertices come to when each is drawn to its target and edges resist.

    0 on padding.
    """
    faces, mass, rest, stiff = surface
    n = len(mass)
    real = (mass > 0)[:, None]
    target, start = jnp.where(real, target, 0), jnp.where(real, start, 0)
    pull = jnp.where(real, mass[:, None] / REACH**2, 1)

    def at_vertices(values):
        return jnp.zeros((n, values.shape[2]), values.dtype).at[faces].add(values)

    def divergence(flux):
        return at_vertices(_ahead(flux, 1) - _ahead(flux, 2))

    diagonal = at_vertices(_ahead(stiff, 1) + _ahead(stiff, 2)) + pull

    def resist(x):
        return divergence(stiff * _edges(x, faces)) + pull * x

    def turn(x, _):
        outer = rest[..., :, None] * (stiff * _edges(x, faces))[..., None, :]
        outer = outer.reshape(len(faces), 3, 9)
        covariance = at_vertices(_ahead(outer, 1) + _ahead(outer, 2))
        rotation = rotations(covariance.reshape(n, 3, 3))[faces]
        mean = (_ahead(rotation, 1) + _ahead(rotation, 2)) / 2
        turned = jnp.sum(mean * rest[:, :, None], 3)
        right = divergence(stiff * turned) + pull * target
        precondition = lambda residual: residual / diagonal
        options = {"tol": CLOSE, "maxiter": STEPS, "M": precondition}
        return cg(resist, right, x, **options)[0], None

    return jax.lax.scan(turn, start, None, length=TURNS)[0]


def rotations(covariance: Float[Array, "n 3 3"]) -> Float[Array, "n 3 3"]:
    """The rotation R of each that makes sum_ab covariance_ab R_ba largest.

    Its quaternion is the leading eigenvector of a 4 x 4 matrix (Horn, JOSA A 1987),
    found by squaring: all vertices at once, where an SVD each takes ten times longer.
    Where two rotations do equally well, it is neither.
    """
    m = jnp.moveaxis(covariance, 0, 2)  # many, each small: they go along the last axis
    xx, yy, zz = m[0, 0], m[1, 1], m[2, 2]
    odd, even = m - m.swapaxes(0, 1), m + m.swapaxes(0, 1)
    horn = _matrix(
        [xx + yy + zz, odd[1, 2], odd[2, 0], odd[0, 1]],
        [odd[1, 2], xx - yy - zz, even[0, 1], even[2, 0]],
        [odd[2, 0], even[0, 1], yy - xx - zz, even[1, 2]],
        [odd[0, 1], even[2, 0], even[1, 2], zz - xx - yy],
    )
    size = jnp.max(jnp.sum(jnp.abs(horn), 1), 0)
    eye = jnp.eye(4, dtype=m.dtype)[..., None]
    power = horn + size[None, None] * eye  # no eigenvalue is below 0
    for _ in range(SQUARINGS):
        trace = jnp.trace(power)
        power = power / jnp.where(trace > 0, trace, 1)[None, None]
        power = jnp.sum(power[:, :, None] * power[None], 1)
    best = jnp.argmax(jnp.diagonal(power), 1)
    column = jnp.take_along_axis(power, best[None, None], 1)[:, 0]
    square = jnp.sum(column**2, 0)
    w, x, y, z = column / jnp.sqrt(jnp.where(square > 0, square, 1))[None]
    rotation = _matrix(
        [1 - 2 * (y**2 + z**2), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x**2 + z**2), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x**2 + y**2)],
    )
    return jnp.moveaxis(rotation, 2, 0)


def _matrix(*rows):
    return jnp.stack([jnp.stack(row) for row in rows])


def _edges(points, faces):
    corners = points[faces]
    return _ahead(corners, 2) - _ahead(corners, 1)


def _ahead(corners, by: int):
    """For each corner of a face, what the one `by` after it has."""
    return jnp.roll(corners, -by, 1)

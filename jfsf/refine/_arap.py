"""As rigid as possible: deform each shape onto the other, compare the results.

A map read from eigenfunctions slides along the surface, since they do not penalise it.
It slides less if each shape is deformed by its map onto the other and resists
stretching (Sorkine and Alexa, SGP 2007). The next conversion then compares deformed
positions and normals with those of the target. Both shapes are deformed, so that both
directions count alike.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax.scipy.sparse.linalg import cg
from jaxtyping import Array, Float

from jfsf.array import matmul
from jfsf.array._jit import check_types, jit
from jfsf.array._loops import map_sides, varying_as
from jfsf.convert import Converter, maps_of
from jfsf.geometry import normals
from jfsf.geometry._surface import (
    Surface,
    divergence,
    next_corners,
    opposite_edges,
    sum_at_vertices,
    surface,
)
from jfsf.neighbours import NeighbourSearch
from jfsf.spectral import uniform
from jfsf.types import Bent, Maps, Spectrum

SQUARINGS = 8  # of a 4 x 4 matrix: its 256th power is the leading eigenvector's


@dataclass(frozen=True)
class ArapSettings:
    """How shapes are deformed. Hashable, for static arguments.

    reach: length, in sqrt(area), below which the motion that a map asks for is
        smoothed.
    normal_weight: half the distance, in sqrt(area), that opposite normals count for.
    rotation_updates: updates of the rotations in one deformation, each followed by a
        linear solve.
    max_steps: most steps of conjugate gradients in a linear solve.
    tolerance: relative residual at which conjugate gradients stop.
    """

    reach: float = 0.04
    normal_weight: float = 0.03
    rotation_updates: int = 2
    max_steps: int = 60
    tolerance: float = 1e-3

    def __post_init__(self) -> None:
        """ValueError for a value of another type."""
        check_types(self)


@jit(
    static_argnames=("rounds", "converter", "settings"),
)
def arap(
    spec_x: Spectrum,
    spec_y: Spectrum,
    start: Maps | Bent,
    orientation_sign: Float[Array, ""] | float = 1.0,
    *,
    rounds: int = 8,
    converter: Converter,
    search: NeighbourSearch | None = None,
    settings: ArapSettings = ArapSettings(),
) -> tuple[Float[Array, "n_x 12"], Float[Array, "n_y 12"]]:
    """Refine maps that are nearly right; convert what it returns for the final ones.

    Args:
        spec_x, spec_y: spectra with vertices, and with faces wound outward; mass 0 is
            padding. The eigenpairs only shorten the linear solves.
        start: maps in both directions, or shapes already deformed near to each other.
        orientation_sign: -1 for maps that mirror, 1 otherwise.
        rounds: how often both shapes are deformed. The maps are converted again between
            two rounds, and before the first if `start` is not maps. 0 leaves such
            shapes as they are.
        converter: any `jfsf.convert.Converter`.
        search: how neighbours are searched, handed to the converter.
        settings: parameters of the deformation.

    Returns:
        Aligned embeddings (emb_x, emb_y) in units of sqrt(area). A row of emb_x holds
        the position of a vertex of X deformed onto Y, its position at rest, and the
        two normals; a row of emb_y those of a vertex of Y at rest and deformed onto X.

    Raises:
        ValueError: rounds is below 1, or 0 for shapes, or a shape has no faces.
    """
    least = 0 if isinstance(start, Bent) else 1
    if rounds < least:
        raise ValueError(f"arap: rounds is {rounds}, it must be {least} or more")
    if len(spec_x.faces) == 0 or len(spec_y.faces) == 0:
        raise ValueError(
            f"arap: X has {len(spec_x.faces)} faces and Y {len(spec_y.faces)}; a point "
            "cloud cannot be deformed"
        )
    marginal_x, marginal_y = uniform(spec_x.mass), uniform(spec_y.mass)

    weight = settings.normal_weight

    def at_rest(spec):
        rest = surface(spec.vertices, spec.faces, spec.mass, orientation_sign)
        return rest, weight * normals(spec.vertices, spec.faces)

    (surface_x, normal_x), (surface_y, normal_y) = map_sides(
        at_rest, (spec_x,), (spec_y,)
    )

    def with_normals(moved, faces):
        return moved, orientation_sign * weight * normals(moved, faces)

    def one_way(surface, spec, target, start):
        moved = deform(surface, target, start, spec, settings=settings)
        return with_normals(moved, surface.faces)

    def embed(moved_x, moved_normal_x, moved_y, moved_normal_y):
        emb_x = jnp.concatenate([moved_x, spec_x.vertices, moved_normal_x, normal_x], 1)
        emb_y = jnp.concatenate([spec_y.vertices, moved_y, normal_y, moved_normal_y], 1)
        return emb_x, emb_y

    def convert(embs):
        emb_x, emb_y = embs
        return maps_of(converter(emb_x, emb_y, marginal_x, marginal_y, search))

    if isinstance(start, Bent):
        x = with_normals(start.moved_x, spec_x.faces)
        y = with_normals(start.moved_y, spec_y.faces)
        embs = embed(*x, *y)
        if rounds == 0:  # a loop of no rounds would be compiled all the same
            return embs
        maps_at = lambda _, embs: convert(embs)
    else:
        given = maps_of(start)
        # Before the first deformation vertices lie at their images, without normals.
        at_x, at_y = spec_y.vertices[given.T_xy], spec_x.vertices[given.T_yx]
        embs = embed(at_x, 0 * at_x, at_y, 0 * at_y)
        # One body for all rounds, the first included, is one program.
        maps_at = lambda turn, embs: jax.lax.cond(
            turn == 0, lambda embs: varying_as(given, embs, search), convert, embs
        )

    def deform_both(turn, embs):
        T_xy, T_yx = maps_at(turn, embs)
        moved = map_sides(
            one_way,
            (surface_x, spec_x, spec_y.vertices[T_xy], embs[0][:, :3]),
            (surface_y, spec_y, spec_x.vertices[T_yx], embs[1][:, 3:6]),
        )
        return embed(*moved[0], *moved[1])

    read = spec_x, spec_y, start, orientation_sign, search
    return jax.lax.fori_loop(0, rounds, deform_both, varying_as(embs, read))


@jit(static_argnames="settings")
def deform(
    surface: Surface,
    target: Float[Array, "n 3"],
    start: Float[Array, "n 3"],
    spec: Spectrum | None = None,
    *,
    settings: ArapSettings = ArapSettings(),
) -> Float[Array, "n 3"]:
    """Positions of vertices that are drawn to their targets, as rigid as possible.

    A few steps down the energy of Sorkine and Alexa (SGP 2007), with a term that draws
    to the targets t, over positions p and a rotation R_i of each vertex:

        E(p, R) = 1/2 sum_i sum_j w_ij |p_i - p_j - R_i (q_i - q_j)|^2
                  + sum_i a_i |p_i - t_i|^2 / reach^2,

    j the neighbours of i, q the positions at rest, a the mass, w_ij half the sum of the
    cotangents opposite to the edge, each clipped to `STIFFNESS_RANGE`. Each update
    takes the best rotations for p, then solves for the best p for these.

    Args:
        surface: the shape at rest.
        target: the position that each vertex is drawn to.
        start: positions to begin with.
        spec: the spectrum of the same shape, with the masses of `surface`. Each solve
            then begins with what its eigenfunctions can express of the solution:
            conjugate gradients take long for what is smooth.
        settings: see `ArapSettings`.

    Returns:
        Positions, 0 on padding.
    """
    faces, mass, rest, stiff = surface
    n = len(mass)
    real = (mass > 0)[:, None]
    target, start = jnp.where(real, target, 0), jnp.where(real, start, 0)
    start = varying_as(start, surface, target, spec)
    pull = jnp.where(real, mass[:, None] / settings.reach**2, 1)

    # Each edge, at the corner opposite to it, counts at both of its ends.
    def at_both_ends(values):
        both = next_corners(values, 1) + next_corners(values, 2)
        return sum_at_vertices(both, faces, n)

    diagonal = at_both_ends(stiff) + pull

    def resist(x):
        return divergence(stiff * opposite_edges(x, faces), faces, n) + pull * x

    def smooth_step(spec, x, right):
        residual = right - resist(x)
        stiffness = spec.evals[:, None] + settings.reach**-2
        step = matmul(spec.evecs, matmul(spec.evecs.T, residual) / stiffness)
        # An exact line search: where clipped cotangents are stiffer than the Laplacian
        # of the eigenfunctions, the whole step would be too long. Sums, since
        # accelerators round the factors of a product.
        uphill = jnp.sum(step * resist(step))
        length = jnp.sum(step * residual) / jnp.where(uphill > 0, uphill, 1)
        return x + length * step

    def update(x, _):
        force = stiff * opposite_edges(x, faces)
        outer = rest[..., :, None] * force[..., None, :]
        covariance = at_both_ends(outer.reshape(len(faces), 3, 9))
        rotation = rotations(covariance.reshape(n, 3, 3))[faces]
        mean = (next_corners(rotation, 1) + next_corners(rotation, 2)) / 2
        rotated = jnp.sum(mean * rest[:, :, None], 3)
        right = divergence(stiff * rotated, faces, n) + pull * target
        if spec is not None:
            x = smooth_step(spec, x, right)
        precondition = lambda residual: residual / diagonal
        options = {
            "tol": settings.tolerance,
            "maxiter": settings.max_steps,
            "M": precondition,
        }
        return cg(resist, right, x, **options)[0], None

    return jax.lax.scan(update, start, None, length=settings.rotation_updates)[0]


def rotations(covariance: Float[Array, "n 3 3"]) -> Float[Array, "n 3 3"]:
    """The rotation R of each that makes sum_ab covariance_ab R_ba largest.

    Its quaternion is the leading eigenvector of a 4 x 4 matrix (Horn, JOSA A 1987),
    found by repeated squaring for all vertices at once. One SVD a vertex takes ten
    times as long. If two rotations are equally good, the result is neither of them.
    """
    m = jnp.moveaxis(covariance, 0, 2)  # the last axis is the long one
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
    power = horn + size[None, None] * eye  # now none of its eigenvalues is negative

    def square(_, power):
        trace = jnp.trace(power)
        power = power / jnp.where(trace > 0, trace, 1)[None, None]
        return jnp.sum(power[:, :, None] * power[None], 1)

    # A loop compiles faster than so many copies of it.
    power = jax.lax.fori_loop(0, SQUARINGS, square, power)
    best = jnp.argmax(jnp.diagonal(power), 1)
    column = jnp.take_along_axis(power, best[None, None], 1)[:, 0]
    size = jnp.sum(column**2, 0)
    w, x, y, z = column / jnp.sqrt(jnp.where(size > 0, size, 1))[None]
    rotation = _matrix(
        [1 - 2 * (y**2 + z**2), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x**2 + z**2), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x**2 + y**2)],
    )
    return jnp.moveaxis(rotation, 2, 0)


def _matrix(*rows):
    return jnp.stack([jnp.stack(row) for row in rows])

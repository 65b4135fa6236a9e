"""How likely a vertex is mapped right, from evidence that needs no ground truth.

A map that is right on the whole is wrong in places: at a hand that was closed, where a
limb is glued to the body, at fingers that are exchanged. There the bent shapes stay
apart, or are turned, or stretched.

    p_i = 1 / (1 + exp(-z_i)),  z_i = b_0 + sum_f b_f e_if + b_likely log(c / (1 - c))

e are the numbers of `vertex_evidence`, c is the confidence of the whole map. The
factors b, a logistic regression of "the error of the vertex is below 0.05", stand in
vertex_constants.json beside this file, with the data that they were fitted to and the
scores on data that they were not (experiments/fit/calibrate_vertices.py).
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf.array import matmul
from jfsf.array._jit import jit
from jfsf.array._loops import map_sides
from jfsf.array._precision import safe_divide
from jfsf.geometry import normals
from jfsf.geometry._surface import log_stretches, root
from jfsf.matching._confidence import read_constants
from jfsf.types import Aligned, Filtered, Maps, Spectrum

# The pieces of evidence. The offset is added before the logarithm is taken: what is
# smaller says nothing.
OFFSETS = {"strain": 0.03, "misfit": 0.02}
VERTEX_EVIDENCE = tuple(OFFSETS)
# Heat that flows for this time, in units of the area, spreads evidence over some 0.08
# of sqrt(area), with as many eigenfunctions.
TIME, EIGENPAIRS = 0.003, 60
# In sqrt(area): bent vertices this far from their image count as much as normals at a
# right angle.
APART = 0.5
WITHIN = 0.05  # of sqrt(area): a vertex whose error is less is right
SURE = 0.99  # the confidence of a whole map counts up to here, and down to 1 - SURE


# The factors b by name: constant, those of `VERTEX_EVIDENCE`, and likely.
VERTEX_FACTORS: dict[str, float] = read_constants("vertex_constants")["factors"]


@jit
def vertex_confidence(
    maps: Filtered | Maps,
    aligned: Aligned,
    pair: tuple[Spectrum, Spectrum],
    likely: Float[Array, ""] | float,
) -> tuple[Float[Array, " n_x"], Float[Array, " n_y"]]:
    """Probability that the image of a vertex is within 0.05 of its true partner.

    The distance is geodesic, in sqrt(area).

    Args:
        maps: between the vertices.
        aligned: the shapes bent onto each other.
        pair: both at rest.
        likely: the confidence of the whole map, as `jfsf.matching.confidence`.

    Returns:
        For the vertices of X and of Y, in [0, 1]; 0 on padding. nan where the shapes
        were not bent or one of them has no faces, and where `likely` is nan.
    """
    share = jnp.clip(jnp.asarray(likely), 1 - SURE, SURE)
    constant = VERTEX_FACTORS["constant"] + VERTEX_FACTORS["likely"] * jnp.log(
        share / (1 - share)
    )
    weights = [VERTEX_FACTORS[name] for name in VERTEX_EVIDENCE]

    def side(evidence, mass):
        dtype = evidence.dtype
        logit = matmul(evidence, jnp.asarray(weights, dtype)) + constant.astype(dtype)
        return jnp.where(mass > 0, jax.nn.sigmoid(logit), 0)

    both = vertex_evidence(maps, aligned, pair)
    x, y = (side(one, spec.mass) for one, spec in zip(both, pair, strict=True))
    return x, y


def changed_vertex_confidence(
    confidence: Float[Array, " n"],
    before: Float[Array, ""] | float,
    now: Float[Array, ""] | float,
) -> Float[Array, " n"]:
    """The confidence of vertices where that of the whole map has changed.

    Args:
        confidence: of the vertices, by `vertex_confidence`.
        before, now: the confidence of the whole map, that was used then and its new
            value.
    """
    old, new = (jnp.clip(jnp.asarray(c), 1 - SURE, SURE) for c in (before, now))
    change = VERTEX_FACTORS["likely"] * (
        jnp.log(new / (1 - new)) - jnp.log(old / (1 - old))
    )
    odds = jnp.exp(change.astype(confidence.dtype))
    return confidence * odds / (1 - confidence + confidence * odds)


@jit
def vertex_evidence(
    maps: Filtered | Maps, aligned: Aligned, pair: tuple[Spectrum, Spectrum]
) -> tuple[Float[Array, "n_x f"], Float[Array, "n_y f"]]:
    """What is known of each vertex, a column for each of `VERTEX_EVIDENCE`.

    For a vertex i of X with the image j (and for a vertex of Y with its image in X):

    - strain: of the bending of X at i and of Y at j, the mean of both. That of a vertex
      is the root mean square, over the faces around it, of the length of the vector of
      the logarithms of the two stretches
    - misfit: 1 - n . m + |p - y| / `APART`, n and p the normal and the place of i when
      X is bent onto Y, m and y those of j at rest; n . -m where the map mirrors

    Each is smoothed by the heat kernel of the shape; the column is the logarithm of it
    plus its offset (`OFFSETS`). The plan's entropy, the way there and back, the
    distance along the normal alone and the roughness of the map were tried beside
    these, and add nothing on sets that the factors were not fitted to.

    Args:
        maps, aligned, pair: as `vertex_confidence`.

    Returns:
        nan where the shapes were not bent or one of them has no faces.
    """
    moved = aligned.moved_x, aligned.moved_y
    no_faces = any(len(spec.faces) == 0 for spec in pair)
    if moved[0] is None or moved[1] is None or no_faces:
        unknown = lambda spec: jnp.full(
            (len(spec.mass), len(VERTEX_EVIDENCE)), jnp.nan, spec.evecs.dtype
        )
        return unknown(pair[0]), unknown(pair[1])
    spec_x, spec_y = pair
    sides = ((spec_x, moved[0]), (spec_y, moved[1]))
    strain_x, strain_y = map_sides(_strain, *sides)
    x, y = map_sides(
        _evidence,
        (spec_x, spec_y, moved[0], maps.T_xy, strain_x, strain_y),
        (spec_y, spec_x, moved[1], maps.T_yx, strain_y, strain_x),
    )
    surfaces = jnp.any(spec_x.faces) & jnp.any(spec_y.faces)
    known = lambda values: jnp.asarray(jnp.where(surfaces, values, jnp.nan))
    return known(x), known(y)


def _evidence(spec, other, moved, T, strain, other_strain):
    outward = normals(other.vertices, other.faces)[T]
    apart = root(jnp.sum((moved - other.vertices[T]) ** 2, 1))
    alike = jnp.sum(normals(moved, spec.faces) * outward, 1)
    mirrors = matmul(spec.mass, jnp.where(spec.mass > 0, alike, 0)) < 0
    misfit = 1 - jnp.where(mirrors, -alike, alike) + apart / APART
    columns = jnp.stack([(strain + other_strain[T]) / 2, misfit], 1)
    offset = jnp.asarray(list(OFFSETS.values()), columns.dtype)
    return jnp.log(jnp.maximum(_smoothed(columns, spec), 0) + offset[None])


def _smoothed(columns, spec: Spectrum):
    evals, evecs = spec.evals[:EIGENPAIRS], spec.evecs[:, :EIGENPAIRS]
    # What is on padding may be anything.
    real = jnp.asarray(jnp.where((spec.mass > 0)[:, None], columns, 0))
    heat = jnp.exp(-TIME * evals)[:, None]
    return matmul(evecs, heat * matmul(evecs.T, spec.mass[:, None] * real))


def _strain(spec: Spectrum, moved):
    """At vertices, from the stretches of the faces around them."""
    area, smaller, larger = log_stretches(spec.vertices, moved, spec.faces)
    both = jnp.stack([area * (smaller**2 + larger**2), area], 1)
    n = len(spec.mass)
    total = jnp.zeros((n, 2), both.dtype).at[spec.faces].add(both[:, None])
    return root(safe_divide(total[:, 0], total[:, 1]))

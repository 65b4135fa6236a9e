"""How far off the image of a vertex may be, from evidence that needs no ground truth.

A map that is right on the whole is wrong in places: at a hand that was closed, where a
limb is glued to the body, where a smooth surface gives nothing to hold on to. There the
map and the shapes disagree.

    r_i = exp(b_0 + sum_f b_f e_if)

holds the truth with 90 % probability. e are the numbers of `vertex_evidence`. The
factors b, none of them negative, were fitted to the logarithms of errors; then b_0 was
chosen such that 0.9 of the scores, error divided by r, are at most 1: split conformal
calibration (Papadopoulos et al. 2002; of geodesic errors on manifolds arXiv
2602.16015). An error is below d = 0.05 with the probability

    p_i = 1 / (1 + exp(-z_i)),  z_i = a_0 + a_margin log(d / r_i) + a_likely logit(c),

c being the confidence of the whole map: a logistic regression, of maps that are wrong
too. All stand in vertex_constants.json beside this file, with the scores on data that
they were not fitted to (experiments/fit/calibrate_vertices.py).
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf.array import matmul
from jfsf.array._jit import jit
from jfsf.array._loops import map_sides
from jfsf.array._precision import safe_divide
from jfsf.geometry._surface import log_stretches, opposite_edges, root
from jfsf.matching._confidence import read_constants
from jfsf.types import Aligned, Filtered, Maps, Spectrum

# The pieces of evidence. The offset is added before the logarithm is taken: what is
# smaller says nothing.
OFFSETS = {"shift": 0.003, "strain": 0.02, "apart": 0.001}
VERTEX_EVIDENCE = tuple(OFFSETS)
# Heat that flows for this time, in units of the area, spreads evidence over some 0.08
# of sqrt(area), with as many eigenfunctions.
TIME, EIGENPAIRS = 0.002, 100
# Of the heat kernel signatures that are compared, in units of the area.
SIGNATURE_TIME = 0.0055
# Of the squared slope of their logarithms: where they are flatter they say nothing.
LEAST_SLOPE = 0.01
LEAST_HEAT = 1e-9
WITHIN = 0.05  # of sqrt(area): a vertex whose error is less is right
COVERED = 0.9  # of the errors are below the radius
SURE = 0.99  # the confidence of a whole map counts up to here, and down to 1 - SURE

_CONSTANTS = read_constants("vertex_constants")
# The factors b by name: constant, and those of `VERTEX_EVIDENCE`.
VERTEX_FACTORS: dict[str, float] = _CONSTANTS["factors"]
# The factors a by name: constant, margin and likely.
CONFIDENCE_FACTORS: dict[str, float] = _CONSTANTS["confidence"]


@jit
def vertex_radius(
    maps: Filtered | Maps, aligned: Aligned, pair: tuple[Spectrum, Spectrum]
) -> tuple[Float[Array, " n_x"], Float[Array, " n_y"]]:
    """A length for each vertex: with 90 % probability its image is less than that off.

    The error is the geodesic distance from the image to the true partner. The
    probability is that of maps that are right on the whole (mean error below 0.1 of
    sqrt(area)); the confidence of the map says how likely it is one.

    Args:
        maps: between the vertices.
        aligned: the shapes bent onto each other.
        pair: both at rest.

    Returns:
        For the vertices of X in sqrt(area) of Y, for those of Y in sqrt(area) of X; inf
        on padding. nan where the shapes were not bent or one of them has no faces.
    """

    def side(evidence, mass):
        dtype = evidence.dtype
        weights = jnp.asarray([VERTEX_FACTORS[name] for name in VERTEX_EVIDENCE], dtype)
        log_radius = matmul(evidence, weights) + VERTEX_FACTORS["constant"]
        return jnp.where(mass > 0, jnp.exp(log_radius), jnp.inf)

    both = vertex_evidence(maps, aligned, pair)
    x, y = (side(one, spec.mass) for one, spec in zip(both, pair, strict=True))
    return x, y


def vertex_confidence(
    radius: Float[Array, "..."], likely: Float[Array, ""] | float
) -> Float[Array, "..."]:
    """Probability that the image of a vertex is within 0.05 of its true partner.

    The distance is geodesic, in sqrt(area).

    Args:
        radius: of each vertex, as `vertex_radius`.
        likely: the confidence of the whole map, as `jfsf.matching.confidence`.

    Returns:
        In [0, 1]; 0 where the radius is inf; nan where it or `likely` is nan.
    """
    share = jnp.clip(jnp.asarray(likely), 1 - SURE, SURE)
    of_map = CONFIDENCE_FACTORS["constant"]
    of_map = of_map + CONFIDENCE_FACTORS["likely"] * jnp.log(share / (1 - share))
    margin = CONFIDENCE_FACTORS["margin"] * jnp.log(WITHIN / radius)
    return jax.nn.sigmoid(margin + of_map.astype(radius.dtype))


@jit
def vertex_evidence(
    maps: Filtered | Maps, aligned: Aligned, pair: tuple[Spectrum, Spectrum]
) -> tuple[Float[Array, "n_x f"], Float[Array, "n_y f"]]:
    """What is known of each vertex, a column for each of `VERTEX_EVIDENCE`.

    For a vertex i of X with the image j (and for a vertex of Y with its image in X),
    lengths in sqrt(area):

    - shift: how far along the surface j would have to move to look like i. h being the
      logarithm of the heat kernel signature at `SIGNATURE_TIME`, the root of the mean
      square of h_x(i) - h_y(j) over that of the slopes of h
    - strain: of the bending of X at i and of Y at j, the mean of both. That of a vertex
      is the root mean square, over the faces around it, of the length of the vector of
      the logarithms of the two stretches
    - apart: the distance of i, when X is bent onto Y, from j at rest

    What is a mean is one over the surface, by the heat kernel of the shape; the column
    is the logarithm of it plus its offset (`OFFSETS`). Turned normals, the way there
    and back, the two bendings compared, the spacing of the vertices, how featureless
    the surface is and the confidence of the map were tried beside these, and add
    nothing on sets that the factors were not fitted to.

    Args:
        maps, aligned, pair: as `vertex_radius`.

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
    own_x, own_y = map_sides(_of_shape, (spec_x, moved[0]), (spec_y, moved[1]))
    x, y = map_sides(
        _evidence,
        (spec_x, spec_y, moved[0], maps.T_xy, own_x, own_y),
        (spec_y, spec_x, moved[1], maps.T_yx, own_y, own_x),
    )
    surfaces = jnp.any(spec_x.faces) & jnp.any(spec_y.faces)
    known = lambda values: jnp.asarray(jnp.where(surfaces, values, jnp.nan))
    return known(x), known(y)


def _evidence(spec, other, moved, T, own, others):
    signature, slope, strain = own
    other_signature, other_slope, other_strain = (values[T] for values in others)
    columns = [
        (signature - other_signature) ** 2,
        (slope + other_slope) / 2,
        (strain + other_strain) / 2,
        root(jnp.sum((moved - other.vertices[T]) ** 2, 1)),
    ]
    smooth = jnp.maximum(_smoothed(jnp.stack(columns, 1), spec), 0)
    differ, slope, strain, apart = smooth.T
    shift = root(differ / (slope + LEAST_SLOPE))
    evidence = jnp.stack([shift, strain, apart], 1)
    offset = jnp.asarray(list(OFFSETS.values()), evidence.dtype)
    return jnp.log(evidence + offset[None])


def _smoothed(columns, spec: Spectrum):
    evals, evecs = spec.evals[:EIGENPAIRS], spec.evecs[:, :EIGENPAIRS]
    # What is on padding may be anything.
    real = jnp.asarray(jnp.where((spec.mass > 0)[:, None], columns, 0))
    heat = jnp.exp(-TIME * evals)[:, None]
    return matmul(evecs, heat * matmul(evecs.T, spec.mass[:, None] * real))


def _of_shape(spec: Spectrum, moved):
    """At vertices: logarithm of the signature, its squared slope, and the strain."""
    evals, evecs = spec.evals[:EIGENPAIRS], spec.evecs[:, :EIGENPAIRS]
    heat = matmul(evecs**2, jnp.exp(-SIGNATURE_TIME * evals))
    signature = jnp.log(heat + LEAST_HEAT)
    # Twice the mean square of the slopes along edges: it needs no area of a face.
    edges = opposite_edges(spec.vertices, spec.faces)
    steps = opposite_edges(signature[:, None], spec.faces)
    area, smaller, larger = log_stretches(spec.vertices, moved, spec.faces)
    columns = [2 * jnp.sum(steps**2, (1, 2)), jnp.sum(edges**2, (1, 2))]
    columns += [area * (smaller**2 + larger**2), area]
    total = jnp.zeros((len(spec.mass), 4), signature.dtype)
    total = total.at[spec.faces].add(jnp.stack(columns, 1)[:, None])
    slope = safe_divide(total[:, 0], total[:, 1])
    return signature, slope, root(safe_divide(total[:, 2], total[:, 3]))

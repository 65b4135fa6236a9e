"""Candidates for shapes of different proportions, and how unevenly a map stretches.

Where limbs differ in length, a wrong map may be closer to an isometry than the right
one, so `candidates` may not hold the right map. These candidates come from extremities
(`_extremities`) instead, and are ranked by `log_stretch_std`, and by how much assigned
extremities differ, instead of the energy. No measure of a coarse map tells right from
wrong here: refine several and compare.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jfsf.array import matmul
from jfsf.array._jit import jit
from jfsf.array._loops import map_sides
from jfsf.initial._extremities import Assignments, best_assignments
from jfsf.initial._hypotheses import (
    CACHED_ENTRIES,
    SamplePair,
    best_different,
    dense_nearest,
    energies,
    refine_hypotheses,
)
from jfsf.initial._samples import SearchSamples
from jfsf.initial._search import (
    Candidates,
    sample_pair,
    with_orientation,
)
from jfsf.initial._settings import ASSIGNMENT_KS, SearchSettings
from jfsf.refine import zoomout
from jfsf.spectral import Features, embeddings

# Weight of the columns beside the eigenfunctions: where proportions differ so do
# descriptors, and more than this spoils right maps.
DESCRIPTOR_WEIGHT = 0.1
# Weight of the distances to assigned extremities, which are further columns.
EXTREMITY_WEIGHT = 2.0
# Weight of what assigned extremities differ in, beside `log_stretch_std` of a map.
DIFFERENCE_WEIGHT = 0.4
# Neighbours of a sample between which stretch is read: as many as a vertex has.
NEAR = 6
# Added to a stretch: samples that become one point are stretched by this, not by 0.
COLLAPSED = 0.3


@jit(static_argnames="settings")
def nonisometric_candidates(
    x: SearchSamples,
    y: SearchSamples,
    sign: Int[Array, ""] | int = 1,
    self_map: Bool[Array, ""] | bool = False,
    *,
    settings: SearchSettings = SearchSettings(),
) -> Candidates:
    """Maps that send extremities to extremities, for shapes of different proportions.

    Those that stretch the shape evenly and send similar extremities to each other come
    first.

    Args:
        x, y, sign, self_map: as `candidates`.
        settings: `nonisometric_candidates` says how many maps.
    """
    search_pair, ranking_pair = (
        sample_pair(*sides, sign, self_map)
        for sides in (
            (x.search_points, y.search_points),
            (x.ranking_points, y.ranking_points),
        )
    )
    oriented = partial(
        with_orientation,
        brackets=(x.search_points.brackets, y.search_points.brackets),
        sign=sign,
    )
    assigned = best_assignments(x, y, num=settings.assignments)
    C_yx = refine_extremities(search_pair, assigned)
    cost = log_stretch_std(search_pair, x.geodesics, y.geodesics, C_yx)
    cost += DIFFERENCE_WEIGHT * assigned.difference
    _, score = oriented(cost, C_yx)
    cost = jnp.where(sign * score < 0, jnp.inf, cost)
    kept, _ = best_different(C_yx, cost, settings.nonisometric_candidates)
    last = refine_hypotheses(
        ranking_pair, C_yx[kept], DESCRIPTOR_WEIGHT, ks=settings.final_ks
    )
    energy, score = oriented(energies(ranking_pair, last), last)
    return Candidates(last, energy, score, jnp.full((), jnp.nan, energy.dtype))


def refine_extremities(
    pair: SamplePair, assigned: Assignments
) -> Float[Array, "c k k"]:
    """Maps that bring assigned extremities together, refined by ZoomOut.

    The distances to the extremities are columns beside the eigenfunctions.

    Args:
        pair: the samples.
        assigned: `best_assignments`.
    """
    x, y, _ = pair
    ks = ASSIGNMENT_KS

    def start(x: Features, y: Features, T_xy):
        evecs = x.spec.evecs[:, : ks[0]]
        back = evecs.T * x.spec.mass[None]
        gram = matmul(back, evecs)
        return jnp.linalg.solve(gram, matmul(back, y.spec.evecs[:, : ks[0]][T_xy]))

    def columns(side: Features, distances):
        known = side.columns * DESCRIPTOR_WEIGHT
        far = distances.astype(known.dtype) * EXTREMITY_WEIGHT
        return jnp.concatenate([known, far], 1)

    fields = x.bracket_fields, y.bracket_fields

    def refine(sides):
        maps = dense_nearest(*sides)
        C_yx = (start(x, y, maps.T_xy) + start(y, x, maps.T_yx).T) / 2
        return zoomout(
            x.spec,
            y.spec,
            C_yx,
            columns(x, sides[0]),
            columns(y, sides[1]),
            *fields,
            ks=ks,
            converter=dense_nearest,
            weighted=True,
            bidirectional=True,
        )

    count = len(assigned.from_x)
    most = max(CACHED_ENTRIES // (len(x.spec.mass) * len(y.spec.mass)), 1)
    batch_size = max(n for n in range(1, most + 1) if count % n == 0)
    coordinates = assigned.from_x, assigned.from_y
    return jax.lax.map(refine, coordinates, batch_size=batch_size)


def log_stretch_std(
    pair: SamplePair,
    geodesics_x: Float[Array, "s_x s_x"],
    geodesics_y: Float[Array, "s_y s_y"],
    C_yx: Float[Array, "c k k"],
) -> Float[Array, " c"]:
    """How unevenly each map stretches short distances; 0 for similarities.

    It is the standard deviation of the logarithm of the stretch between neighbouring
    samples, the lesser of the two ways:

        u = min(std s_xy, std s_yx),
        s_xy(i, j) = log(d_Y(T_xy[i], T_xy[j]) / d_X(i, j) + `COLLAPSED`),

    over all pairs of a sample i and one of its `NEAR` nearest j, all counted equally.
    T_xy are the nearest neighbours of Phi_X in Phi_Y C^T. A map that stretches a limb
    as a whole costs little, one that tears neighbours apart or crumples much, whatever
    the proportions.

    Args:
        pair: the samples. Those of mass 0 are padding, copies of others: pairs with
            them, or of distance 0, do not count.
        geodesics_x, geodesics_y: d_X and d_Y between the samples.
        C_yx: functions on Y pulled back to X.
    """
    x, y, _ = pair
    near_x, near_y = map_sides(_near, (geodesics_x,), (geodesics_y,))

    def one(C):
        embs = embeddings(C, x.spec.evecs, y.spec.evecs, space="direct")
        maps = dense_nearest(*embs)
        both = map_sides(
            _uneven,
            (geodesics_x, geodesics_y, near_x, maps.T_xy, x.spec.mass),
            (geodesics_y, geodesics_x, near_y, maps.T_yx, y.spec.mass),
        )
        return jnp.minimum(*both)

    return jax.lax.map(one, C_yx)


def _near(geodesics):
    """The nearest samples of each sample, without itself."""
    return jax.lax.top_k(-geodesics, 1 + NEAR)[1][:, 1:]


def _uneven(geodesics_x, geodesics_y, near, T_xy, mass):
    before = jnp.take_along_axis(geodesics_x, near, 1)
    after = geodesics_y[T_xy[:, None], T_xy[near]]
    # Samples without mass are copies of others.
    weight = (mass > 0)[:, None] & (mass[near] > 0) & (before > 0)
    weight = weight.astype(mass.dtype)
    weight /= jnp.maximum(weight.sum(), 1)
    log = jnp.log(after / jnp.where(before > 0, before, 1) + COLLAPSED)
    mean = jnp.sum(weight * log)
    return jnp.sqrt(jnp.sum(weight * (log - mean) ** 2))

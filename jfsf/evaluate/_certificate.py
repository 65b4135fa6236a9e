"""Evidence of how good a map is, from the map and the spectra alone."""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jfsf.array import matmul
from jfsf.convert import maps_of
from jfsf.evaluate._bending import bending_residual
from jfsf.evaluate._confidence import confidence
from jfsf.evaluate._functional_metrics import orthogonality
from jfsf.evaluate._landmarks import MISSED, landmark_distances, rms_distance
from jfsf.evaluate._map_metrics import coverage
from jfsf.initial import (
    SamplePair,
    SearchSamples,
    SearchSettings,
    energies,
    log_stretch_std,
)
from jfsf.spectral import (
    DISTANCE_PAIRS,
    FUNCTIONS,
    biharmonic,
    brackets,
    orientation_score,
)
from jfsf.types import Certificate, Filtered, Maps, Spectrum

# A map that misses all landmarks counts as so many doubtful ones more: that is little
# against a map that is nearly certain, since a landmark may be wrong too.
MISSED_WEIGHT = 3.0
# Functions of a map whose energy and stretch are read at samples.
READ_FUNCTIONS = 40


@partial(jax.jit, static_argnames=("bent", "oriented_functions", "distance_pairs"))
def certify(
    maps: Filtered | Maps,
    emb_x: Float[Array, "n_x d"],
    emb_y: Float[Array, "n_y d"],
    C_yx: Float[Array, "k_x k_y"],
    spec_x: Spectrum,
    spec_y: Spectrum,
    gap: Float[Array, ""] | float = jnp.nan,
    samples: tuple[SearchSamples, SearchSamples] | None = None,
    sign: Int[Array, ""] | int = 1,
    landmarks: tuple[Int[Array, " l"], Int[Array, " l"]] | None = None,
    *,
    bent: bool = False,
    oriented_functions: int = FUNCTIONS,
    distance_pairs: int = DISTANCE_PAIRS,
) -> Certificate:
    """The evidence for `maps`, which came from (emb_x, emb_y).

    Args:
        maps: both maps, with their plan if there is one.
        emb_x, emb_y: the aligned embeddings that were converted.
        C_yx: the functional map of maps.T_xy.
        spec_x, spec_y: spectra; faces wound outward, or none.
        gap: `jfsf.pipeline.InitialMap.gap`, passed on.
        samples: both shapes at samples, for energy, log_stretch_std and confidence.
        sign: of the wanted orientation, 0 for any; for the confidence.
        landmarks: vertices of X and their partners on Y; for the confidence too.
        bent: the embeddings are those of `jfsf.refine.arap`.
        oriented_functions: eigenfunctions that the orientation score reads.
        distance_pairs: eigenpairs of the biharmonic distance.
    """
    T_xy, T_yx = maps.T_xy, maps.T_yx
    dtype = C_yx.dtype
    numbers = [C_yx, emb_x, emb_y]
    error = agree = jnp.full((), jnp.nan, dtype)
    empty = jnp.zeros((), jnp.int32)
    if isinstance(maps, Filtered):
        real_x = spec_x.mass > 0
        # The first neighbour of a row is the nearest.
        nearest = maps.kernel.idx_xy[:, 0]
        agree = jnp.sum(real_x & (nearest == T_xy)) / jnp.sum(real_x)
        error, empty = maps.marginal_error, maps.empty_x + maps.empty_y
        numbers += [maps.f, maps.g]
    finite = jnp.stack([jnp.all(jnp.isfinite(x)) for x in numbers]).all()
    k = min(oriented_functions, *C_yx.shape)
    score = orientation_score(C_yx, brackets(spec_x, k=k), brackets(spec_y, k=k))
    score = jnp.asarray(score)
    energy, uneven = _at_samples(C_yx, samples)
    residual = jnp.full((), jnp.nan, dtype)
    if bent:
        pair = spec_x, spec_y
        residual = bending_residual(maps_of(maps), emb_x, emb_y, *pair).astype(dtype)
    agrees = jnp.where(sign == 0, jnp.abs(score), sign * score)
    likely = confidence(agrees, energy, uneven, residual)
    missed = jnp.zeros(0, dtype)
    if landmarks is not None:
        at_x, at_y = landmarks
        missed = landmark_distances(
            T_xy[at_x], at_y, spec_y, distance_pairs=distance_pairs
        ).astype(dtype)
        share = jnp.mean((missed > MISSED).astype(dtype))
        likely **= 1 + MISSED_WEIGHT * share
    return Certificate(
        marginal_error=error,
        empty=empty,
        coverage_xy=_reached(T_xy, spec_x.mass, spec_y.mass),
        coverage_yx=_reached(T_yx, spec_y.mass, spec_x.mass),
        bijectivity_x=_there_and_back(T_yx[T_xy], spec_x, distance_pairs),
        bijectivity_y=_there_and_back(T_xy[T_yx], spec_y, distance_pairs),
        orthogonality=orthogonality(C_yx),
        orientation=score,
        gap=jnp.asarray(gap, dtype),
        nn_agreement=agree.astype(dtype),
        finite=finite,
        energy=energy,
        log_stretch_std=uneven,
        residual=residual,
        confidence=likely,
        landmarks=missed,
    )


def _at_samples(C_yx, samples: tuple[SearchSamples, SearchSamples] | None):
    """Energy and unevenness of the leading functions."""
    if samples is None:
        return (jnp.full((), jnp.nan, C_yx.dtype),) * 2
    x, y = samples
    search_pair, ranking_pair = (
        SamplePair(x.search_points, y.search_points, False),
        SamplePair(x.ranking_points, y.ranking_points, False),
    )
    lead = C_yx[None, :READ_FUNCTIONS, :READ_FUNCTIONS]
    energy = energies(ranking_pair, lead, settings=SearchSettings())
    uneven = log_stretch_std(search_pair, x.geodesics, y.geodesics, lead)
    return energy[0].astype(C_yx.dtype), uneven[0].astype(C_yx.dtype)


def _reached(T_xy, mass_x, mass_y):
    """Coverage, over the share of Y's vertices that as few as X has can hit."""
    n_x, n_y = (jnp.sum(mass > 0) for mass in (mass_x, mass_y))
    share = jnp.minimum(n_x / n_y, 1).astype(mass_y.dtype)
    return jnp.minimum(coverage(T_xy, mass_y, mass_x=mass_x) / share, 1)


def _there_and_back(returned, spec: Spectrum, pairs: int):
    """Mean distance of a vertex from its image there and back; 1 for random images."""
    points = biharmonic(spec, pairs)
    moved = jnp.sqrt(jnp.sum((points - points[returned]) ** 2, 1))
    return matmul(spec.mass, moved) / rms_distance(points, spec.mass)

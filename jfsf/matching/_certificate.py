"""Evidence of how good a map is, from the map and the spectra alone."""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jfsf.array import matmul
from jfsf.array._jit import jit
from jfsf.convert import maps_of
from jfsf.evaluate import coverage, orthogonality
from jfsf.initial._hypotheses import SamplePair, energies
from jfsf.initial._proportions import log_stretch_std
from jfsf.initial._samples import SearchSamples
from jfsf.matching._bending import Bending, bending
from jfsf.matching._confidence import LEAST, log_odds, of_certificate
from jfsf.matching._kept_landmarks import Landmarks, landmark_distances
from jfsf.matching._settings import Settings
from jfsf.spectral._orientation import brackets, orientation_score
from jfsf.spectral._sampling import biharmonic, rms_distance
from jfsf.types import Aligned, Certificate, Filtered, Maps, Spectrum

# Eigenvalues that are compared: later ones differ less, whatever the shapes.
PITCHES = 10


@jit(static_argnames="settings")
def certify(
    maps: Filtered | Maps,
    aligned: Aligned,
    C_yx: Float[Array, "k_x k_y"],
    pair: tuple[Spectrum, Spectrum],
    samples: tuple[SearchSamples, SearchSamples] | None = None,
    sign: Int[Array, ""] | int = 1,
    landmarks: Landmarks | None = None,
    *,
    settings: Settings = Settings(),
) -> Certificate:
    """The evidence for `maps`, which came from aligned embeddings.

    Args:
        maps: both maps, with their plan if there is one.
        aligned: the embeddings that were converted, and the deformed shapes.
        C_yx: the functional map of maps.T_xy.
        pair: the spectra of X and Y; faces wound outward, or none.
        samples: both shapes at samples, for energy and log_stretch_std.
        sign: of the wanted orientation, 0 for any; for the confidence.
        landmarks: vertices of X and their partners on Y; for the confidence too.
        settings: `evidence`, `distance_pairs`, `features`.

    Returns:
        The certificate; its gaps are nan, as those of a map without a search.
    """
    (spec_x, spec_y), (T_xy, T_yx), dtype = pair, maps_of(maps), C_yx.dtype
    unknown = jnp.full((), jnp.nan, dtype)
    numbers = [C_yx, aligned.emb_x, aligned.emb_y]
    error = agree = recall = unknown
    empty = jnp.zeros((), jnp.int32)
    if isinstance(maps, Filtered):
        real_x = spec_x.mass > 0
        # The first neighbour of a row is the nearest.
        nearest = maps.kernel.idx_xy[:, 0]
        agree = jnp.sum(real_x & (nearest == T_xy)) / jnp.sum(real_x)
        error, empty = maps.marginal_error, maps.empty_x + maps.empty_y
        recall = maps.recall.astype(dtype)
        numbers += [maps.f, maps.g]
    finite = jnp.stack([jnp.all(jnp.isfinite(x)) for x in numbers]).all()
    k = min(settings.features.oriented_functions, *C_yx.shape)
    score = orientation_score(C_yx, brackets(spec_x, k=k), brackets(spec_y, k=k))
    score = jnp.asarray(score)
    energy, stretch = _at_samples(C_yx, samples, settings)
    bent = Bending(unknown, unknown, unknown, unknown)
    if aligned.moved_x is not None and aligned.moved_y is not None:
        moved = aligned.moved_x, aligned.moved_y
        rounding = settings.evidence.rounding
        bent = bending(maps_of(maps), *moved, *pair, rounding=rounding)
        bent = Bending(*(figure.astype(dtype) for figure in bent))
    pairs = settings.distance_pairs
    missed = jnp.zeros(0, dtype)
    if landmarks is not None:
        at_x, at_y = landmarks
        missed = landmark_distances(T_xy[at_x], at_y, spec_y, distance_pairs=pairs)
        missed = missed.astype(dtype)
    evidence = Certificate(
        marginal_error=error,
        empty=empty,
        coverage_xy=_reached(T_xy, spec_x.mass, spec_y.mass),
        coverage_yx=_reached(T_yx, spec_y.mass, spec_x.mass),
        bijectivity_x=_there_and_back(T_yx[T_xy], spec_x, pairs),
        bijectivity_y=_there_and_back(T_xy[T_yx], spec_y, pairs),
        orthogonality=orthogonality(C_yx),
        orientation=score,
        gap=unknown,
        mirror_gap=unknown,
        nn_agreement=agree.astype(dtype),
        recall=recall,
        finite=finite,
        energy=energy,
        log_stretch_std=stretch,
        **bent._asdict(),
        spectrum_gap=spectrum_gap(spec_x, spec_y).astype(dtype),
        region_cost=unknown,
        log_odds=unknown,
        share=unknown,
        rivals=unknown,
        mirrored=unknown,
        confidence=unknown,
        landmarks=missed,
    )
    agrees = jnp.where(sign == 0, jnp.abs(score), sign * score)
    odds = log_odds(**{**evidence.figures(), "orientation": agrees})
    evidence = evidence._replace(log_odds=odds.astype(dtype))
    told = jnp.asarray(sign) != 0
    likely = of_certificate(evidence, told, settings=settings.evidence)
    return evidence._replace(confidence=likely.astype(dtype))


def spectrum_gap(spec_x: Spectrum, spec_y: Spectrum) -> Float[Array, ""]:
    """How unlike two shapes are, by the pitches of their first eigenfunctions.

        max_i |log(lambda_i of X / lambda_i of Y)|,  i = 1 .. `PITCHES`

    Args:
        spec_x, spec_y: of shapes of unit area.

    Returns:
        0 or more; log 2 for shapes of which one has half the eigenvalue somewhere.
    """
    x, y = (jnp.log(s.evals[1 : 1 + PITCHES] + LEAST) for s in (spec_x, spec_y))
    k = min(len(x), len(y))
    return jnp.max(jnp.abs(x[:k] - y[:k]))


def _at_samples(
    C_yx, samples: tuple[SearchSamples, SearchSamples] | None, settings: Settings
):
    """Energy and `log_stretch_std` of the leading functions."""
    if samples is None:
        return (jnp.full((), jnp.nan, C_yx.dtype),) * 2
    x, y = samples
    search_pair = SamplePair(x.search_points, y.search_points, False)
    ranking_pair = SamplePair(x.ranking_points, y.ranking_points, False)
    size = settings.evidence.functions
    lead = C_yx[None, :size, :size]
    energy = energies(ranking_pair, lead)
    stretch = log_stretch_std(search_pair, x.geodesics, y.geodesics, lead)
    return energy[0].astype(C_yx.dtype), stretch[0].astype(C_yx.dtype)


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

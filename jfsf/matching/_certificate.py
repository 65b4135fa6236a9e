"""Evidence of how good a map is, from the map, the spectra and the bent shapes alone.

What each figure means is in `jfsf._figures`.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jfsf.array import matmul
from jfsf.array._jit import jit
from jfsf.array._loops import map_sides
from jfsf.array._precision import safe_divide
from jfsf.convert import maps_of
from jfsf.evaluate import coverage, orthogonality
from jfsf.geometry import normals
from jfsf.geometry._surface import log_stretches
from jfsf.initial._hypotheses import SamplePair, energies
from jfsf.initial._proportions import log_stretch_std
from jfsf.initial._samples import SearchSamples
from jfsf.matching._confidence import LEAST, confidence_of, log_odds
from jfsf.matching._kept_landmarks import Landmarks, landmark_distances
from jfsf.spectral._orientation import FUNCTIONS, brackets, orientation_score
from jfsf.spectral._sampling import biharmonic, rms_distance
from jfsf.types import Aligned, Certificate, Filtered, Maps, Spectrum

# Eigenvalues that are compared: later ones differ less, whatever the shapes.
EIGENVALUES = 10
# Leading functions of a map whose energy and stretch are read at samples.
READ_FUNCTIONS = 40
# Share of the spacing of vertices that rounding to vertices leaves between deformed
# shapes. Decimated to 300 to 5000 vertices, right maps of people leave 0.09 to 0.14.
ROUNDING = 0.08
# Of the area, the part of the triangles that is sheared most says most: a wrong map
# that is an isometry nearly everywhere tears a belt at a waist, or the root of a limb.
MOST_SHEARED = 0.01


@jit
def certify(
    maps: Filtered | Maps,
    aligned: Aligned,
    C_yx: Float[Array, "k_x k_y"],
    pair: tuple[Spectrum, Spectrum],
    samples: tuple[SearchSamples, SearchSamples] | None = None,
    sign: Int[Array, ""] | int = 1,
    landmarks: Landmarks | None = None,
) -> Certificate:
    """The evidence for `maps`, which came from aligned embeddings.

    Args:
        maps: both maps, with their plan if there is one.
        aligned: the embeddings that were converted, and the deformed shapes.
        C_yx: the functional map of maps.T_xy.
        pair: the spectra of X and Y, with faces wound outward, or without faces.
        samples: both shapes at samples, for `energy` and `log_stretch_std`.
        sign: sign of the wanted orientation, 0 for any; the confidence reads it.
        landmarks: vertices of X and their partners on Y; the confidence reads them.

    Returns:
        The certificate; its gaps are nan, as those of a map without a search.
    """
    (spec_x, spec_y), (T_xy, T_yx), dtype = pair, maps_of(maps), C_yx.dtype
    numbers = [C_yx, aligned.emb_x, aligned.emb_y]
    known: dict[str, Any] = {}
    if isinstance(maps, Filtered):
        real_x = spec_x.mass > 0
        # The first neighbour of a row is the nearest.
        nearest = maps.kernel.idx_xy[:, 0]
        agree = jnp.sum(real_x & (nearest == T_xy)) / jnp.sum(real_x)
        known |= {
            "marginal_error": maps.marginal_error,
            "empty": maps.empty_x + maps.empty_y,
            "nn_agreement": agree.astype(dtype),
            "recall": maps.recall.astype(dtype),
        }
        numbers += [maps.f, maps.g]
    known["finite"] = jnp.stack([jnp.all(jnp.isfinite(x)) for x in numbers]).all()
    k = min(FUNCTIONS, *C_yx.shape)
    score = orientation_score(C_yx, brackets(spec_x, k=k), brackets(spec_y, k=k))
    score = jnp.asarray(score)
    if samples is not None:
        energy, stretch = _at_samples(C_yx, samples)
        known |= {"energy": energy, "log_stretch_std": stretch}
    if aligned.moved_x is not None and aligned.moved_y is not None:
        moved = aligned.moved_x, aligned.moved_y
        bent = bending(maps_of(maps), *moved, *pair)
        known |= {name: v.astype(dtype) for name, v in bent._asdict().items()}
    if landmarks is not None:
        at_x, at_y = landmarks
        away = landmark_distances(T_xy[at_x], at_y, spec_y)
        known["landmarks"] = away.astype(dtype)
    evidence = Certificate.unknown(dtype)._replace(
        coverage_xy=_reached(T_xy, spec_x.mass, spec_y.mass),
        coverage_yx=_reached(T_yx, spec_y.mass, spec_x.mass),
        bijectivity_x=_there_and_back(T_yx[T_xy], spec_x),
        bijectivity_y=_there_and_back(T_xy[T_yx], spec_y),
        orthogonality=orthogonality(C_yx),
        orientation=score,
        spectrum_gap=spectrum_gap(spec_x, spec_y).astype(dtype),
        **known,
    )
    agrees = jnp.where(sign == 0, jnp.abs(score), sign * score)
    odds = log_odds(**{**evidence._asdict(), "orientation": agrees})
    evidence = evidence._replace(log_odds=odds.astype(dtype))
    told = jnp.asarray(sign) != 0
    likely = confidence_of(evidence, told)
    return evidence._replace(confidence=likely.astype(dtype))


def spectrum_gap(spec_x: Spectrum, spec_y: Spectrum) -> Float[Array, ""]:
    """How unlike two shapes are, by their first eigenvalues.

        max_i |log(lambda_i of X / lambda_i of Y)|,  i = 1 .. `EIGENVALUES`

    Args:
        spec_x, spec_y: of shapes of unit area.

    Returns:
        0 or more; log 2 for shapes of which one has half the eigenvalue somewhere.
    """
    x, y = (jnp.log(s.evals[1 : 1 + EIGENVALUES] + LEAST) for s in (spec_x, spec_y))
    k = min(len(x), len(y))
    return jnp.max(jnp.abs(x[:k] - y[:k]))


class Bending(NamedTuple):
    """What is left when a wrong map is bent away, as means over both shapes.

    residual: distance between the bent shapes along the normal, in sqrt(area).
    shear: of triangles, all but `MOST_SHEARED` of the area is sheared less.
    area_std: standard deviation of the logarithm by which triangles grow.
    normal_gap: how far normals differ; 0 for none.
    """

    residual: Float[Array, ""]
    shear: Float[Array, ""]
    area_std: Float[Array, ""]
    normal_gap: Float[Array, ""]


@jit(static_argnames="rounding")
def bending(
    maps: Filtered | Maps,
    moved_x: Float[Array, "n_x 3"],
    moved_y: Float[Array, "n_y 3"],
    spec_x: Spectrum,
    spec_y: Spectrum,
    *,
    rounding: float = ROUNDING,
) -> Bending:
    """How two shapes lie that were bent onto each other. All in sqrt(area).

    A wrong map asks for more than a surface that resists stretching gives: the shapes
    stay apart, or are sheared where the map turns. With a_i the share of a vertex in
    the area of X, p_i its position bent onto Y and m_i its normal there, y_j and n_j
    position and normal of its image at rest, j = T_xy[i]:

        residual_xy = max(0, sum_i a_i |n_j . (p_i - y_j)| - c h),
        normal_gap_xy = 1 - |sum_i a_i m_i . n_j|,

    h = sqrt(area of Y / its vertices) and c = `rounding`, for what rounding to vertices
    leaves. With s_1 <= s_2 the stretches of a triangle of X (`log_stretches`), and
    t = log(s_1 s_2) / 2, over triangles by their area at rest:

        shear_xy = quantile 1 - `MOST_SHEARED` of log(s_2 / s_1),
        area_std_xy = standard deviation of t.

    Each figure is the mean over both directions.

    Args:
        maps: between the vertices.
        moved_x, moved_y: positions of X deformed onto Y, and of Y deformed onto X.
        spec_x, spec_y: both at rest.
        rounding: share of the spacing of vertices that rounding leaves.

    Returns:
        Numbers of 0 or more; nan if one of them has no faces, or those of padding only.
    """
    if len(spec_x.faces) == 0 or len(spec_y.faces) == 0:
        return Bending(*[jnp.full((), jnp.nan, moved_x.dtype)] * 4)

    def one_way(spec, bent, target, T):
        outward = normals(target.vertices, target.faces)[T]
        share = spec.mass / spec.mass.sum()
        gap = jnp.abs(jnp.sum((bent - target.vertices[T]) * outward, 1))
        real = jnp.sum((target.mass > 0).astype(share.dtype))
        spacing = jnp.sqrt(safe_divide(target.mass.sum(), real))
        residual = jnp.maximum(matmul(share, gap) - rounding * spacing, 0)
        alike = jnp.sum(normals(bent, spec.faces) * outward, 1)
        normal_gap = 1 - jnp.abs(matmul(share, alike))
        area, smaller, larger = log_stretches(spec.vertices, bent, spec.faces)
        area = area / area.sum()
        growth = (smaller + larger) / 2
        mean = matmul(area, growth)
        variance = matmul(area, (growth - mean) ** 2)
        shear = _quantile(larger - smaller, area, 1 - MOST_SHEARED)
        return jnp.stack([residual, shear, jnp.sqrt(variance), normal_gap])

    both = map_sides(
        one_way,
        (spec_x, moved_x, spec_y, maps.T_xy),
        (spec_y, moved_y, spec_x, maps.T_yx),
    )
    surfaces = jnp.any(spec_x.faces) & jnp.any(spec_y.faces)
    mean = jnp.where(surfaces, jnp.mean(jnp.stack(both), 0), jnp.nan)
    return Bending(*mean)


def _at_samples(C_yx, samples: tuple[SearchSamples, SearchSamples]):
    """Energy and `log_stretch_std` of the leading functions."""
    x, y = samples
    search_pair = SamplePair(x.search_points, y.search_points, False)
    ranking_pair = SamplePair(x.ranking_points, y.ranking_points, False)
    lead = C_yx[None, :READ_FUNCTIONS, :READ_FUNCTIONS]
    energy = energies(ranking_pair, lead)
    stretch = log_stretch_std(search_pair, x.geodesics, y.geodesics, lead)
    return energy[0].astype(C_yx.dtype), stretch[0].astype(C_yx.dtype)


def _reached(T_xy, mass_x, mass_y):
    """Coverage, over the share of Y's vertices that as few as X has can hit."""
    n_x, n_y = (jnp.sum(mass > 0) for mass in (mass_x, mass_y))
    share = jnp.minimum(n_x / n_y, 1).astype(mass_y.dtype)
    return jnp.minimum(coverage(T_xy, mass_y, mass_x=mass_x) / share, 1)


def _there_and_back(returned, spec: Spectrum):
    """Mean distance of a vertex from its image there and back; 1 for random images."""
    points = biharmonic(spec)
    moved = jnp.sqrt(jnp.sum((points - points[returned]) ** 2, 1))
    return matmul(spec.mass, moved) / rms_distance(points, spec.mass)


def _quantile(values, weight, share: float):
    """The value below which this share of the weight lies; weights sum to 1."""
    order = jnp.argsort(values)
    below = jnp.cumsum(weight[order])
    at = jnp.searchsorted(below, jnp.asarray(share, below.dtype) * below[-1])
    return values[order[jnp.minimum(at, len(values) - 1)]]

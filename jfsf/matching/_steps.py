"""The steps of an attempt: jitted functions of arrays, and the order they are done in.

| function | from | to |
|---|---|---|
| `shape_samples` | the spectrum of a shape | what search and refinement read of it |
| `given_start` | spectra, a map of anyone | a start, without a search |
| `refine_start` | samples, a start | C_yx in a larger basis |
| `bend` | spectra of coarse copies, C_yx | deformed, which `finish` goes on from |
| `finish` | spectra, C_yx | deformed, converted, certified: a `Match` |

`steps_of` lists those of an attempt once. `attempt` folds them; the policy maps each of
them over many pairs, or only has it compiled. `refine_start` reads samples, equally
many whatever the size of a shape, so its program serves all sizes.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jfsf.array._jit import jit
from jfsf.convert import maps_of
from jfsf.initial import Start
from jfsf.initial._samples import SearchSamples, search_samples
from jfsf.matching._certificate import certify
from jfsf.matching._kept_landmarks import Landmarks, kept_landmarks
from jfsf.matching._settings import Settings
from jfsf.matching._stages import pair_search
from jfsf.matching._vertices import vertex_confidence, vertex_radius
from jfsf.spectral import Features, functional_map, truncate, uniform
from jfsf.spectral._orientation import FUNCTIONS, brackets, orientation_score
from jfsf.spectral._sampling import even_points
from jfsf.types import Bent, Filtered, Match, Spectrum

SpectrumPair = tuple[Spectrum, Spectrum]


class ShapeSamples(NamedTuple):
    """What search and refinement read of a shape.

    search: for the search.
    refinement: features at samples if the shape is large, else the whole shape.
    """

    search: SearchSamples
    refinement: Features


SamplesPair = tuple[ShapeSamples, ShapeSamples]


@jit(static_argnames="settings")
def shape_samples(
    spec: Spectrum,
    descriptors: Float[Array, "n d"] | None = None,
    landmarks: Int[Array, " l"] | None = None,
    self_map: Bool[Array, ""] | bool = False,
    *,
    settings: Settings = Settings(),
) -> ShapeSamples:
    """Describe a shape, and read it at samples.

    Args:
        spec, descriptors, landmarks, self_map: as `jfsf.spectral.features`.
        settings: `describe`, `features`, `search`, `samples`,
            `exhaustive_up_to`.

    Raises:
        ValueError: as `Settings.describe`, or fewer eigenpairs than the search needs.
    """
    options = {"self_map": self_map, "settings": settings.features}
    whole = settings.describe(spec, descriptors, landmarks, **options)
    n = len(spec.mass)
    refinement, among = whole, None
    # Equally many samples of all large shapes: one program refines them.
    if n > settings.samples:
        at = even_points(spec, num=settings.samples)
        refinement = whole.at(at)
        among = at if n > settings.exhaustive_up_to else None
    search = search_samples(whole, among, settings=settings.search)
    return ShapeSamples(search, refinement)


@jit(static_argnames="settings")
def given_start(
    spec_x: Spectrum,
    spec_y: Spectrum,
    initial: Float[Array, "k_x k_y"] | Int[Array, " n_x"],
    *,
    settings: Settings = Settings(),
) -> Start:
    """A map of anyone, in place of the search's.

    Args:
        spec_x, spec_y: both shapes.
        initial: C_yx, or T_xy as integers.
        settings: C_yx is cut to as many functions as the search finds, or as `ks`
            begin with: so all starts share the program of the refinement.

    Raises:
        ValueError: an initial map that does not fit the shapes.
    """
    size = max(settings.ks[0], settings.search.final_ks[-1])
    C_yx = _functional_map_of(initial, spec_x, spec_y, size)[:size, :size]
    k = min(FUNCTIONS, len(spec_x.evals), len(spec_y.evals))
    on_x, on_y = (brackets(spec, k=k) for spec in (spec_x, spec_y))
    score = orientation_score(C_yx, on_x, on_y)
    unknown = jnp.full((), jnp.nan, C_yx.dtype)
    weight = jnp.full_like(unknown, settings.search.descriptor_weight)
    return Start(C_yx, jnp.asarray(score), unknown, weight, unknown)


@jit(static_argnames="settings")
def refine_start(
    features: tuple[Features, Features],
    start: Start,
    *,
    settings: Settings = Settings(),
) -> Float[Array, "k l"]:
    """The functional map of a start, by `Settings.refine`.

    Args:
        features: of X and Y, at the samples of the refinement.
        start: the map to begin with.
        settings: of the refinement.
    """
    weight = start.descriptor_weight
    return settings.refine(*features, start.C_yx, start.sign, weight, settings=settings)


@jit(static_argnames="settings")
def bend(
    pair: SpectrumPair, C_yx: Float[Array, "k l"], start: Start, *, settings: Settings
) -> Bent:
    """Deform both shapes, which have faces, by a map, as `finish` does first.

    Of coarse copies: the whole shapes follow them, and fewer rounds are left.

    Args:
        pair, C_yx, start, settings: as `finish`.
    """
    search = pair_search(*pair, settings=settings)
    aligned = settings.deform(*pair, C_yx, start.sign, search, settings=settings)
    return Bent(aligned.moved_x, aligned.moved_y)  # type: ignore[arg-type]


@jit(static_argnames="settings")
def finish(
    pair: SpectrumPair,
    samples: tuple[SearchSamples, SearchSamples],
    C_yx: Float[Array, "k l"] | Bent,
    start: Start,
    sign: Int[Array, ""] | int = 1,
    landmarks: Landmarks | None = None,
    *,
    settings: Settings = Settings(),
) -> Match:
    """Deform both shapes by a functional map, convert for the last time, and certify.

    Args:
        pair, sign, landmarks: as `attempt`.
        samples: of the search, for the evidence.
        C_yx: the map, refined or not; or the shapes as it has bent them already.
        start: what it was refined from.
        settings: `deform`, `converter` and what they and the evidence read.
    """
    search = pair_search(*pair, settings=settings)
    aligned = settings.deform(*pair, C_yx, start.sign, search, settings=settings)
    uniform_x, uniform_y = (uniform(spec.mass) for spec in pair)
    embs = aligned.emb_x, aligned.emb_y
    maps = settings.converter(*embs, uniform_x, uniform_y, search)
    maps = maps if isinstance(maps, Filtered) else maps_of(maps)
    k = min(len(spec.evals) for spec in pair)
    final = functional_map(maps.T_xy, truncate(pair[0], k), pair[1])
    evidence = certify(maps, aligned, final, pair, samples, sign, landmarks)
    radius = vertex_radius(maps_of(maps), aligned, pair)
    likely = [vertex_confidence(side, evidence.confidence) for side in radius]
    evidence = evidence._replace(gap=start.gap, mirror_gap=start.mirror_gap)
    return Match(
        *maps_of(maps),
        final,
        evidence,
        confidence_x=likely[0],
        confidence_y=likely[1],
        radius_x=radius[0],
        radius_y=radius[1],
    )


def _functional_map_of(initial, spec_x: Spectrum, spec_y: Spectrum, k: int):
    if initial.ndim == 1 and jnp.issubdtype(initial.dtype, jnp.integer):
        k = min(k, len(spec_x.evals), len(spec_y.evals))
        return functional_map(initial, truncate(spec_x, k), truncate(spec_y, k))
    widths = len(spec_x.evals), len(spec_y.evals)
    fits = initial.ndim == 2 and min(initial.shape) > 1
    if not (fits and all(k <= n for k, n in zip(initial.shape, widths, strict=True))):
        raise ValueError(
            f"initial is {initial.dtype} {initial.shape}; give C_yx (k_x, k_y) of 2 or "
            f"more functions and at most the {widths} eigenpairs there are, or T_xy "
            "(n_x,) as integers"
        )
    return initial.astype(spec_x.evecs.dtype)


class Work(NamedTuple):
    """An attempt on its way.

    spectra, samples, start, sign, landmarks: what `attempt` is given.
    features: of the refinement, without the landmarks that the start misses.
    C_yx: the map, refined; or both shapes, as their coarse copies have bent them.
    match: what the last step makes.
    """

    spectra: SpectrumPair
    samples: SamplesPair
    start: Start
    sign: Int[Array, ""] | int
    landmarks: Landmarks | None
    features: tuple[Features, Features]
    C_yx: Float[Array, "k l"] | Bent | None = None
    match: Match | None = None


class Step(NamedTuple):
    """A step of an attempt.

    name: one of `jfsf.types.STAGES`.
    run: a jitted function of arrays, with `settings`.
    reads: its arguments.
    writes: the field of `Work` that it makes.
    """

    name: str
    run: Callable[..., Any]
    reads: Callable[[Work], tuple]
    writes: str

    def done(self, work: Work, made: Any) -> Work:
        """The work with what this step has made."""
        return work._replace(**{self.writes: made})


def begin(
    spectra: SpectrumPair,
    samples: SamplesPair,
    start: Start,
    sign: Int[Array, ""] | int,
    landmarks: Landmarks | None,
) -> Work:
    """The work before the first step."""
    features = samples[0].refinement, samples[1].refinement
    return Work(spectra, samples, start, sign, landmarks, features)


KEEP_LANDMARKS = Step(
    "kept landmarks",
    kept_landmarks,
    lambda work: (work.spectra, work.features, work.start, work.landmarks),
    "features",
)
REFINE = Step(
    "refinement", refine_start, lambda work: (work.features, work.start), "C_yx"
)
FINISH = Step(
    "bending and conversion",
    finish,
    lambda work: (
        work.spectra,
        tuple(side.search for side in work.samples),
        work.C_yx,
        work.start,
        work.sign,
        work.landmarks,
    ),
    "match",
)


def steps_of(landmarks: Any) -> tuple[Step, ...]:
    """The steps of an attempt: `attempt` folds them, and the policy maps each of them.

    Args:
        landmarks: those that there are, or None.
    """
    return (*([] if landmarks is None else [KEEP_LANDMARKS]), REFINE, FINISH)

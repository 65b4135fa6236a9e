"""Spectra -> Match, stage by stage. Every stage is public, pure, jitted and vmappable.

| stage | from | to |
|---|---|---|
| `jfsf.spectral.features` | spectrum | what is read of one shape |
| `jfsf.initial.search_samples` | features | what the search reads of it |
| `best_candidate` | these samples of both | the best map that the search finds |
| `other_starts` | these samples of both | maps for shapes of other proportions |
| `kept_landmarks` | features, a map | features without landmarks it misses |
| `given_map` | spectra, a map of anyone | the same as the best, without a search |
| `refinement_samples` | features | what the refinement reads of it |
| `refine` | features, C_yx | C_yx in a larger basis |
| `pair_tiles` | spectra | tiles for the search of neighbours in large shapes |
| `bend` | spectra, C_yx | aligned embeddings |
| `convert` | aligned embeddings | maps both ways, with their plan |
| `jfsf.spectral.functional_map` | T_xy, spectra | C_yx of the final map |
| `jfsf.evaluate.certify` | all of these | evidence |

`features` takes `Settings.features`, the two stages of the search `Settings.search`,
the others of this module the whole `Settings`. `run_stages` has all in order, as few
programs: `ShapeSamples` is all that search and refinement read of a shape, equally many
samples whatever its size. So their programs, most of what is compiled, serve all sizes.
Two others are compiled for each size: the one before these, and all that follows.

This file is long because it has all stages one below the other.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jfsf.array import map_sides, matmul
from jfsf.convert import HasMaps, maps_of, with_options
from jfsf.evaluate import MISSED, certify, landmark_distances
from jfsf.initial import (
    Orientation,
    SearchSamples,
    SearchSettings,
    candidates,
    nonisometric_candidates,
    orientation_sign,
    search_samples,
)
from jfsf.neighbours import tiles_of_pair
from jfsf.refine import arap, zoomout
from jfsf.settings import Settings
from jfsf.spectral import (
    Features,
    brackets,
    embeddings,
    even_points,
    features,
    functional_map,
    orientation_score,
    truncate,
    uniform,
)
from jfsf.types import Filtered, Maps, Match, Spectrum, Tiles

Pair = tuple[Tiles, Tiles]


class ShapeSamples(NamedTuple):
    """All that is read of a shape before its map is bent.

    search: see `search_samples`.
    refinement: see `refinement_samples`.
    """

    search: SearchSamples
    refinement: Features


class InitialMap(NamedTuple):
    """Where the refinement starts.

    C_yx: functions on Y pulled back to X.
    orientation: score in [-1, 1]; nan for clouds without a surface.
    gap: the second candidate's energy over the first's, minus 1; nan for any other map.
    descriptor_weight: of the columns beside the eigenfunctions in its refinement.
    """

    C_yx: Float[Array, "k_x k_y"]
    orientation: Float[Array, ""]
    gap: Float[Array, ""]
    descriptor_weight: Float[Array, ""]

    @property
    def sign(self) -> Float[Array, ""]:
        """1 for a map that keeps orientation, -1 for one that mirrors, 0 if unknown."""
        return jnp.sign(jnp.nan_to_num(self.orientation))


def match_spectra(
    spec_x: Spectrum,
    spec_y: Spectrum,
    landmarks: Int[Array, "l 2"] | None = None,
    descriptors: tuple[Float[Array, "n_x d"], Float[Array, "n_y d"]] | None = None,
    initial: Float[Array, "k_x k_y"] | Int[Array, " n_x"] | HasMaps | None = None,
    *,
    orientation: Orientation | Int[Array, ""] = "preserve",
    self_map: Bool[Array, ""] | bool = False,
    settings: Settings = Settings(),
) -> Match:
    """`jfsf.match` from the spectra on: pure, so it vmaps over pairs of equal size.

    Under vmap all pairs try as many starts as the least confident one. Reverse
    differentiation needs `Settings(retry_below=0)`: the number of starts is not known
    before, and such a loop has no reverse.

    Args:
        spec_x, spec_y: 40 eigenpairs or more (`Settings.search`), equally many of both;
            mass 0 is padding.
        landmarks, descriptors: as `jfsf.match`, one row a vertex, padding included.
        initial: C_yx, T_xy, or a record with T_xy, in place of the search.
        orientation, self_map: as `jfsf.initial.candidates`; neither compiles anew.
        settings: of all stages.

    Raises:
        ValueError: too few eigenpairs, or arrays that do not fit the spectra.
    """
    sign = orientation_sign(orientation)
    if initial is not None and not hasattr(initial, "ndim"):
        initial = initial.T_xy  # type: ignore[union-attr]
    return _match_spectra(
        spec_x,
        spec_y,
        landmarks,
        descriptors,
        initial,
        sign,
        self_map,
        settings=settings,
    )


@partial(jax.jit, static_argnames="settings")
def _match_spectra(spec_x, spec_y, landmarks, *args, settings):
    pair = None if landmarks is None else tuple(landmarks.T)
    return run_stages(spec_x, spec_y, pair, *args, settings=settings)


def _inline(stage, *args):
    return stage(*args)


def _most_confident(
    attempt: Callable[[InitialMap], Match],
    first: InitialMap,
    others: Sequence[Callable[[], InitialMap]],
    retry_below: float,
) -> Match:
    """The first attempt that is confident enough, or the most confident of all.

    If the first misses a landmark, the second is made too: the landmark or the map is
    wrong.

    Args:
        attempt: makes a match of a start.
        first: the start that is tried first.
        others: each makes further starts, along a leading axis.
        retry_below: no further start is tried from this confidence on.
    """

    def made():
        starts = [make() for make in others]
        return jax.tree.map(lambda *values: jnp.concatenate(values), *starts)

    later = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), jax.eval_shape(made))
    starts = jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), first, later)
    count = len(starts.gap)
    shapes = jax.eval_shape(attempt, first)
    none = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), shapes)
    best = none._replace(
        certificate=none.certificate._replace(
            confidence=jnp.full_like(none.certificate.confidence, -1)
        )
    )

    def with_others(starts):
        return jax.tree.map(lambda a, b: a.at[1:].set(b), starts, made())

    def goes_on(state):
        i, _, best = state
        # Not so with nan: there is nothing to compare.
        more = best.certificate.confidence < retry_below
        more |= (i == 1) & misses_landmarks(best)
        return (i < count) & more

    def step(state):
        i, starts, best = state
        # Not before they are needed.
        starts = jax.lax.cond(i == 1, with_others, lambda same: same, starts)
        found = attempt(jax.tree.map(lambda values: values[i], starts))
        better = found.certificate.confidence > best.certificate.confidence
        # The first stays, whatever is wrong with it, until there is a better one.
        better |= i == 0
        best = jax.tree.map(lambda a, b: jnp.where(better, a, b), found, best)
        return i + 1, starts, best

    return jax.lax.while_loop(goes_on, step, (0, starts, best))[2]


def _most_promising(
    promise: Callable[[InitialMap], Array], starts: InitialMap, num: int
) -> InitialMap:
    """The starts that promise most, the best first.

    Args:
        promise: a number for each start.
        starts: along a leading axis.
        num: of those to keep; all, if there are no more.
    """
    if len(starts.gap) <= num:
        return starts
    promised = jax.lax.map(promise, starts)
    order = jnp.argsort(-jnp.nan_to_num(promised, nan=-1.0), stable=True)[:num]
    return jax.tree.map(lambda values: values[order], starts)


def misses_landmarks(match: Match) -> Bool[Array, ""]:
    """Whether a landmark ends far from its partner."""
    return jnp.any(match.certificate.landmarks > MISSED)


def run_stages(
    spec_x: Spectrum,
    spec_y: Spectrum,
    landmarks: Any,
    descriptors: Any,
    initial: Any,
    sign: Any,
    self_map: Any,
    *,
    settings: Settings,
    run: Callable[..., Any] = _inline,
    run_sides: Callable[..., Any] = map_sides,
    most_confident: Callable[..., Match] = _most_confident,
    most_promising: Callable[..., InitialMap] = _most_promising,
    coarse: Callable[[], InitialMap | None] | None = None,
) -> Match:
    """All stages in their order: `match_spectra`, and `jfsf.match` stage by stage.

    Args:
        spec_x, spec_y, descriptors, initial, self_map, settings: as `match_spectra`;
            initial is an array.
        landmarks: vertices of X, and those of Y in their order; or None.
        sign: the wanted orientation, see `jfsf.initial.orientation_sign`.
        run: calls a stage, run(stage, *args). A stage is a `partial` of a function of
            arrays, with static options.
        run_sides: calls a stage for either shape, as `jfsf.array.map_sides`.
        most_confident: chooses among starts, as `_most_confident`, which is traced.
        most_promising: chooses those to try, as `_most_promising`, which is traced.
        coarse: makes starts, along a leading axis, in place of `other_starts`; or
            None, as it may return if it cannot.
    """
    at_x, at_y = landmarks or (None, None)
    desc_x, desc_y = descriptors or (None, None)
    found = settings.search.final_ks[-1]
    if initial is None and settings.ks[0] > found:
        raise ValueError(
            f"Settings: ks begins at {settings.ks[0]}, but the search finds maps "
            f"of {found} functions; begin with {found} or fewer"
        )
    pair = spec_x, spec_y

    def samples_of_both(at_x, at_y):
        return run_sides(
            partial(shape_samples, settings=settings),
            (spec_x, desc_x, at_x, self_map),
            (spec_y, desc_y, at_y, self_map),
        )

    x, y = samples_of_both(None, None)
    samples = x.search, y.search
    # The first search does not know the landmarks, so it cannot be misled by them.
    known_x, known_y = (x, y) if landmarks is None else samples_of_both(at_x, at_y)

    def attempt(start: InitialMap) -> Match:
        sides = known_x.refinement, known_y.refinement
        if landmarks is not None:
            stage = partial(kept_landmarks, settings=settings)
            sides = run(stage, *sides, *pair, start, at_x, at_y)
        C_yx = run(partial(_refined, settings=settings), *sides, start)
        return finished(C_yx, start, settings.bend_rounds)

    def finished(C_yx, start: InitialMap, rounds: int) -> Match:
        finish = partial(_finished, settings=settings)
        return run(finish, *pair, C_yx, start, rounds, samples, sign, landmarks)

    def promise(start: InitialMap) -> Array:
        """The confidence of a start as it is, bent a little."""
        # As large as a refined map: one program.
        widest = min(len(spec.evals) for spec in pair)
        size = min(settings.ks[-1], widest)
        C_yx = start.C_yx[:size, :size]
        C_yx = jnp.pad(C_yx, [(0, size - k) for k in C_yx.shape])
        rounds = settings.screening_rounds
        return finished(C_yx, start, rounds).certificate.confidence

    def candidate(*samples) -> InitialMap:
        stage = partial(best_candidate, settings=settings.search)
        return run(stage, *samples, sign, self_map)

    def guided() -> InitialMap:
        return candidate(known_x.search, known_y.search)

    def far() -> InitialMap:
        if coarse is not None and (found := coarse()) is not None:
            return found
        stage = partial(other_starts, settings=settings.search)
        starts = run(stage, *samples, sign, self_map)
        return most_promising(promise, starts, settings.nonisometric_attempts)

    others = [far]
    if landmarks is not None:
        others.insert(0, lambda: jax.tree.map(lambda a: a[None], guided()))

    if initial is not None:
        return attempt(run(partial(given_map, settings=settings), *pair, initial))
    if not settings.retry_below:
        return attempt(guided())
    return most_confident(attempt, candidate(*samples), others, settings.retry_below)


def stage_name(stage: partial) -> str:
    """What a stage that `run_stages` hands to `run` does, in a few words."""
    return _STAGE_NAMES[stage.func]


def _refined(x, y, start: InitialMap, *, settings):
    weight = start.descriptor_weight
    return refine(x, y, start.C_yx, start.sign, weight, settings=settings)


def _finished(
    spec_x, spec_y, C_yx, start: InitialMap, rounds, *evidence, settings: Settings
) -> Match:
    pair = spec_x, spec_y
    tiles = pair_tiles(*pair, settings=settings)
    embs = bend(*pair, C_yx, start.sign, tiles, rounds, settings=settings)
    maps = convert(*embs, *pair, tiles, settings=settings)
    k = min(len(spec_x.evals), len(spec_y.evals))
    C_yx = functional_map(maps.T_xy, truncate(spec_x, k), spec_y)
    certificate = certify(
        *(maps, *embs, C_yx, *pair, start.gap),
        *evidence,
        bent=_bends(spec_x, spec_y, settings),
        oriented_functions=settings.features.oriented_functions,
        distance_pairs=settings.distance_pairs,
    )
    return Match(*maps_of(maps), C_yx, certificate)


@partial(jax.jit, static_argnames="settings")
def shape_samples(
    spec: Spectrum,
    descriptors: Float[Array, "n d"] | None = None,
    landmarks: Int[Array, " l"] | None = None,
    self_map: Bool[Array, ""] | bool = False,
    *,
    settings: Settings = Settings(),
) -> ShapeSamples:
    """`features`, `search_samples` and `refinement_samples` of one shape.

    Args:
        spec, descriptors, landmarks, self_map: as `jfsf.spectral.features`.
        settings: of all three.

    Raises:
        ValueError: as they do.
    """
    whole = features(
        spec, descriptors, landmarks, self_map=self_map, settings=settings.features
    )
    at = _sample_points(spec, settings)
    # Among all vertices of a very large shape farthest points would take too long.
    among = at if len(spec.mass) > settings.exhaustive_up_to else None
    return ShapeSamples(
        search_samples(whole, among, settings=settings.search),
        _refinement_samples(whole, at, settings),
    )


@partial(jax.jit, static_argnames="settings")
def best_candidate(
    x: SearchSamples,
    y: SearchSamples,
    orientation: Int[Array, ""] | int = 1,
    self_map: Bool[Array, ""] | bool = False,
    *,
    settings: SearchSettings = SearchSettings(),
) -> InitialMap:
    """The first of `jfsf.initial.candidates`, and its gap to the second.

    Args:
        x, y: both shapes at samples, made with the same settings.
        orientation: the sign of the wanted orientation (`orientation_sign`).
        self_map: X and Y are one shape.
        settings: of the search.
    """
    found = candidates(
        x,
        y,
        orientation=orientation,  # type: ignore[arg-type]
        self_map=self_map,
        settings=settings,
    )
    gap = found.energy[1] / found.energy[0] - 1
    weight = jnp.full_like(gap, settings.descriptor_weight)
    return InitialMap(found.C_yx[0], found.orientation[0], gap, weight)


@partial(jax.jit, static_argnames="settings")
def other_starts(
    x: SearchSamples,
    y: SearchSamples,
    orientation: Int[Array, ""] | int = 1,
    self_map: Bool[Array, ""] | bool = False,
    *,
    settings: SearchSettings = SearchSettings(),
) -> InitialMap:
    """Starts for shapes of other proportions: `jfsf.initial.nonisometric_candidates`.

    Args:
        x, y, orientation, self_map, settings: as `best_candidate`.

    Returns:
        As many maps as `settings.nonisometric_candidates`, along the leading axis.
    """
    found = nonisometric_candidates(
        x,
        y,
        orientation=orientation,  # type: ignore[arg-type]
        self_map=self_map,
        settings=settings,
    )
    unknown = jnp.full_like(found.energy, jnp.nan)
    # The score of a rough map may have the wrong sign. The refinement then asks for
    # the wanted one.
    wanted = orientation * jnp.abs(found.orientation)
    score = jnp.where(orientation == 0, found.orientation, wanted)
    weight = jnp.full_like(unknown, settings.nonisometric_descriptor_weight)
    return InitialMap(found.C_yx, score, unknown, weight)


@partial(jax.jit, static_argnames="settings")
def given_map(
    spec_x: Spectrum,
    spec_y: Spectrum,
    initial: Float[Array, "k_x k_y"] | Int[Array, " n_x"],
    *,
    settings: Settings = Settings(),
) -> InitialMap:
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
    pulled_back = settings.search.zoomout.pulled_back
    k = min(settings.features.oriented_functions, len(spec_x.evals), len(spec_y.evals))
    on_x, on_y = (brackets(spec, k=k) for spec in (spec_x, spec_y))
    score = orientation_score(C_yx, on_x, on_y, pulled_back=pulled_back)
    unknown = jnp.full((), jnp.nan, C_yx.dtype)
    weight = jnp.full_like(unknown, settings.search.descriptor_weight)
    return InitialMap(C_yx, jnp.asarray(score), unknown, weight)


@partial(jax.jit, static_argnames="settings")
def kept_landmarks(
    x: Features,
    y: Features,
    spec_x: Spectrum,
    spec_y: Spectrum,
    start: InitialMap,
    at_x: Int[Array, " l"],
    at_y: Int[Array, " l"],
    *,
    settings: Settings = Settings(),
) -> tuple[Features, Features]:
    """Features without the columns of landmarks that a map misses.

    One wrong landmark among several is so not obeyed. Columns of the others count in
    full, whatever the start's weight of descriptors.

    Args:
        x, y: features made with these landmarks, whole or at samples.
        spec_x, spec_y: both shapes, whole.
        start: the map with which the refinement starts.
        at_x, at_y: vertices of X, and their partners.
        settings: `distance_pairs`, `features`.
    """
    bases = spec_x.evecs, spec_y.evecs
    emb_x, emb_y = embeddings(start.C_yx, *bases, space="direct")
    near = matmul(emb_x[at_x], emb_y.T) - jnp.sum(emb_y**2, 1)[None] / 2
    real = spec_y.mass > 0
    images = jnp.argmax(jnp.where(real[None], near, -jnp.inf), 1)
    pairs = settings.distance_pairs
    far = landmark_distances(images, at_y, spec_y, distance_pairs=pairs)
    # The last descriptors are those of the landmarks, curvature follows them.
    keep = jnp.repeat(far <= MISSED, settings.features.landmark_times)
    end = x.descriptors.shape[1]
    factor = jnp.ones(x.columns.shape[1], x.columns.dtype)
    full = keep.astype(factor.dtype) / start.descriptor_weight
    factor = factor.at[end - len(keep) : end].set(full)
    weighed_x, weighed_y = (side.columns * factor[None] for side in (x, y))
    return x._replace(columns=weighed_x), y._replace(columns=weighed_y)


@partial(jax.jit, static_argnames="settings")
def pair_tiles(
    spec_x: Spectrum, spec_y: Spectrum, *, settings: Settings = Settings()
) -> Pair | None:
    """Tiles of both shapes, or None for shapes that are small enough without."""
    if max(len(spec_x.mass), len(spec_y.mass)) <= settings.tiles_above:
        return None
    return tiles_of_pair(spec_x, spec_y, settings=settings.neighbours)


@partial(jax.jit, static_argnames="settings")
def refinement_samples(
    features: Features, *, settings: Settings = Settings()
) -> Features:
    """Features that the refinement reads: of samples if the shape is large.

    As many whatever the size, so the refinement is one program for all large shapes. A
    shape that has fewer vertices is there whole, with padding.
    """
    return _refinement_samples(
        features, _sample_points(features.spec, settings), settings
    )


def _sample_points(spec: Spectrum, settings: Settings):
    """Vertices that stand for a large shape; None for a small one."""
    if len(spec.mass) <= settings.samples_above:
        return None
    num = min(settings.samples, len(spec.mass))
    return even_points(spec, num=num, distance_pairs=settings.distance_pairs)


def _refinement_samples(features: Features, at, settings: Settings) -> Features:
    pairs = settings.distance_pairs
    return features if at is None else features.at(at, distance_pairs=pairs)


@partial(jax.jit, static_argnames="settings")
def refine(
    x: Features,
    y: Features,
    C_yx: Float[Array, "k_x k_y"],
    orientation: Float[Array, ""] | float = 1.0,
    descriptor_weight: Float[Array, ""] | float = 0.5,
    *,
    settings: Settings = Settings(),
) -> Float[Array, "k k"]:
    """ZoomOut of C_yx with descriptors, curvature and oriented products.

    Args:
        x, y: features, whole or at samples.
        C_yx: the start; its leading block of `ks[0]` functions, if it has more.
        orientation: 1 or -1, the sign of the start's orientation; 0 if unknown.
        descriptor_weight: of all these beside the eigenfunctions. Where proportions
            differ so do descriptors: there a tenth is better.
        settings: `ks`, `refine_converter`, `zoomout`. Sizes beyond the eigenpairs
            there are are cut; a smaller start adds its own size in front.
    """
    widest = min(len(x.spec.evals), len(y.spec.evals))
    ks = tuple(min(k, widest) for k in settings.ks)
    if (size := min(C_yx.shape)) < ks[0]:
        ks = (size, *ks)
    return zoomout(
        x.spec,
        y.spec,
        C_yx,
        x.columns,
        y.columns,
        orientation * x.bracket_fields,
        y.bracket_fields,
        ks=ks,
        converter=settings.refine_converter,
        weighted=True,
        bidirectional=True,
        extra_weight=descriptor_weight,
        tiles=pair_tiles(x.spec, y.spec, settings=settings),
        settings=settings.zoomout,
        neighbour_settings=settings.neighbours,
    )


@partial(jax.jit, static_argnames="settings")
def bend(
    spec_x: Spectrum,
    spec_y: Spectrum,
    C_yx: Float[Array, "k_x k_y"],
    orientation: Float[Array, ""] | float = 1.0,
    tiles: Pair | None = None,
    rounds: Int[Array, ""] | int | None = None,
    *,
    settings: Settings = Settings(),
) -> tuple[Float[Array, "n_x d"], Float[Array, "n_y d"]]:
    """Aligned embeddings: of both shapes bent onto each other, or those of C_yx.

    Args:
        spec_x, spec_y: with their vertices and faces, for the bending.
        C_yx: the functional map, refined. Rows of zeros are left out.
        orientation: -1 for a map that mirrors.
        tiles: of both shapes.
        rounds: `bend_rounds` or fewer; does not compile anew. None: all.
        settings: `bend_rounds`, `bend_converter`, `bend`. Without rounds, or if
            neither shape has faces, the embeddings are those of C_yx, in the direct
            space.
    """
    emb_x, emb_y = embeddings(C_yx, spec_x.evecs, spec_y.evecs, space="direct")
    emb_x = jnp.asarray(jnp.where(jnp.any(C_yx != 0, 1)[None], emb_x, 0))
    if not _bends(spec_x, spec_y, settings):
        return emb_x, emb_y
    # A cloud without a surface beside a mesh gets a face of padding: its points move
    # freely, while the mesh resists.
    spec_x, spec_y = (
        spec if len(spec.faces) else spec._replace(faces=jnp.zeros((1, 3), jnp.int32))
        for spec in (spec_x, spec_y)
    )
    options: dict[str, Any] = {"neighbour_settings": settings.neighbours}
    min_recall = _min_recall(spec_x, spec_y, settings)
    converter = with_options(settings.bend_converter, min_recall=min_recall)
    with_tiles = with_options(converter, tiles=tiles, **options)
    marginal_x, marginal_y = uniform(spec_x.mass), uniform(spec_y.mass)
    maps = maps_of(with_tiles(emb_x, emb_y, marginal_x, marginal_y))
    return arap(
        spec_x,
        spec_y,
        maps,
        jnp.where(jnp.asarray(orientation) < 0, -1.0, 1.0),
        rounds=settings.bend_rounds,
        converter=converter,
        tiles=tiles,
        active_rounds=rounds,
        settings=settings.bend,
        **options,
    )


@partial(jax.jit, static_argnames="settings")
def convert(
    emb_x: Float[Array, "n_x d"],
    emb_y: Float[Array, "n_y d"],
    spec_x: Spectrum,
    spec_y: Spectrum,
    tiles: Pair | None = None,
    *,
    settings: Settings = Settings(),
) -> Filtered | Maps:
    """The last conversion, by `Settings.converter` on uniform marginals.

    Returns:
        `Filtered`, if the converter makes a plan as `sinkhorn` does; else `Maps`.
    """
    converter = with_options(
        settings.converter,
        tiles=tiles,
        neighbour_settings=settings.neighbours,
        min_recall=_min_recall(spec_x, spec_y, settings),
    )
    found = converter(emb_x, emb_y, uniform(spec_x.mass), uniform(spec_y.mass))
    return found if isinstance(found, Filtered) else maps_of(found)


def _bends(spec_x: Spectrum, spec_y: Spectrum, settings: Settings) -> bool:
    """Two clouds without a surface are not bent."""
    return settings.bend_rounds > 0 and len(spec_x.faces) + len(spec_y.faces) > 0


def _min_recall(spec_x: Spectrum, spec_y: Spectrum, settings: Settings) -> float:
    """To compare a million points with all others would take hours."""
    large = max(len(spec_x.mass), len(spec_y.mass)) > settings.exhaustive_up_to
    return 0.0 if large else settings.min_recall


def _functional_map_of(initial, spec_x: Spectrum, spec_y: Spectrum, k: int):
    dtype = spec_x.evecs.dtype
    if initial.ndim == 1 and jnp.issubdtype(initial.dtype, jnp.integer):
        k = min(k, len(spec_x.evals), len(spec_y.evals))
        return functional_map(initial, truncate(spec_x, k), truncate(spec_y, k))
    widths = len(spec_x.evals), len(spec_y.evals)
    if (
        initial.ndim != 2
        or min(initial.shape) < 2
        or not all(
            size <= width for size, width in zip(initial.shape, widths, strict=True)
        )
    ):
        raise ValueError(
            f"initial is {initial.dtype} {initial.shape}; give C_yx (k_x, k_y) of 2 or "
            f"more functions and at most the {widths} eigenpairs there are, or T_xy "
            "(n_x,) as integers"
        )
    return initial.astype(dtype)


_STAGE_NAMES = {
    shape_samples: "features",
    best_candidate: "search",
    given_map: "given map",
    other_starts: "further starts",
    kept_landmarks: "landmarks",
    _refined: "refinement",
    _finished: "bending and conversion",
}

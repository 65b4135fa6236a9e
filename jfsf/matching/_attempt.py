"""One attempt: two shapes and a start -> a Match. Pure: it jits and vmaps.

`attempt` folds the steps of `_steps`; `match_spectra` is the search, and one attempt.
Which starts are attempted where the first is in doubt is said in `jfsf.matching`.
"""

from functools import partial
from typing import cast

from jaxtyping import Array, Bool, Float, Int

from jfsf.array._jit import jit
from jfsf.array._loops import map_sides
from jfsf.convert import HasMaps
from jfsf.initial import Start, orientation_sign, search_starts
from jfsf.initial._search import Orientation
from jfsf.initial._start import given_arrays
from jfsf.matching._kept_landmarks import Landmarks
from jfsf.matching._settings import Settings
from jfsf.matching._steps import (
    SamplesPair,
    ShapeSamples,
    SpectrumPair,
    begin,
    given_start,
    shape_samples,
    steps_of,
)
from jfsf.types import Match, Spectrum


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
    """`jfsf.match` with one attempt, from the spectra on: the search, then the attempt.

    Pure: it jits, vmaps over pairs of equal size (n pairs cost n attempts), and has
    derivatives both ways. `jfsf.batch.match_spectra` tries doubtful pairs again, bends
    coarse copies of large shapes first, and goes on from a similarity that nearly fits,
    as `jfsf.match` does.

    Args:
        spec_x, spec_y: 40 eigenpairs or more (`Settings.search`), equally many of both;
            mass 0 is padding.
        landmarks, descriptors: as `jfsf.match`, one row for each vertex, padding
            included. The search reads the landmarks.
        initial: C_yx, T_xy, or a record with T_xy, in place of the search.
        orientation, self_map: as `jfsf.match`; neither compiles anew.
        settings: parameters of all stages; those of further attempts are not read.

    Raises:
        ValueError: too few eigenpairs, or arrays that do not fit the spectra.
    """
    pair = spec_x, spec_y
    given = given_arrays(pair, landmarks, descriptors, initial)
    sign = orientation_sign(orientation)
    return _match_spectra(pair, *given, sign, self_map, settings=settings)


@jit(static_argnames="settings")
def _match_spectra(
    pair: SpectrumPair, landmarks, descriptors, initial, sign, self_map, *, settings
):
    both = None if landmarks is None else tuple(landmarks.T)

    def described(at) -> SamplesPair:
        sides = zip(pair, descriptors or (None, None), at or (None, None), strict=True)
        inputs = ((*side, self_map) for side in sides)
        return map_sides(partial(shape_samples, settings=settings), *inputs)

    plain = known = described(None)
    if both is not None:
        known = described(both)
    if initial is None:
        settings.check_search()
        search = known[0].search, known[1].search
        start, _ = search_starts(*search, sign, self_map, settings=settings.search)
    else:
        start = given_start(*pair, initial, settings=settings)
    # The evidence does not know the landmarks.
    samples = ShapeSamples(plain[0].search, known[0].refinement)
    others = ShapeSamples(plain[1].search, known[1].refinement)
    return attempt(pair, (samples, others), start, sign, both, settings=settings)


@jit(static_argnames="settings")
def attempt(
    pair: SpectrumPair,
    samples: SamplesPair,
    start: Start,
    sign: Int[Array, ""] | int = 1,
    landmarks: Landmarks | None = None,
    *,
    settings: Settings = Settings(),
) -> Match:
    """Refine a start, deform the shapes by it, convert, and certify.

    Args:
        pair: the spectra of X and Y; mass 0 is padding.
        samples: `shape_samples` of both: for the refinement made with these landmarks,
            for the search without.
        start: the map to begin with.
        sign: sign of the wanted orientation, see `jfsf.initial.orientation_sign`.
        landmarks: vertices of X, and their partners.
        settings: parameters of all stages.
    """
    work = begin(pair, samples, start, sign, landmarks)
    for step in steps_of(landmarks):
        work = step.done(work, step.run(*step.reads(work), settings=settings))
    return cast(Match, work.match)

"""Find the initial functional map among many candidates: symmetric shapes have many.

A map can be flipped left to right, front to back, or both, and every flip is nearly as
isometric as the right map. The search goes in three stages.

1. Start from all sign patterns of the first eigenfunctions and from fits to
   descriptors. Refine each by ZoomOut on samples.
2. Flip the sign of one further eigenfunction in the best. Functions that are odd from
   front to back are among these. Refine again.
3. Keep the best that really differ. Refine them on more samples and rank them.

The energy (`_hypotheses`) cannot tell left from right, so one for a wrong orientation
is added (`with_orientation`). The idea of enumerating maps is that of MapTree (Ren et
al., SIGGRAPH Asia 2020). Here they are refined in batches, each one vmap.
"""

from functools import partial
from itertools import product
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jfsf._exported import exported
from jfsf.array._jit import jit
from jfsf.array._loops import map_sides
from jfsf.initial._hypotheses import (
    SamplePair,
    best_different,
    energies,
    refine_hypotheses,
)
from jfsf.initial._linear import solve
from jfsf.initial._samples import SearchSamples, search_samples
from jfsf.initial._settings import (
    FIT_KS,
    FITS,
    FLIP_KS,
    FLIP_RANGE,
    SIGN_FUNCTIONS,
    START_KS,
    START_WEIGHTS,
    SearchSettings,
)
from jfsf.initial._terms import combine
from jfsf.spectral import Features, FeatureSettings, features
from jfsf.spectral._orientation import orientation_score
from jfsf.types import Spectrum

Orientation = Literal["preserve", "reverse", "any"]
"""Maps that are asked for: those that keep left and right, reverse them, or both."""
# Energy of a map that keeps orientation on half of the shape and mirrors the rest.
HALF_MIRRORED_ENERGY = 0.2
# Added for a map of the wrong orientation: more than any other energy.
WRONG_ORIENTATION_ENERGY = 100.0


@exported
class Candidates(NamedTuple):
    """Functional maps that really differ, the best first.

    C_yx: each candidate: functions on Y pulled back to X.
    energy: departure of each candidate from an isometry that keeps the descriptors;
        lower is better. If an orientation is asked for, candidates of the other one get
        a penalty (`with_orientation`). A near copy of a better candidate has inf.
    orientation: score of each candidate in [-1, 1], near 1 if it preserves orientation
        and near -1 if it mirrors; nan for point clouds without a surface.
    mirror_gap: the least energy of all maps of the other orientation over the least of
        those of the orientation asked for, minus 1, before the last refinement. Below 0
        the mirror image fits better. nan if no orientation was asked for or is known,
        and for a self map.
    """

    C_yx: Float[Array, "c k k"]
    energy: Float[Array, " c"]
    orientation: Float[Array, " c"]
    mirror_gap: Float[Array, ""]


@jit(static_argnames=("num", "settings", "feature_settings"))
def search(
    spec_x: Spectrum,
    spec_y: Spectrum,
    desc_x: Float[Array, "n_x d"] | None = None,
    desc_y: Float[Array, "n_y d"] | None = None,
    sign: Int[Array, ""] | int = 1,
    self_map: Bool[Array, ""] | bool = False,
    *,
    num: int = 6,
    settings: SearchSettings = SearchSettings(),
    feature_settings: FeatureSettings = FeatureSettings(),
) -> Candidates:
    """The candidates of two shapes from their spectra: features, samples, `candidates`.

    Args:
        spec_x, spec_y: spectra with 40 eigenpairs or more, faces wound outward.
        desc_x, desc_y: descriptors; column i of one corresponds to column i of the
            other. The wave kernel signature when absent.
        sign, self_map, num, settings: as `candidates`.
        feature_settings: see `jfsf.spectral.features`.

    Raises:
        ValueError: too few eigenpairs.
    """
    for name, spec in (("x", spec_x), ("y", spec_y)):
        if len(spec.evals) < settings.eigenpairs:
            raise ValueError(
                f"search: spec_{name} has {len(spec.evals)} eigenpairs, it needs "
                f"{settings.eigenpairs}"
            )

    def samples(spec, desc):
        shape = features(spec, desc, self_map=self_map, settings=feature_settings)
        return search_samples(shape, settings=settings)

    sides = map_sides(samples, (spec_x, desc_x), (spec_y, desc_y))
    return candidates(*sides, sign, self_map, num=num, settings=settings)


def orientation_sign(
    orientation: Orientation | Int[Array, ""],
) -> Int[Array, ""] | int:
    """The sign that a map's orientation score should have; 0 for "any".

    Unlike a word it can be traced, so all orientations share one program.

    Args:
        orientation: a word, or a sign, which is returned.

    Raises:
        ValueError: an unknown orientation.
    """
    if not isinstance(orientation, str):
        return orientation
    signs = {"preserve": 1, "reverse": -1, "any": 0}
    if orientation not in signs:
        raise ValueError(
            f"orientation is 'preserve', 'reverse' or 'any', not {orientation!r}"
        )
    return signs[orientation]


@jit(static_argnames=("num", "settings"))
def candidates(
    x: SearchSamples,
    y: SearchSamples,
    sign: Int[Array, ""] | int = 1,
    self_map: Bool[Array, ""] | bool = False,
    *,
    num: int = 6,
    settings: SearchSettings = SearchSettings(),
) -> Candidates:
    """The `num` best and different functional maps between two shapes.

    Args:
        x, y: X and Y at samples, made with the same settings.
        sign: 1 puts maps that preserve orientation first, -1 maps that mirror; all
            others rank behind these. 0 asks for neither. `orientation_sign` converts a
            word.
        self_map: whether X and Y are one shape. With sign -1 its symmetries are found:
            the more a map resembles the identity, the more energy it has. Descriptors
            and curvature, which agree best under the identity, then count in the energy
            only.
        num: number of candidates to return.
        settings: parameters of the search.
    """
    search_pair = sample_pair(x.search_points, y.search_points, sign, self_map)
    ranking_pair = sample_pair(x.ranking_points, y.ranking_points, sign, self_map)
    dtype, half = x.search_points.spec.evecs.dtype, settings.descriptor_weight
    flip_from, flip_to = FLIP_RANGE

    signs = jnp.asarray(sign_patterns(SIGN_FUNCTIONS), dtype)
    weights = jnp.asarray(START_WEIGHTS, dtype)
    start_weights = jnp.repeat(weights, len(signs))
    starts = jnp.tile(signs, (len(weights), 1, 1))
    fitted = fits(x, y, sign).astype(dtype)
    parents = jnp.concatenate(
        [
            refine_hypotheses(search_pair, starts, start_weights, ks=START_KS),
            refine_hypotheses(search_pair, fitted, 1.0, ks=FIT_KS),
        ]
    )
    # Every other parent has columns of full weight. By energy alone few would have: it
    # does not see what they are good for.
    start_weights = jnp.pad(start_weights, (0, len(fitted)), constant_values=1)
    group = jnp.where(start_weights < 1, 1, 0)
    energy = energies(search_pair, parents)
    chosen, _ = best_different(parents, energy, settings.parents, group, 2)

    flipped = jnp.asarray(flips(flip_from, flip_to), dtype)
    children = parents[chosen][:, None, :flip_to, :flip_to] * flipped[None, :, None, :]
    children = children.reshape(-1, flip_to, flip_to)
    children = refine_hypotheses(search_pair, children, half, ks=FLIP_KS)
    brackets = x.search_points.brackets, y.search_points.brackets
    oriented = partial(with_orientation, brackets=brackets, sign=sign)
    plain = energies(search_pair, children)
    energy, score = oriented(plain, children)
    gap = jnp.where(self_map, jnp.nan, _mirror_gap(plain, sign * score))
    chosen, _ = best_different(children, energy, num)

    last = refine_hypotheses(ranking_pair, children[chosen], half, ks=settings.final_ks)
    energy, orientation = oriented(energies(ranking_pair, last), last)
    # Two candidates may have become one map. Copies rank last, or they would count as
    # rivals.
    kept, differs = best_different(last, energy, num)
    is_kept = jnp.zeros(num, bool).at[kept].max(differs)
    energy = jnp.asarray(jnp.where(is_kept, energy, jnp.inf))
    order = jnp.argsort(energy)
    return Candidates(last[order], energy[order], orientation[order], gap)


def _mirror_gap(energy: Array, agrees: Array):
    """See `Candidates`; `agrees` is above 0 where a map has the orientation wanted."""
    least = lambda side: jnp.min(jnp.asarray(jnp.where(side, energy, jnp.inf)))
    right, wrong = least(agrees > 0), least(agrees < 0)
    known = jnp.isfinite(right) | jnp.isfinite(wrong)
    return jnp.where(known, wrong / right - 1, jnp.nan)


def sample_pair(x: Features, y: Features, sign, self_map) -> SamplePair:
    """Samples of both shapes, to be matched with this orientation."""
    # With "any" the sign is 0, and the oriented columns are constant.
    return SamplePair(x._replace(brackets=sign * x.brackets), y, self_map)


def with_orientation(energy: Array, C_yx: Array, *, brackets, sign):
    """Energies with that of the orientation added, and orientation scores.

    With s the score of a map (`orientation_score`) times the wanted sign,

        E'(C) = E(C) + h (1 - s)  if s >= 0,
        E'(C) = E(C) + w          if s < 0,

    h = `HALF_MIRRORED_ENERGY`, w = `WRONG_ORIENTATION_ENERGY`. E' = E if no sign is
    wanted (0), or without a score (nan).

    Args:
        energy, C_yx: of each candidate.
        brackets: `brackets` of X and of Y.
        sign: 1, -1, or 0 for any.
    """
    score = lambda C: orientation_score(C, *brackets)
    orientation = jnp.asarray(jax.vmap(score)(C_yx))
    # Clouds without a surface have no score.
    asked = (sign != 0) & ~jnp.isnan(orientation)
    agrees = jnp.asarray(sign * orientation)
    half = HALF_MIRRORED_ENERGY * (1 - agrees)
    wrong = jnp.where(agrees < 0, WRONG_ORIENTATION_ENERGY, half)
    return energy + jnp.where(asked, wrong, 0), orientation


def fits(x: SearchSamples, y: SearchSamples, sign) -> Float[Array, "f k k"]:
    """Functional maps by fits to descriptors, cut to the size that refinement needs."""
    dtype, size = x.fit.coef.dtype, FIT_KS[0]
    sign = jnp.asarray(jnp.where(jnp.asarray(sign) < 0, -1, 1))
    weights = [w._replace(orientation=sign * w.orientation) for w in FITS]
    stacked = jax.tree.map(lambda *w: jnp.asarray(w, dtype), *weights)
    C_yx = jax.lax.map(lambda w: solve(combine(x.fit, y.fit, w)).C_yx, stacked)
    return C_yx[:, :size, :size]


def sign_patterns(functions: int) -> np.ndarray:
    """Diagonal maps of all signs but that of the constant."""
    patterns = product((1, -1), repeat=functions - 1)
    return np.stack([np.diag((1, *pattern)) for pattern in patterns])


def flips(first: int, end: int) -> np.ndarray:
    """Rows of signs: none flipped, then each of `first` to `end` - 1."""
    rows = np.ones((1 + end - first, end))
    rows[np.arange(1, len(rows)), np.arange(first, end)] = -1
    return rows

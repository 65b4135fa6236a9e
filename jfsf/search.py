"""Find the initial functional map among many: symmetric shapes have many.

A map can be flipped left to right, front to back, or both, and every flip is nearly as
isometric as the right map. So: start from all sign patterns of the first eigenfunctions
and from descriptor fits, zoom each out on samples, flip the sign of one further
eigenfunction (where the front-to-back odd functions live), zoom again, and keep the
best that really differ. These few are refined on more samples before the last ranking.

How much descriptors should say beside eigenfunctions depends on the shapes: with half
weight a dog's legs are exchanged, with full weight a child's hands. So the starts try
both, and none, and what follows keeps to half, at which a right start stays right. The
idea of enumerating maps is MapTree's (Ren et al., SIGGRAPH Asia 2020); here they are
refined in groups, each one vmap.

The rank is the energy of a map, low for an isometry: it commutes with the Laplacian,
keeps areas, the descriptors and the bending of the surface. By all but the last a thin
body turned front to back is as good. None can tell left from right, so the orientation
score gates them.
"""

from functools import partial
from itertools import product
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jfsf.fit import Weights, fit
from jfsf.hypotheses import COMPARED, Samples, Seen
from jfsf.orientation import score
from jfsf.sampling import farthest_points
from jfsf.sides import both
from jfsf.types import Spectrum

Orientation = Literal["preserve", "reverse", "any"]

SIGNED = 5  # eigenfunctions whose signs are tried, the constant's fixed
FLIP_FROM, FLIP_TO = 6, 16  # eigenfunctions flipped one at a time
FIRST = (SIGNED, 7, 9, 12, FLIP_TO, 20)
SECOND = (FLIP_TO, 18, 21, 24, 28, 33, 40)
THIRD = (30, 30, 30, 40)
SAMPLES, FINAL_SAMPLES = 300, 1000
FIT_K = 30
FITS = (Weights(1.0, 0.1, 0.1, 0.1), Weights(1.0, 1.0, 1.0, 1.0))
EXTRA_WEIGHTS = (0.0, 0.5, 1.0)  # `zoomout`'s, of the starts: all signs with each
EXTRA_WEIGHT = 0.5  # of what follows
STARTS = len(EXTRA_WEIGHTS) * 2 ** (SIGNED - 1) + len(FITS)
FLIPS = 1 + FLIP_TO - FLIP_FROM
HYPOTHESES = 160  # 50 starts, and 10 of them as they are and with 10 flips each
APART = 0.04  # share of the leading block's energy in which two maps must differ
TURNED = 0.2  # energy of a map that keeps orientation on half of the shape only
WRONG_WAY = 100.0  # beyond any energy


class Candidates(NamedTuple):
    """Functional maps that really differ, the best first.

    C_yx: functions on Y pulled back to X.
    energy: departure from an isometry that keeps the descriptors; lower is better.
        Maps of the wrong orientation have `WRONG_WAY` added; a near copy of a better
        one has inf.
    orientation: score in [-1, 1]; nan for point clouds.
    """

    C_yx: Float[Array, "c k k"]
    energy: Float[Array, " c"]
    orientation: Float[Array, " c"]


def search(
    spec_x: Spectrum,
    spec_y: Spectrum,
    desc_x: Float[Array, "n_x d"],
    desc_y: Float[Array, "n_y d"],
    *,
    orientation: Orientation | Int[Array, ""] = "preserve",
    hypotheses: int = HYPOTHESES,
    num: int = 6,
    itself: Bool[Array, ""] | bool = False,
) -> Candidates:
    """The `num` best and different functional maps between two shapes.

    Args:
        spec_x, spec_y: spectra with 40 eigenpairs or more, faces wound outward.
        desc_x, desc_y: descriptors, positive (WKS, HKS); column i of one corresponds
            to column i of the other.
        orientation: which maps to put first; the others rank behind all of them. Or
            what `way_of` makes of it, which may be traced.
        hypotheses: how many maps to try at most, 61 or more; time grows with them.
        num: candidates to return.
        itself: X and Y are one shape, and with orientation "reverse" its symmetries
            are sought: a map costs energy as it resembles the identity, and
            descriptors and curvature, which draw every point to itself, only rank.

    Raises:
        ValueError: too few eigenpairs or hypotheses, or an unknown orientation.
    """
    check_search(spec_x, spec_y, hypotheses)
    way = way_of(orientation)
    return _search(
        spec_x, spec_y, desc_x, desc_y, way, itself, hypotheses=hypotheses, num=num
    )


def check_search(spec_x: Spectrum, spec_y: Spectrum, hypotheses: int) -> None:
    """ValueError where `search` cannot begin."""
    k = SECOND[-1]
    for name, spec in (("x", spec_x), ("y", spec_y)):
        if len(spec.evals) < k:
            raise ValueError(
                f"search: spec_{name} has {len(spec.evals)} eigenpairs, it needs {k}"
            )
    if hypotheses < STARTS + FLIPS:
        raise ValueError(
            f"search: hypotheses is {hypotheses}, the least is {STARTS + FLIPS}"
        )


def way_of(orientation: Orientation | Int[Array, ""]) -> Int[Array, ""] | int:
    """The sign that a map's orientation score should have; 0 for "any".

    Unlike a word it can be traced, so all orientations share one program.

    Args:
        orientation: a word, or a sign, which is returned.

    Raises:
        ValueError: an unknown orientation.
    """
    if not isinstance(orientation, str):
        return orientation
    ways = {"preserve": 1, "reverse": -1, "any": 0}
    if orientation not in ways:
        raise ValueError(
            f"search: orientation is 'preserve', 'reverse' or 'any', not "
            f"{orientation!r}"
        )
    return ways[orientation]


@partial(jax.jit, static_argnames=("hypotheses", "num"))
def _search(
    spec_x: Spectrum,
    spec_y: Spectrum,
    desc_x: Array,
    desc_y: Array,
    way: Array | int,
    itself: Array | bool,
    **options: int,
) -> Candidates:
    seen = both(
        lambda spec, desc: Seen.of(spec, desc, itself),
        (spec_x, desc_x),
        (spec_y, desc_y),
    )
    return search_seen(*seen, way, itself, **options)


def search_seen(
    seen_x: Seen,
    seen_y: Seen,
    way: Array | int,
    itself: Array | bool,
    *,
    hypotheses: int = HYPOTHESES,
    num: int = 6,
) -> Candidates:
    """`search` from what was made of the shapes before; way: what `way_of` gives."""
    spec_x, spec_y = seen_x.spec, seen_y.spec
    num_parents = min((hypotheses - STARTS) // FLIPS, STARTS)
    # With "any" the fields are 0 and say nothing.
    seen_x = seen_x._replace(field=way * seen_x.field)

    def sampled(seen):
        many = farthest_points(seen.spec, num=min(FINAL_SAMPLES, len(seen.spec.mass)))
        # Each point is the farthest from those before it: the first are a sample too.
        return [seen.at(many[:count]) for count in (SAMPLES, FINAL_SAMPLES)]

    samples = zip(*both(sampled, (seen_x,), (seen_y,)), strict=True)
    few, more = (Samples(x, y, itself) for x, y in samples)

    turned_by = jax.vmap(lambda C: score(C, seen_x.wound, seen_y.wound))

    def gated(energy: Array, C_yx: Array) -> tuple[Array, Array]:
        turned = jnp.asarray(turned_by(C_yx))
        # Point clouds have no score.
        asked = (way != 0) & ~jnp.isnan(turned)
        agrees = way * turned
        wrong = jnp.where(agrees < 0, WRONG_WAY, TURNED * (1 - agrees))
        return energy + jnp.where(asked, wrong, 0), turned

    dtype = spec_x.evecs.dtype
    sign = jnp.where(way < 0, -1, 1)
    terms = [w._replace(orientation=sign * w.orientation) for w in FITS]
    fitted = jax.lax.map(
        lambda w: fit(spec_x, spec_y, seen_x.desc, seen_y.desc, w, k=FIT_K).C_yx,
        jax.tree.map(lambda *w: jnp.asarray(w, dtype), *terms),
    )
    fitted = fitted[:, :FLIP_TO, :FLIP_TO].astype(dtype)
    signs, flips = jnp.asarray(_signs(), dtype), jnp.asarray(_flips(), dtype)
    weights = jnp.repeat(jnp.asarray(EXTRA_WEIGHTS, dtype), len(signs))
    # Descriptors mend a start that the eigenfunctions alone lead astray, and the other
    # way round.
    parents = jnp.concatenate(
        [
            few.zoom(jnp.tile(signs, (len(EXTRA_WEIGHTS), 1, 1)), FIRST, weights),
            few.zoom(fitted, FIRST[-2:], 1.0),
        ]
    )
    # Every other one is of full weight: by energy alone few would be.
    weights = jnp.pad(weights, (0, len(FITS)), constant_values=1)
    group = jnp.where(weights < 1, 1, 0)
    chosen = _different(parents, few.energy(parents), num_parents, group, groups=2)
    parents = parents[chosen]

    children = parents[:, None, :FLIP_TO, :FLIP_TO] * flips[None, :, None, :]
    children = few.zoom(children.reshape(-1, FLIP_TO, FLIP_TO), SECOND, EXTRA_WEIGHT)
    energy, _ = gated(few.energy(children), children)
    best = children[_different(children, energy, num)]

    last = more.zoom(best, THIRD, EXTRA_WEIGHT)
    energy, turned = gated(more.energy(last), last)
    # Two starts may have ended in one map: copies go last, or they would pass for
    # rivals.
    kept = jnp.zeros(num, bool).at[_different(last, energy, num)].set(True)
    energy = jnp.where(kept, energy, jnp.inf)
    order = jnp.argsort(energy)
    return Candidates(last[order], energy[order], turned[order])


def _different(C_yx, energy, num, group: Array | int = 0, groups=1):
    """Indices of the lowest energies, each apart from those before it in its group.

    They are taken from the groups in turn; group: in 0..groups - 1, of each map.
    """
    lead = C_yx[:, :COMPARED, :COMPARED].reshape(len(C_yx), -1)
    square = jnp.sum(lead**2, 1)
    gap = square[:, None] + square[None, :] - 2 * lead @ lead.T
    close = gap < 2 * COMPARED * APART

    def step(energy, turn):
        best = jnp.argmin(jnp.asarray(jnp.where(group == turn, energy, jnp.inf)))
        return jnp.where(close[best] & (group == turn), jnp.inf, energy), best

    return jax.lax.scan(step, energy, jnp.arange(num) % groups)[1]


def _signs() -> np.ndarray:
    patterns = product((1, -1), repeat=SIGNED - 1)
    return np.stack([np.diag((1, *pattern)) for pattern in patterns])


def _flips() -> np.ndarray:
    flips = np.ones((FLIPS, FLIP_TO))
    flips[np.arange(1, FLIPS), np.arange(FLIP_FROM, FLIP_TO)] = -1
    return flips

"""Find the initial functional map among many: symmetric shapes have many near-isometries.

A map can be flipped left to right, front to back, or both, and every flip is nearly as
smooth as the right map. So: start from all sign patterns of the first eigenfunctions and
from descriptor fits, zoom each out on samples, flip the signs of one or two further
eigenfunctions (where the front-to-back odd functions live), zoom again, and rank what
really differs. The idea of enumerating maps is MapTree's (Ren et al., SIGGRAPH Asia
2020); here a few hundred hypotheses are one vmap.

The rank is the energy of a map, low for an isometry: it commutes with the Laplacian and
keeps the descriptors. Energy cannot tell left from right, so the orientation score gates
it.
"""

from functools import partial
from itertools import combinations, product
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jfsf.fit import Weights, fit
from jfsf.fmap import embeddings
from jfsf.orientation import SEEN, brackets, score
from jfsf.refine.zoomout import zoomout
from jfsf.sampling import farthest_points, restrict
from jfsf.types import Maps, Spectrum

Orientation = Literal["preserve", "reverse", "any"]

SIGNED = 5  # eigenfunctions whose signs are tried, the constant's fixed
FLIP_FROM, FLIP_TO = 6, 16  # eigenfunctions flipped alone and in pairs
FIRST = (SIGNED, 7, 9, 12, FLIP_TO, 20)
SECOND = (FLIP_TO, 18, 21, 24, 28, 33, 40)
FIT_K = 30
FITS = (Weights(1.0, 0.1, 0.1, 0.1), Weights(1.0, 1.0, 1.0, 1.0))
PARENTS = 4
APART = 0.04  # share of the leading block's energy in which two maps must differ
COMPARED = 20  # size of that block
WRONG_WAY = 100.0  # beyond any energy


class Candidates(NamedTuple):
    """Functional maps that really differ, the best first.

    C_yx: functions on Y pulled back to X.
    energy: departure from an isometry that keeps the descriptors; lower is better.
    orientation: score in [-1, 1]; nan for point clouds.
    """

    C_yx: Float[Array, "c k k"]
    energy: Float[Array, " c"]
    orientation: Float[Array, " c"]


@partial(jax.jit, static_argnames=("orientation", "num_samples", "num"))
def search(
    spec_x: Spectrum,
    spec_y: Spectrum,
    desc_x: Float[Array, "n_x d"],
    desc_y: Float[Array, "n_y d"],
    *,
    orientation: Orientation = "preserve",
    num_samples: int = 300,
    num: int = 8,
) -> Candidates:
    """The `num` best and different functional maps between two shapes.

    Args:
        spec_x, spec_y: spectra with 40 eigenpairs or more, faces wound outward.
        desc_x, desc_y: descriptors, positive (WKS, HKS); column i of one corresponds
            to column i of the other.
        orientation: which maps to put first; the others rank behind all of them.
        num_samples: farthest-point samples a shape that hypotheses are tried on.
        num: candidates to return.

    Raises:
        ValueError: too few eigenpairs, or an unknown orientation.
    """
    k = SECOND[-1]
    for name, spec in (("x", spec_x), ("y", spec_y)):
        if len(spec.evals) < k:
            raise ValueError(
                f"search: spec_{name} has {len(spec.evals)} eigenpairs, it needs {k}"
            )
    if orientation not in ("preserve", "reverse", "any"):
        raise ValueError(
            f"search: orientation is 'preserve', 'reverse' or 'any', not "
            f"{orientation!r}"
        )
    at_x = farthest_points(spec_x, num=min(num_samples, len(spec_x.mass)))
    at_y = farthest_points(spec_y, num=min(num_samples, len(spec_y.mass)))
    few_x, few_y = restrict(spec_x, at_x), restrict(spec_y, at_y)
    seen_x, seen_y = brackets(spec_x, k=SEEN), brackets(spec_y, k=SEEN)
    sign = -1 if orientation == "reverse" else 1

    def zoom(C_yx, ks):
        grow = lambda C: zoomout(few_x, few_y, C, ks=ks, converter=_dense, both=True)
        return jax.vmap(grow)(C_yx)

    def rank(C_yx):
        energy = jax.lax.map(
            lambda C: _energy(C, few_x, few_y, desc_x[at_x], desc_y[at_y]), C_yx
        )
        turned = jax.vmap(score, (0, None, None))(C_yx, seen_x, seen_y)
        return energy, turned

    fits = [
        fit(spec_x, spec_y, desc_x, desc_y, w._replace(orientation=sign * w[3]), k=FIT_K)
        for w in FITS
    ]
    dtype = few_x.evecs.dtype
    fitted = jnp.stack([f.C_yx[:FLIP_TO, :FLIP_TO] for f in fits]).astype(dtype)
    parents = jnp.concatenate(
        [zoom(jnp.asarray(_signs(), dtype), FIRST), zoom(fitted, FIRST[-2:])]
    )
    parents = parents[_different(parents, rank(parents)[0], PARENTS)]

    flips = jnp.asarray(_flips(), dtype)
    children = parents[:, None, :FLIP_TO, :FLIP_TO] * flips[None, :, None, :]
    children = zoom(children.reshape(-1, FLIP_TO, FLIP_TO), SECOND)
    energy, turned = rank(children)
    if orientation != "any":
        energy = jnp.where(sign * turned < 0, energy + WRONG_WAY, energy)
    best = _different(children, energy, num)
    return Candidates(children[best], energy[best], turned[best])


def _energy(C_yx, spec_x, spec_y, desc_x, desc_y):
    k = len(C_yx)
    gap = spec_x.evals[:k, None] - spec_y.evals[None, :k]
    top = jnp.maximum(spec_x.evals[k - 1], spec_y.evals[k - 1])
    commute = jnp.linalg.norm(gap * C_yx) / (jnp.linalg.norm(C_yx) * top)
    maps = _dense(*embeddings(C_yx, spec_x.evecs, spec_y.evecs, space="direct"))
    lost_x = _mismatch(desc_x, desc_y[maps.T_xy], spec_x.mass)
    lost_y = _mismatch(desc_y, desc_x[maps.T_yx], spec_y.mass)
    return commute + lost_x + lost_y


def _mismatch(one, other, mass):
    size = jnp.maximum(one + other, jnp.finfo(one.dtype).tiny)
    return jnp.sum(mass[:, None] * jnp.abs(one - other) / size) / one.shape[1]


def _different(C_yx, energy, num):
    """Indices of the lowest energies, each apart from those before it."""
    lead = C_yx[:, :COMPARED, :COMPARED].reshape(len(C_yx), -1)
    square = jnp.sum(lead**2, 1)
    gap = square[:, None] + square[None, :] - 2 * lead @ lead.T
    close = gap < 2 * COMPARED * APART

    def step(energy, _):
        best = jnp.argmin(energy)
        return jnp.where(close[best], jnp.inf, energy), best

    return jax.lax.scan(step, energy, None, length=num)[1]


def _dense(emb_x, emb_y, *_) -> Maps:
    """Nearest neighbour both ways from one product: for a few hundred samples only."""
    product = emb_x @ emb_y.T
    half_x, half_y = jnp.sum(emb_x**2, 1) / 2, jnp.sum(emb_y**2, 1) / 2
    # top_k is faster than argmax on CPU.
    T_xy = jax.lax.top_k(product - half_y[None, :], 1)[1][:, 0]
    T_yx = jax.lax.top_k(product.T - half_x[None, :], 1)[1][:, 0]
    return Maps(T_xy, T_yx)


def _signs() -> np.ndarray:
    patterns = product((1, -1), repeat=SIGNED - 1)
    return np.stack([np.diag((1, *pattern)) for pattern in patterns])


def _flips() -> np.ndarray:
    where = range(FLIP_FROM, FLIP_TO)
    chosen = [(), *((i,) for i in where), *combinations(where, 2)]
    flips = np.ones((len(chosen), FLIP_TO))
    for row, columns in zip(flips, chosen, strict=True):
        row[list(columns)] = -1
    return flips

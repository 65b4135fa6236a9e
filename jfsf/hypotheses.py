"""Hypotheses on samples of two shapes: zoom them out, and weigh what comes out."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jfsf.descriptors import curvature, standardise
from jfsf.fmap import embeddings
from jfsf.knn import leader
from jfsf.orientation import bracket_fields
from jfsf.refine.zoomout import zoomout
from jfsf.sampling import restrict
from jfsf.types import Maps, Spectrum

BENT = 1.5  # weight of curvature beside descriptors, in the embeddings
BENT_ENERGY = 0.125  # energy of curvatures that differ by one standard deviation
HELD = 1 << 20  # entries of products of two samples at a time: they stay in cache
COMPARED = 20  # size of the block in which maps are compared


@jax.jit
def appearance(spec: Spectrum, desc: Float[Array, "n d"]) -> Float[Array, "n e"]:
    """Columns that tell points apart beside eigenfunctions: descriptors, curvature.

    Each is standardised over the shape; curvature then weighs `BENT`.
    """
    bent = BENT * standardise(curvature(spec), spec.mass)
    return jnp.concatenate([standardise(desc, spec.mass), bent], 1)


class Seen(NamedTuple):
    """A shape and what tells its points apart.

    desc, bent: descriptors; curvature, standardised. They weigh a map.
    extra: `appearance`, which is 0 for the symmetries of a shape.
    field: `orientation.bracket_fields`, negated for maps that mirror.
    """

    spec: Spectrum
    desc: Float[Array, "n d"]
    bent: Float[Array, "n b"]
    extra: Float[Array, "n e"]
    field: Float[Array, "n k k"]

    @classmethod
    def of(cls, spec: Spectrum, desc, itself):
        extra = jnp.asarray(appearance(spec, desc))
        bent = extra[:, desc.shape[1] :] / BENT
        return cls(spec, desc, bent, jnp.where(itself, 0, extra), bracket_fields(spec))

    def at(self, chosen: Int[Array, " s"]) -> "Seen":
        """From these vertices alone."""
        return Seen(restrict(self.spec, chosen), *(a[chosen] for a in self[1:]))


class Samples(NamedTuple):
    """Two shapes seen from samples, and what is done with hypotheses there."""

    x: Seen
    y: Seen
    itself: Array | bool

    def zoom(self, C_yx, ks, extra_weight):
        """Each of C_yx from ks[0] to ks[-1]; extra_weight: `zoomout`'s, or one each."""
        x, y, _ = self
        extra = (x.extra, y.extra, x.field, y.field)
        grow = lambda C, weight: zoomout(
            x.spec,
            y.spec,
            C,
            *extra,
            ks=ks,
            converter=_dense,
            weighted=True,
            both=True,
            extra_weight=weight,
        )
        count = len(C_yx)
        most = max(HELD // (len(x.spec.mass) * len(y.spec.mass)), 1)
        together = max(n for n in range(1, most + 1) if count % n == 0)
        weights = jnp.broadcast_to(extra_weight, count)
        return jax.lax.map(lambda a: grow(*a), (C_yx, weights), batch_size=together)

    def energy(self, C_yx):
        x, y, itself = self
        size = min(COMPARED, C_yx.shape[-1])
        kept = jnp.trace(C_yx[:, 1:size, 1:size], axis1=1, axis2=2) / (size - 1)
        energy = jax.lax.map(lambda C: _energy(C, x, y), C_yx)
        return energy + jnp.where(itself, kept, 0)


def _energy(C_yx, x: Seen, y: Seen):
    k, spec_x, spec_y = len(C_yx), x.spec, y.spec
    gap = spec_x.evals[:k, None] - spec_y.evals[None, :k]
    top = jnp.maximum(spec_x.evals[k - 1], spec_y.evals[k - 1])
    commute = jnp.linalg.norm(gap * C_yx) / (jnp.linalg.norm(C_yx) * top)
    maps = _dense(*embeddings(C_yx, spec_x.evecs, spec_y.evecs, space="direct"))
    stretch = jnp.linalg.norm(C_yx.T @ C_yx - jnp.eye(k, dtype=C_yx.dtype))
    lost_x = _mismatch(x.desc, y.desc[maps.T_xy], spec_x.mass)
    lost_y = _mismatch(y.desc, x.desc[maps.T_yx], spec_y.mass)
    bent = _differ(x.bent, y.bent[maps.T_xy], spec_x.mass)
    bent += _differ(y.bent, x.bent[maps.T_yx], spec_y.mass)
    return commute + stretch / (2 * jnp.sqrt(k)) + lost_x + lost_y + BENT_ENERGY * bent


def _differ(one, other, mass):
    return mass @ jnp.sum((one - other) ** 2, 1) / one.shape[1]


def _mismatch(one, other, mass):
    size = jnp.maximum(one + other, jnp.finfo(one.dtype).tiny)
    return jnp.sum(mass[:, None] * jnp.abs(one - other) / size) / one.shape[1]


def _dense(emb_x, emb_y, *_) -> Maps:
    """Nearest neighbour both ways from one product: for a few hundred samples only."""
    # Samples are far apart: float32 tells them apart.
    emb_x, emb_y = emb_x.astype(jnp.float32), emb_y.astype(jnp.float32)
    product = jnp.matmul(emb_x, emb_y.T, precision=jax.lax.Precision.HIGHEST)
    half_x, half_y = jnp.sum(emb_x**2, 1) / 2, jnp.sum(emb_y**2, 1) / 2
    T_xy = leader(product - half_y[None, :], 1)
    return Maps(T_xy, leader(product - half_x[:, None], 0))

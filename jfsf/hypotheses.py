"""Hypotheses on samples of two shapes: zoom them out, and weigh what comes out."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jfsf.descriptors import curvature, standardise
from jfsf.fmap import embeddings
from jfsf.largest import leader
from jfsf.orientation import SEEN, at_vertices, brackets
from jfsf.refine.zoomout import zoomout
from jfsf.sampling import restrict
from jfsf.sides import both
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
    wound: `orientation.brackets`.
    field: the same at each vertex, negated for maps that mirror.
    """

    spec: Spectrum
    desc: Float[Array, "n d"]
    bent: Float[Array, "n b"]
    extra: Float[Array, "n e"]
    wound: Float[Array, "k k k"]
    field: Float[Array, "n k k"]

    @classmethod
    def of(cls, spec: Spectrum, desc, itself):
        extra = jnp.asarray(appearance(spec, desc))
        bent = extra[:, desc.shape[1] :] / BENT
        wound = brackets(spec, k=SEEN)
        field = at_vertices(spec, wound)
        return cls(spec, desc, bent, jnp.where(itself, 0, extra), wound, field)

    def at(self, chosen: Int[Array, " s"]) -> "Seen":
        """From these vertices alone."""
        return Seen(
            restrict(self.spec, chosen),
            self.desc[chosen],
            self.bent[chosen],
            self.extra[chosen],
            self.wound,
            self.field[chosen],
        )


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
    lost_x, lost_y = both(_lost, (x, y, maps.T_xy), (y, x, maps.T_yx))
    return commute + stretch / (2 * jnp.sqrt(k)) + lost_x + lost_y


def _lost(x: Seen, y: Seen, T_xy):
    """How much descriptors and curvature differ under a map."""
    other = y.desc[T_xy]
    size = jnp.maximum(x.desc + other, jnp.finfo(other.dtype).tiny)
    mismatch = jnp.mean(jnp.abs(x.desc - other) / size, 1)
    bent = jnp.mean((x.bent - y.bent[T_xy]) ** 2, 1)
    return x.spec.mass @ (mismatch + BENT_ENERGY * bent)


def _dense(emb_x, emb_y, *_) -> Maps:
    """Nearest neighbour both ways from one product: for a few hundred samples only."""
    # Samples are far apart: float32 tells them apart.
    emb_x, emb_y = emb_x.astype(jnp.float32), emb_y.astype(jnp.float32)
    product = jnp.matmul(emb_x, emb_y.T, precision=jax.lax.Precision.HIGHEST)
    half_x, half_y = jnp.sum(emb_x**2, 1) / 2, jnp.sum(emb_y**2, 1) / 2
    T_xy = leader(product - half_y[None, :], 1)
    return Maps(T_xy, leader(product - half_x[:, None], 0))

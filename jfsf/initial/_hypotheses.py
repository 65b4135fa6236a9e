"""Hypotheses on samples of two shapes: refine functional maps, and rank them.

The rank is the energy of a map, low for an isometry: how far the map is from commuting
with the Laplacians and from keeping areas, descriptors and curvature.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jfsf.array import argmax, matmul
from jfsf.array._loops import map_sides, varying_as
from jfsf.refine import zoomout
from jfsf.spectral import Features, embeddings
from jfsf.types import Maps

# Leading rows and columns of a functional map in which two are compared, and the share
# of that block's energy in which two candidates must differ.
COMPARED = 20
MIN_DIFFERENCE = 0.04
# Energy of curvatures that differ by one standard deviation.
CURVATURE_ENERGY = 0.125
# Entries of all products of two samples that are in work at a time: they stay in the
# cache.
CACHED_ENTRIES = 1 << 20


class SamplePair(NamedTuple):
    """Two shapes at samples, and whether they are one shape (traced)."""

    x: Features
    y: Features
    self_map: Bool[Array, ""] | bool


def refine_hypotheses(
    pair: SamplePair,
    C_yx: Float[Array, "c k k"],
    extra_weight: Float[Array, " c"] | float,
    *,
    ks: tuple[int, ...],
) -> Float[Array, "c l l"]:
    """ZoomOut of each functional map from ks[0] to ks[-1].

    Args:
        pair: the samples.
        C_yx: functions on Y pulled back to X, of ks[0] functions or more.
        extra_weight: of the columns beside the eigenfunctions; one each, or one.
        ks: sizes of the basis.
    """
    x, y, _ = pair
    fields = x.bracket_fields, y.bracket_fields

    def refine(C, weight):
        return zoomout(
            x.spec,
            y.spec,
            C,
            x.columns,
            y.columns,
            *fields,
            ks=ks,
            converter=dense_nearest,
            weighted=True,
            bidirectional=True,
            extra_weight=weight,
        )

    count = len(C_yx)
    most = max(CACHED_ENTRIES // (len(x.spec.mass) * len(y.spec.mass)), 1)
    batch_size = max(n for n in range(1, most + 1) if count % n == 0)
    weights = jnp.broadcast_to(extra_weight, count)
    return jax.lax.map(lambda a: refine(*a), (C_yx, weights), batch_size=batch_size)


def energies(
    pair: SamplePair,
    C_yx: Float[Array, "c k k"],
    *,
    compared: int = COMPARED,
    curvature_energy: float = CURVATURE_ENERGY,
) -> Float[Array, " c"]:
    """Departure of each map from an isometry that keeps descriptors and curvature.

    E(C) = |L_x C - C L_y| / (|C| l) + |C^T C - I| / (2 sqrt(k)) + M_xy + M_yx + S

    Norms are Frobenius, C is (k, k), L_x and L_y are diagonal: the first k eigenvalues;
    l is the largest of them. With T_xy the nearest neighbours of Phi_X in Phi_Y C^T,
    a_i the mass of a sample, p and q its d descriptors and h its c curvatures,

        M_xy = sum_i a_i (1/d sum_e |p_ie - q_je| / (|p_ie| + |q_je|)
                          + w/c sum_e (h_ie - h_je)^2),  j = T_xy[i],

    w = `curvature_energy`; 0 / 0 counts as 0. M_yx is the same the other way. S is 0
    but for a self map: it costs as it resembles the identity, S = trace(C') / (m - 1),
    C' being rows and columns 1 to m - 1 of C, m = min(`compared`, k).

    Args:
        pair: the samples; padding has mass 0 and is a copy of another sample.
        C_yx: functions on Y pulled back to X.
        compared: leading rows and columns that are compared with the identity.
        curvature_energy: of curvatures that differ by one standard deviation.
    """
    x, y, self_map = pair
    size = min(compared, C_yx.shape[-1])
    identity = jnp.trace(C_yx[:, 1:size, 1:size], axis1=1, axis2=2) / (size - 1)
    energy = jax.lax.map(lambda C: _energy(C, x, y, curvature_energy), C_yx)
    return energy + jnp.where(self_map, identity, 0)


def _energy(C_yx, x: Features, y: Features, curvature_energy: float):
    k, spec_x, spec_y = len(C_yx), x.spec, y.spec
    gap = spec_x.evals[:k, None] - spec_y.evals[None, :k]
    top = jnp.maximum(spec_x.evals[k - 1], spec_y.evals[k - 1])
    commute = jnp.linalg.norm(gap * C_yx) / (jnp.linalg.norm(C_yx) * top)
    maps = dense_nearest(*embeddings(C_yx, spec_x.evecs, spec_y.evecs, space="direct"))
    gram = matmul(C_yx.T, C_yx)
    stretch = jnp.linalg.norm(gram - jnp.eye(k, dtype=C_yx.dtype))
    mismatch_x, mismatch_y = map_sides(
        partial(_mismatch, curvature_energy=curvature_energy),
        (x, y, maps.T_xy),
        (y, x, maps.T_yx),
    )
    return commute + stretch / (2 * jnp.sqrt(k)) + mismatch_x + mismatch_y


def _mismatch(x: Features, y: Features, T_xy, curvature_energy: float):
    """By how much descriptors and curvature differ under a map, over the area of X."""
    other = y.descriptors[T_xy]
    size = jnp.abs(x.descriptors) + jnp.abs(other)
    size = jnp.maximum(size, jnp.finfo(other.dtype).tiny)
    mismatch = jnp.mean(jnp.abs(x.descriptors - other) / size, 1)
    curvature = jnp.mean((x.curvature - y.curvature[T_xy]) ** 2, 1)
    return matmul(x.spec.mass, mismatch + curvature_energy * curvature)


def dense_nearest(emb_x, emb_y, *_) -> Maps:
    """Nearest neighbour both ways from one product: for a few hundred samples only."""
    # Samples are far apart, so float32 is enough.
    emb_x, emb_y = emb_x.astype(jnp.float32), emb_y.astype(jnp.float32)
    product = matmul(emb_x, emb_y.T)
    half_x, half_y = jnp.sum(emb_x**2, 1) / 2, jnp.sum(emb_y**2, 1) / 2
    T_xy = argmax(product - half_y[None, :], 1)
    return Maps(T_xy, argmax(product - half_x[:, None], 0))


def best_different(
    C_yx: Float[Array, "c k k"],
    energy: Float[Array, " c"],
    num: int,
    group: Int[Array, " c"] | int = 0,
    groups: int = 1,
    *,
    compared: int = COMPARED,
    min_difference: float = MIN_DIFFERENCE,
) -> tuple[Int[Array, " num"], Bool[Array, " num"]]:
    """Indices of `num` lowest energies, each different from those before in its group.

    Args:
        C_yx, energy: of each candidate.
        num: how many.
        group: in 0..groups - 1, of each candidate. Indices are taken from the groups
            in turn.
        groups: how many groups there are.
        compared: leading rows and columns in which two maps are compared.
        min_difference: share of that block's energy in which two must differ.

    Returns:
        The indices, and whether each differs: 0 and False where none is left.
    """
    size = compared
    lead = C_yx[:, :size, :size].reshape(len(C_yx), -1)
    square = jnp.sum(lead**2, 1)
    gap = square[:, None] + square[None, :] - 2 * matmul(lead, lead.T)
    close = gap < 2 * size * min_difference

    def step(energy, turn):
        left = jnp.asarray(jnp.where(group == turn, energy, jnp.inf))
        best = jnp.argmin(left)
        energy = jnp.where(close[best] & (group == turn), jnp.inf, energy)
        return energy, (best, jnp.isfinite(left[best]))

    energy = varying_as(energy, C_yx, group)
    return jax.lax.scan(step, energy, jnp.arange(num) % groups)[1]

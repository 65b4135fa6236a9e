"""Evidence for a map that is known to be right, and for one that is not."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from jfsf import testing
from jfsf.convert import nearest, sinkhorn
from jfsf.evidence import certify, confidence
from jfsf.runtime import pad
from jfsf.spectral import embeddings, functional_map, uniform
from jfsf.types import Aligned, Maps

N, K = 162, 30
SPEC = testing.blob_spectrum(0, K)
filtered = partial(sinkhorn, k0=8, num_iters=10)


@jax.jit
def evidence(spec_x, spec_y, C_yx):
    emb_x, emb_y = embeddings(C_yx, spec_x.evecs, spec_y.evecs, space="direct")
    found = filtered(emb_x, emb_y, uniform(spec_x.mass), uniform(spec_y.mass))
    C = functional_map(found.T_xy, spec_x, spec_y)
    return certify(found, Aligned(emb_x, emb_y), C, (spec_x, spec_y))


def test_the_identity_is_perfect():
    found = evidence(SPEC, SPEC, jnp.eye(K))
    assert found.finite and found.empty == 0
    ones = found.coverage_xy, found.coverage_yx, found.orientation, found.nn_agreement
    assert found.recall == 1  # all points were compared
    zeros = found.bijectivity_x, found.bijectivity_y, found.orthogonality
    assert np.allclose(ones, 1, atol=1e-8) and np.allclose(zeros, 0, atol=1e-8)
    assert np.isnan(found.gap)  # no search began it


def test_a_random_map_is_not():
    C = np.linalg.qr(np.random.default_rng(0).normal(size=(K, K)))[0]
    found = evidence(SPEC, SPEC, jnp.asarray(C))
    assert found.finite and found.coverage_xy < 0.95 and abs(found.orientation) < 0.6
    assert found.bijectivity_x > 0.02


def test_nan_is_reported():
    assert not evidence(SPEC, SPEC, jnp.eye(K).at[3, 3].set(jnp.nan)).finite


def test_padding_is_invisible():
    rng = np.random.default_rng(0)
    C = jnp.eye(K) + 0.1 * jnp.asarray(rng.normal(size=(K, K)))
    other = testing.blob_spectrum(1, K)
    plain = evidence(SPEC, other, C)
    padded = evidence(pad(SPEC, N + 5, 330), pad(other, N + 9, 340), C)
    for ours, theirs in zip(padded, plain, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-8)


def test_coverage_is_judged_by_what_few_vertices_can_hit():
    k, small = 20, testing.blob_spectrum(0, 20, 1)
    large = testing.blob_spectrum(0, 20, 2)  # its first 42 vertices are those of small
    there, back = jnp.arange(42), jnp.arange(162) % 42
    given = Aligned(small.evecs, large.evecs), jnp.eye(k), (small, large)
    found = certify(Maps(there, back), *given)
    hit = large.mass[:42].sum() / large.mass.sum()
    assert hit < 0.5
    np.testing.assert_allclose(found.coverage_xy, min(hit * 162 / 42, 1), rtol=1e-6)
    np.testing.assert_allclose(found.coverage_yx, 1, rtol=1e-6)
    # A map that has collapsed still covers little.
    found = certify(Maps(0 * there, back), *given)
    assert found.coverage_xy < 0.1


def test_agreement_counts_what_nearest_neighbour_says():
    C = jnp.eye(K) + 0.1 * jnp.asarray(np.random.default_rng(1).normal(size=(K, K)))
    other = testing.blob_spectrum(1, K)
    emb_x, emb_y = embeddings(C, SPEC.evecs, other.evecs, space="direct")
    marginals = uniform(SPEC.mass), uniform(other.mass)
    share = jnp.mean(
        nearest(emb_x, emb_y).T_xy == filtered(emb_x, emb_y, *marginals).T_xy
    )
    assert np.isclose(evidence(SPEC, other, C).nn_agreement, share)


def test_confidence_follows_the_evidence():
    right, wrong = confidence(jnp.asarray([0.95, 0.3]), 0.5, jnp.asarray([0.5, 0.9]))
    assert right > 0.9 and wrong < 0.1
    values = jnp.linspace(0.3, 1, 8)
    assert np.all(np.diff(confidence(values, 0.6, 0.6)) > 0)
    assert np.all(np.diff(confidence(0.9, values, 0.6)) < 0)
    assert np.all(np.diff(confidence(0.9, 0.6, values)) < 0)


def test_confidence_without_evidence():
    assert 0 < confidence(jnp.nan, 0.5, 0.5) < 1  # a point cloud
    assert np.isnan(confidence(0.9, jnp.nan, 0.5))
    values = jnp.linspace(0.1, 0.9, 9)
    bent = partial(confidence, energy=jnp.nan, log_stretch_std=0.55)
    assert np.all(np.diff(bent(0.9, residual=values / 100)) < 0)
    assert np.all(np.diff(bent(values, residual=0.003)) > 0)
    assert bent(0.95, residual=0.001) > 0.9 > 0.1 > bent(0.5, residual=0.02)
    found = evidence(SPEC, SPEC, jnp.eye(K))  # without samples
    assert np.isnan(found.confidence) and np.isnan(found.log_stretch_std)

"""Evidence for a map that is known to be right, and for one that is not."""

import json
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from jfsf import testing
from jfsf._figures import FIGURES
from jfsf.convert import nearest, sinkhorn
from jfsf.matching import confidence
from jfsf.matching._certificate import Bending, certify
from jfsf.matching._confidence import log_odds
from jfsf.runtime._sizes import pad
from jfsf.spectral import embeddings, functional_map, uniform
from jfsf.types import Aligned, Certificate, Maps

N, K = 162, 30
SPEC = testing.blob_spectrum(0, K)
filtered = partial(sinkhorn, k0=8, num_iters=10)


@jax.jit
def evidence(spec_x, spec_y, C_yx):
    emb_x, emb_y = embeddings(C_yx, spec_x.evecs, spec_y.evecs, space="direct")
    found = filtered(emb_x, emb_y, uniform(spec_x.mass), uniform(spec_y.mass))
    C = functional_map(found.T_xy, spec_x, spec_y)
    return certify(found, Aligned(emb_x, emb_y), C, (spec_x, spec_y))


def test_every_figure_is_in_the_table_and_explained():
    assert [*FIGURES, "landmarks"] == [*Certificate._fields]
    assert [*Certificate.__annotations__] == [*Certificate._fields]
    said = Certificate.__doc__ or ""
    for name, figure in FIGURES.items():
        assert f"    {name}: {figure.meaning[:20]}" in said
        # It stands alone, in a table as in an editor.
        assert not figure.meaning.endswith(".") and "likewise" not in said
    nothing = Certificate.unknown(np.float32)
    for name, value in nothing.figures().items():
        assert bool(FIGURES[name].unknown) <= bool(np.isnan(value))
        own = getattr(nothing, name).dtype
        assert (own == np.float32) == (name not in ("empty", "finite"))
        assert type(value) is {"empty": int, "finite": bool}.get(name, float)
    assert nothing.finite and nothing.empty == 0 and len(nothing.landmarks) == 0


def test_the_figures_are_plain_on_the_host_and_arrays_elsewhere():
    one = Certificate.unknown()._replace(confidence=jnp.asarray(0.5), empty=np.int32(3))
    told = json.loads(json.dumps(one.figures()))
    assert (told["confidence"], told["empty"], told["finite"]) == (0.5, 3, True)
    many = jax.tree.map(lambda field: jnp.stack([field, field]), one)
    assert many.figures()["confidence"].shape == (2,)
    doubled = lambda given: 2 * given.figures()["confidence"]
    assert jax.jit(doubled)(one) == 1
    assert jax.vmap(doubled)(many).tolist() == [1, 1]


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


@jax.jit
def bent_evidence(moved_x, moved_y, spec_x, spec_y, sign, landmarks=None):
    maps = Maps(jnp.arange(N), jnp.arange(N))
    emb = jnp.zeros((N, 1))
    C = functional_map(maps.T_xy, spec_x, spec_y)
    aligned = Aligned(emb, emb, moved_x, moved_y)
    return certify(maps, aligned, C, (spec_x, spec_y), None, sign, landmarks)


def test_the_confidence_is_read_from_the_bent_shapes():
    points = SPEC.vertices
    found = bent_evidence(points, points, SPEC, SPEC, 1)
    noise = 0.1 * jnp.asarray(np.random.default_rng(0).normal(size=(N, 3)))
    worse = bent_evidence(points + noise, points - noise, SPEC, SPEC, 1)
    for name in Bending._fields:
        assert getattr(found, name) < getattr(worse, name)
    for one in (found, worse):
        figures = one.figures()
        np.testing.assert_allclose(one.log_odds, log_odds(**figures), rtol=1e-9)
        np.testing.assert_allclose(one.confidence, confidence(one.log_odds), rtol=1e-9)
        assert np.isnan(one.share)  # nothing was compared
    assert worse.confidence < found.confidence


def test_the_orientation_that_is_asked_for_counts():
    points = SPEC.vertices
    kept, swapped, any_ = (
        bent_evidence(points, points, SPEC, SPEC, sign) for sign in (1, -1, 0)
    )
    assert kept.orientation == swapped.orientation == any_.orientation > 0.9
    assert swapped.log_odds < kept.log_odds == any_.log_odds
    # Which is wanted is not known, unless a landmark says it.
    np.testing.assert_allclose(any_.confidence, kept.confidence / 2)
    at = jnp.asarray([3])
    told = bent_evidence(points, points, SPEC, SPEC, 0, (at, at))
    np.testing.assert_allclose(told.confidence, kept.confidence)
    far = jnp.argmax(jnp.sum((points - points[3:4]) ** 2, 1))[None]
    missed = bent_evidence(points, points, SPEC, SPEC, 1, (at, far))
    assert missed.log_odds == kept.log_odds and missed.confidence < kept.confidence


def test_there_is_no_confidence_without_bent_surfaces():
    found = evidence(SPEC, SPEC, jnp.eye(K))  # not bent
    unknown = found.log_odds, found.share, found.confidence, found.log_stretch_std
    assert np.isnan(
        [*unknown, *(getattr(found, name) for name in Bending._fields)]
    ).all()
    cloud = SPEC._replace(faces=SPEC.faces[:0])
    found = bent_evidence(SPEC.vertices, SPEC.vertices, SPEC, cloud, 1)
    assert np.isnan([found.shear, found.log_odds, found.confidence]).all()

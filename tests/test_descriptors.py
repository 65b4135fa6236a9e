"""WKS and HKS against pyFM, and what must not change them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapes import bumpy

from jfsf.runtime._sizes import pad
from jfsf.spectral import FeatureSettings, features, hks, spectrum, wks
from jfsf.spectral._descriptors import standardise
from jfsf.testing import cast

K = 40
SPOTS = jnp.array([3, 100, 41])
both_signatures = pytest.mark.parametrize("signature", [wks, hks])


SPEC = cast(spectrum(bumpy(), K, cache=False))


@both_signatures
@pytest.mark.parametrize("num", [1, 20, 400])
@pytest.mark.parametrize("landmarks", [None, SPOTS])
def test_pyfm_agrees(signature, num, landmarks):
    reference = pytest.importorskip("pyFM.signatures")
    auto = reference.auto_WKS if signature is wks else reference.auto_HKS
    spots = None if landmarks is None else np.asarray(landmarks)
    evals, evecs = np.asarray(SPEC.evals), np.asarray(SPEC.evecs)
    theirs = auto(evals, evecs, num, landmarks=spots)
    if signature is hks:
        # Their times run from short to long.
        theirs = theirs.reshape(len(evecs), -1, num)[:, :, ::-1].reshape(theirs.shape)
        if num == 1:
            return  # of one time, they take the shortest and we the longest
    ours = signature(SPEC, landmarks, num=num)
    assert ours.shape == theirs.shape
    assert np.allclose(ours, theirs, rtol=1e-8, atol=1e-8)


@both_signatures
@given(seed=st.integers(0, 10**6))
def test_signs_change_nothing(signature, seed):
    signs = jnp.asarray(np.random.default_rng(seed).choice([-1.0, 1.0], K))
    other = SPEC._replace(evecs=SPEC.evecs * signs[None])
    for spots in (None, SPOTS):
        assert jnp.allclose(signature(other, spots), signature(SPEC, spots))


@both_signatures
def test_units_change_nothing(signature):
    mesh = bumpy()._replace(vertices=1000 * bumpy().vertices)
    other = cast(spectrum(mesh, K, cache=False))
    assert jnp.allclose(signature(other, SPOTS), signature(SPEC, SPOTS), rtol=1e-6)


@both_signatures
def test_padding_is_invisible(signature):
    for spots in (None, SPOTS):
        plain, padded = (
            signature(s, spots, num=20) for s in (SPEC, pad(SPEC, 166, 324))
        )
        assert jnp.allclose(padded[:162], plain)
        assert not padded[162:].any()


@both_signatures
@given(seed=st.integers(0, 10**6))
def test_relabelling_relabels(signature, seed):
    order = np.random.default_rng(seed).permutation(162)
    other = SPEC._replace(evecs=SPEC.evecs[order])
    place = jnp.asarray(np.argsort(order))
    assert jnp.allclose(signature(other, num=20), signature(SPEC, num=20)[order])
    seen = signature(other, place[SPOTS], num=20)
    assert jnp.allclose(seen, signature(SPEC, SPOTS, num=20)[order])


@both_signatures
def test_columns_have_mean_one(signature):
    # The mean of phi_i^2 is 1, and so is the sum of the weights.
    assert jnp.allclose(SPEC.mass @ signature(SPEC), 1)


@both_signatures
def test_a_landmark_sees_itself_as_the_global_signature_does(signature):
    seen = signature(SPEC, SPOTS, num=20).reshape(162, 3, 20)
    own = signature(SPEC, num=20)
    assert jnp.allclose(seen[SPOTS, jnp.arange(3)], own[SPOTS])


@both_signatures
def test_vmap_equals_the_loop(signature):
    specs = [cast(spectrum(bumpy(seed), K, cache=False)) for seed in (1, 2)]
    spots = jnp.stack([SPOTS, SPOTS + 1])
    stacked = jax.tree.map(lambda *a: jnp.stack(a), *specs)
    batch = jax.vmap(lambda s, l: signature(s, l, num=20))(stacked, spots)
    for i in range(2):
        assert jnp.allclose(batch[i], signature(specs[i], spots[i], num=20))


@both_signatures
@pytest.mark.parametrize("spots", [None, SPOTS])
def test_gradients_are_right(signature, spots):
    def value(evals, evecs):
        out = signature(SPEC._replace(evals=evals, evecs=evecs), spots, num=30)
        return jnp.sum(jnp.sin(out))

    slopes = jax.grad(value, (0, 1))(SPEC.evals, SPEC.evecs)
    rng = np.random.default_rng(0)
    steps = [jnp.asarray(rng.normal(size=s.shape)) for s in slopes]
    steps[0] = steps[0].at[0].set(0)  # the constant's eigenvalue is clipped
    h = 1e-6
    ahead = value(SPEC.evals + h * steps[0], SPEC.evecs + h * steps[1])
    behind = value(SPEC.evals - h * steps[0], SPEC.evecs - h * steps[1])
    exact = sum(jnp.sum(a * b) for a, b in zip(slopes, steps, strict=True))
    assert np.isclose((ahead - behind) / (2 * h), exact, rtol=1e-5)


@both_signatures
@pytest.mark.parametrize("num", [100, 2000])
@pytest.mark.parametrize("spots", [None, SPOTS])
def test_float32(signature, num, spots):
    # 2000 narrow bands: every Gaussian weight of some would underflow.
    out = signature(cast(SPEC, jnp.float32), spots, num=num)
    assert out.dtype == jnp.float32
    exact = np.asarray(signature(SPEC, spots, num=num))
    assert np.isfinite(out).all()
    assert np.abs(np.asarray(out) - exact).max() < 2e-3 * np.abs(exact).max()


@both_signatures
def test_equal_eigenvalues_stay_finite(signature):
    flat = SPEC._replace(evals=jnp.full(K, 25.0).at[0].set(0))
    assert jnp.isfinite(signature(flat)).all()


@both_signatures
def test_errors(signature):
    name = signature.__name__
    with pytest.raises(ValueError, match=f"{name}: num is 0"):
        signature(SPEC, num=0)
    short = SPEC._replace(evals=SPEC.evals[:2], evecs=SPEC.evecs[:, :2])
    with pytest.raises(ValueError, match=f"{name}: needs 3 eigenpairs or more, got 2"):
        signature(short)


def test_constant_columns_are_zero_and_have_slopes():
    mass = SPEC.mass.astype(jnp.float32)
    values = jnp.array([0.0, 0.1, 1.0, 7.7, 333.3], jnp.float32)
    constant = jnp.broadcast_to(values, (len(mass), 5))
    assert not np.any(standardise(constant, mass))
    slope = jax.grad(lambda desc: jnp.sum(standardise(desc, mass) ** 3))(constant)
    assert np.isfinite(slope).all()


def test_curvature_that_counts_for_nothing_is_known_all_the_same():
    found = [
        features(SPEC, settings=FeatureSettings(curvature_weight=weight)).curvature
        for weight in (0.0, 0.3)
    ]
    np.testing.assert_array_equal(*found)

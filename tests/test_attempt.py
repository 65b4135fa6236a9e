"""An attempt from spectra to a match: its result, vmap, derivatives and cost."""

from dataclasses import replace
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shapes import SMALL, small

import jfsf
from jfsf import SearchSettings, Settings, batch, testing
from jfsf.convert._variants import quick_sinkhorn
from jfsf.evaluate import geodesic_error
from jfsf.matching import _others
from jfsf.matching._stages import deform_by_arap
from jfsf.runtime._sizes import padded_pair

X, Y = small("man_walk", 620), small("man_up", 600)


@cache
def basis(name, faces):
    return jfsf.basis(small(name, faces)[0], cache=False)


def pair_of(dtype):
    """Both spectra padded to one size, so that they share the programs of a batch."""
    specs = padded_pair(basis("man_walk", 620), basis("man_up", 600))
    cast = lambda leaf: leaf.astype(dtype) if leaf.dtype.kind == "f" else leaf
    return jax.tree.map(cast, specs)


def error(T_xy):
    (_, gt_x), (mesh_y, gt_y) = X, Y
    at = slice(None, None, 20)
    return geodesic_error(np.asarray(T_xy), mesh_y, gt_x[at], gt_y[at]).mean()


# By small programs, but for the search: with SMALL's the map is wrong.
FEW = replace(SMALL, search=SearchSettings())


@cache
def alone():
    return jfsf.match_spectra(*pair_of("f4"), settings=FEW)


def test_spectra_are_matched():
    match = alone()
    n_x, n_y = (len(mesh.vertices) for mesh, _ in (X, Y))
    assert n_x != n_y
    assert match.C_yx.dtype == "f4" and match.info is None
    assert match.T_xy[:n_x].max() < n_y and match.T_yx[:n_y].max() < n_x
    assert error(match.T_xy[:n_x]) < 0.05
    evidence = match.certificate
    # So few vertices are never quite sure.
    assert evidence.finite and evidence.confidence > 0.3 and evidence.recall == 1
    assert match.confidence_x is not None and match.confidence_y is not None
    for likely, n in ((match.confidence_x, n_x), (match.confidence_y, n_y)):
        assert likely.dtype == "f4" and not likely[n:].any()
        assert 0.2 < likely[:n].mean() < 1 and likely.min() >= 0 and likely.max() <= 1
    assert match.radius_x is not None and match.radius_y is not None
    for radius, n in ((match.radius_x, n_x), (match.radius_y, n_y)):
        assert radius.dtype == "f4" and np.isinf(radius[n:]).all()
        assert np.isfinite(radius[:n]).all() and radius.min() > 0


@pytest.mark.slow
def test_it_vmaps():
    pair = pair_of("f4")
    stacked = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), pair)
    run = partial(jfsf.match_spectra, settings=FEW)
    both = jax.jit(jax.vmap(run))(*stacked)
    n_x = len(X[0].vertices)
    for T_xy in both.T_xy:
        # Sums under vmap have another order, which decides ties.
        assert error(T_xy[:n_x]) < 1.2 * error(alone().T_xy[:n_x])
        assert (T_xy == alone().T_xy)[:n_x].mean() > 0.9


@pytest.mark.slow
def test_it_is_differentiated_with_default_settings():
    x, y = pair_of("f8")
    weight = np.random.default_rng(0).normal(size=(len(x.evals), len(y.evals)))

    def loss(scale):
        match = jfsf.match_spectra(x, y._replace(evecs=scale * y.evecs))
        return jnp.sum(weight * match.C_yx), match

    (value, match), slope = jax.value_and_grad(loss, has_aux=True)(jnp.ones(()))
    n_x = len(X[0].vertices)
    assert match.C_yx.dtype == "f8" and error(match.T_xy[:n_x]) < 0.05
    # The map of points does not change, and C_yx is linear in the functions on Y.
    np.testing.assert_allclose(slope, value, rtol=1e-6)


class Counted:
    """Stages that count for how many pairs they are run, under vmap, too."""

    def __init__(self):
        self.refined = self.deformed = 0

    def refine(self, x, y, C_yx, orientation, descriptor_weight, *, settings):
        jax.debug.callback(self.count_refined, C_yx[0, 0])
        return C_yx[:30, :30]

    def deform(self, spec_x, spec_y, C_yx, orientation, search, *, settings):
        jax.debug.callback(self.count_deformed, C_yx[0, 0])
        return deform_by_arap(
            spec_x, spec_y, C_yx, orientation, search, settings=settings
        )

    def count_refined(self, _):
        self.refined += 1

    def count_deformed(self, _):
        self.deformed += 1


# As few and small programs as can be: only the work is counted. Without bending no pair
# is in doubt.
QUICK = Settings(
    search=SearchSettings(
        hypotheses=61, assignments=16, samples=60, final_samples=80, final_ks=(30, 40)
    ),
    bend_rounds=1,
    converter=quick_sinkhorn,
)


@pytest.mark.slow
@pytest.mark.parametrize("batch_size", [1, 2])
@pytest.mark.usefixtures("all_run_once")
def test_only_pairs_in_doubt_cost_more_than_an_attempt(batch_size, monkeypatch):
    monkeypatch.setattr(_others, "NEAR_ENERGY", -1.0)  # no near ties
    specs = [testing.blob_spectrum(seed, 40) for seed in range(3)]
    # A shape is like itself; two blobs are less alike.
    pairs = [(0, 0), (0, 1), (1, 1), (1, 2)]
    xs, ys = ([specs[pair[side]] for pair in pairs] for side in (0, 1))
    counted = Counted()
    # A shape and itself coincide, so that no doubt is left; nor is a motion tried then.
    settings = replace(
        QUICK,
        retry_below=0.99,
        rigid_below=0.0,
        refine=counted.refine,
        deform=counted.deform,
    )
    matches = batch.match_spectra(xs, ys, settings=settings, batch_size=batch_size)
    jax.effects_barrier()
    doubtful = [x != y for x, y in pairs]
    attempts = [len(match.info.source) for match in matches]
    for count, doubt in zip(attempts, doubtful, strict=True):
        assert 1 <= count <= 1 + settings.nonisometric_attempts * doubt
    # On the copies the first map, all starts and the mirror image are refined and bent;
    # on the whole shapes those that rank above the first are bent only.
    on_copies = (2 + settings.search.nonisometric_candidates) * sum(doubtful)
    assert counted.refined == len(pairs) + on_copies
    assert counted.deformed == sum(attempts) + on_copies
    for match, doubt in zip(matches, doubtful, strict=True):
        evidence = match.certificate
        assert match.info.confidence[match.info.won] == evidence.confidence
        assert np.isnan(evidence.share) != doubt

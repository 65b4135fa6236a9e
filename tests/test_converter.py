"""What a converter may be: ours, the paper's rivals, or ten lines of one's own."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jfsf import testing
from jfsf.baselines import auction, cpd
from jfsf.convert import (
    maps_of,
    nearest,
    quick_nearest,
    quick_sinkhorn,
    sinkhorn,
    with_options,
)
from jfsf.neighbours import NeighbourSettings, spectral_tiles
from jfsf.refine import arap, icp, zoomout
from jfsf.spectral import embeddings, functional_map
from jfsf.types import Maps

N, K = 162, 16


class Pairing(NamedTuple):
    T_xy: jax.Array
    T_yx: jax.Array
    shortest: jax.Array


def own(emb_x, emb_y, marginal_x, marginal_y):
    """A converter of ten lines: no keywords, and a record of its own."""
    square = jnp.sum((emb_x[:, None] - emb_y[None]) ** 2, 2)
    square = jnp.where(marginal_x[:, None] > 0, square, jnp.inf)
    square = jnp.where(marginal_y[None] > 0, square, jnp.inf)
    return Pairing(jnp.argmin(square, 1), jnp.argmin(square, 0), jnp.min(square))


CONVERTERS = {
    "own": own,
    "auction": auction,
    "cpd": partial(cpd, rank=60, num_iters=10),
    "nearest": nearest,
    "quick_nearest": quick_nearest,
    "quick_sinkhorn": quick_sinkhorn,
}
REFINEMENTS = {
    "icp": partial(icp, num_iters=3, space="direct"),
    "zoomout": partial(zoomout, ks=(K - 4, K, K, K)),
}


def relabelled():
    """Two spectra of one shape, relabelled, with the map and a start near it."""
    spec_x = testing.blob_spectrum(2, K)
    rng = np.random.default_rng(0)
    order = rng.permutation(N)
    spec_y = testing.relabel_spectrum(spec_x, order)
    truth = np.argsort(order)
    rough = truth.copy()
    wrong = rng.choice(N, 15, replace=False)
    rough[wrong] = rng.integers(N, size=15)
    rough = jnp.asarray(rough, jnp.int32)
    return spec_x, spec_y, functional_map(rough, spec_x, spec_y), truth


@pytest.mark.parametrize("tiled", [False, True])
@pytest.mark.parametrize("refinement", REFINEMENTS)
@pytest.mark.parametrize("converter", CONVERTERS)
def test_any_converter_refines_a_map(converter, refinement, tiled):
    spec_x, spec_y, start, truth = relabelled()
    tiles = (spectral_tiles(spec_x), spectral_tiles(spec_y)) if tiled else None
    refine = partial(REFINEMENTS[refinement], converter=CONVERTERS[converter])
    C_yx = refine(spec_x, spec_y, start, tiles=tiles)
    maps = nearest(*embeddings(C_yx, spec_x.evecs, spec_y.evecs, space="direct"))
    assert np.mean(np.asarray(maps.T_xy) == truth) > 0.95
    if converter in ("own", "auction", "cpd"):
        # It takes no tiles, so they change nothing.
        assert np.array_equal(C_yx, refine(spec_x, spec_y, start))


@pytest.mark.parametrize("converter", ["own", "auction"])
def test_a_converter_without_tiles_deforms_too(converter):
    spec_x, spec_y, _, truth = relabelled()
    tiles = spectral_tiles(spec_x), spectral_tiles(spec_y)
    start = Maps(*(jnp.asarray(T, jnp.int32) for T in (truth, np.argsort(truth))))
    run = partial(arap, rounds=2, converter=CONVERTERS[converter])
    found = nearest(*run(spec_x, spec_y, start, tiles=tiles))
    assert np.array_equal(found.T_xy, truth)


def test_a_record_of_any_type_becomes_maps():
    maps = maps_of(own(*jnp.eye(4)[None].repeat(2, 0), jnp.ones(4), jnp.ones(4)))
    assert type(maps) is Maps and maps.T_xy.dtype == maps.T_yx.dtype == jnp.int32
    assert maps.T_xy.tolist() == [0, 1, 2, 3]


def options_of(converter):
    """The keywords that a partial sets."""
    return converter.keywords if isinstance(converter, partial) else {}


OPTIONS = {
    "tiles": (1, 2),
    "neighbour_settings": NeighbourSettings(),
    "min_recall": 0.5,
}


@pytest.mark.parametrize(
    "converter, names",
    [
        (sinkhorn, set(OPTIONS)),
        (nearest, set(OPTIONS)),
        (jax.jit(sinkhorn, static_argnames="k0"), set(OPTIONS)),
        (lambda emb_x, emb_y, a, b, *, tiles=None: None, {"tiles"}),
        (lambda emb_x, emb_y, a, b, tiles=None: None, {"tiles"}),
        (own, set()),
        (auction, set()),
        (cpd, set()),
        # Positional arguments and catch-alls have no names to pass.
        (lambda emb_x, emb_y, a, b, tiles, /: None, set()),
        (lambda *args, **options: None, set()),
        (max, set()),
        (dict, set()),
    ],
)
def test_a_converter_is_handed_the_options_that_it_declares(converter, names):
    found = with_options(converter, **OPTIONS)
    assert options_of(found) == {name: OPTIONS[name] for name in names}
    assert names or found is converter


def test_options_that_are_none_are_left_out():
    assert with_options(sinkhorn, tiles=None, min_recall=None) is sinkhorn
    found = with_options(sinkhorn, tiles=None, min_recall=0.0)
    assert options_of(found) == {"min_recall": 0.0}


def test_options_that_a_partial_sets_are_kept():
    found = with_options(quick_sinkhorn, **OPTIONS)
    assert found.keywords["min_recall"] == 0.0
    assert found.keywords["tiles"] == (1, 2) and found.keywords["k0"] == 10
    inner = partial(partial(sinkhorn, tiles=None), k0=5)
    assert with_options(inner, tiles=(1, 2)) is inner

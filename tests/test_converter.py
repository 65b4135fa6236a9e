"""What a converter may be: ours, the paper's rivals, or ten lines of one's own."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.paper.baselines import auction, cpd
from jfsf import testing
from jfsf.convert import maps_of, nearest
from jfsf.convert._variants import quick_sinkhorn
from jfsf.neighbours import NeighbourSearch, NeighbourSettings, spectral_tiles
from jfsf.refine import arap, icp, soft_map, zoomout
from jfsf.spectral import embeddings, functional_map
from jfsf.types import Maps

N, K = 162, 16


class Pairing(NamedTuple):
    T_xy: jax.Array
    T_yx: jax.Array
    shortest: jax.Array


def own(emb_x, emb_y, marginal_x, marginal_y, search):
    """A converter of ten lines: all points compared, and a record of its own."""
    square = jnp.sum((emb_x[:, None] - emb_y[None]) ** 2, 2)
    square = jnp.where(marginal_x[:, None] > 0, square, jnp.inf)
    square = jnp.where(marginal_y[None] > 0, square, jnp.inf)
    return Pairing(jnp.argmin(square, 1), jnp.argmin(square, 0), jnp.min(square))


CONVERTERS = {
    "own": own,
    "auction": auction,
    "cpd": partial(cpd, rank=60, num_iters=10),
    "nearest": nearest,
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
    search = NeighbourSearch(tiles, 0.0) if tiled else None
    refine = partial(REFINEMENTS[refinement], converter=CONVERTERS[converter])
    C_yx = refine(spec_x, spec_y, start, search=search)
    maps = nearest(*embeddings(C_yx, spec_x.evecs, spec_y.evecs, space="direct"))
    assert np.mean(np.asarray(maps.T_xy) == truth) > 0.95
    if converter in ("own", "auction", "cpd"):
        # It ignores the search.
        assert np.array_equal(C_yx, refine(spec_x, spec_y, start))


@pytest.mark.parametrize("converter", ["own", "auction"])
def test_a_converter_without_tiles_deforms_too(converter):
    spec_x, spec_y, _, truth = relabelled()
    search = NeighbourSearch((spectral_tiles(spec_x), spectral_tiles(spec_y)))
    start = Maps(*(jnp.asarray(T, jnp.int32) for T in (truth, np.argsort(truth))))
    run = partial(arap, rounds=2, converter=CONVERTERS[converter])
    found = nearest(*run(spec_x, spec_y, start, search=search))
    assert np.array_equal(found.T_xy, truth)


def test_a_record_of_any_type_becomes_maps():
    maps = maps_of(own(*jnp.eye(4)[None].repeat(2, 0), *jnp.ones((2, 4)), None))
    assert type(maps) is Maps and maps.T_xy.dtype == maps.T_yx.dtype == jnp.int32
    assert maps.T_xy.tolist() == [0, 1, 2, 3]


def handed(emb_x, emb_y, marginal_x, marginal_y, search):
    """A converter that finds nothing unless it is handed the search."""
    assert search is not None and search.settings.checked == 7
    found = nearest(emb_x, emb_y, marginal_x, marginal_y, search)
    return found._replace(T_xy=jnp.where(search.tiles is None, 0, found.T_xy))


def test_every_refinement_hands_its_search_to_the_converter():
    spec_x, spec_y, start, truth = relabelled()
    tiles = spectral_tiles(spec_x), spectral_tiles(spec_y)
    search = NeighbourSearch(tiles, 0.0, NeighbourSettings(checked=7))
    maps = Maps(*(jnp.asarray(T, jnp.int32) for T in (truth, np.argsort(truth))))
    for refine in REFINEMENTS.values():
        refine(spec_x, spec_y, start, converter=handed, search=search)
    arap(spec_x, spec_y, maps, rounds=1, converter=handed, search=search)
    found = soft_map(spec_x, spec_y, start, converter=handed, search=search)
    assert np.mean(np.asarray(found.T_xy) == truth) > 0.8

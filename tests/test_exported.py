"""Programs are written by jax.export, read again, and called."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import export
from transformations import problem

from jfsf import convert, refine
from jfsf.convert import nearest, sinkhorn
from jfsf.neighbours import NeighbourSearch, NeighbourSettings

quick = partial(sinkhorn, k0=4, num_iters=6)


def read_again(function, *args):
    """The program of a function, after a round trip through bytes."""
    written = export.export(jax.jit(function))(*args).serialize()
    return export.deserialize(written).call


def check_round_trip(function, *args):
    found, here = read_again(function, *args)(*args), function(*args)
    assert jax.tree.structure(found) == jax.tree.structure(here)
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(here), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9)


def test_the_filter_comes_back():
    p = problem(jnp.float64)
    check_round_trip(quick, p.emb_x, p.emb_y, p.mass_x, p.mass_y)


def test_zoomout_comes_back():
    p = problem(jnp.float64)
    zoomout = partial(refine.zoomout, ks=(4, 6), converter=nearest)
    check_round_trip(zoomout, p.x, p.y, p.C_low)


def test_records_are_arguments_and_results():
    p = problem(jnp.float64)
    check_round_trip(convert.plan, p.filtered)
    given = NeighbourSearch(p.tiles, 0.0, NeighbourSettings(checked=8))
    program = read_again(lambda search: search, given)
    found = program(given)
    assert isinstance(found, NeighbourSearch)
    assert (found.min_recall, found.settings) == (0.0, given.settings)
    assert jax.tree.structure(found) == jax.tree.structure(given)


def test_symbolic_sizes_are_not_taken():
    """As the guide says: blocks and bins are sized by the number of points."""
    n, m = export.symbolic_shape("n, m")
    embs = (jax.ShapeDtypeStruct((size, 3), jnp.float64) for size in (n, m))
    with pytest.raises(TypeError, match="_DimExpr"):
        export.export(jax.jit(quick))(*embs)

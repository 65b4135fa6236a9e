"""Records as torch tensors, numpy and jax arrays: same numbers, types and memory."""

import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jfsf import testing
from jfsf.apps.interop import to_jax, to_numpy, to_torch
from jfsf.spectral import spectrum
from jfsf.types import Certificate, Maps, Match, Mesh

MESH = testing.blob(0)


def match():
    rng = np.random.default_rng(0)
    numbers = dict.fromkeys(Certificate._fields, jnp.asarray(0.5, jnp.float32))
    certificate = Certificate(
        **numbers
        | {"empty": jnp.asarray(2, jnp.int32), "finite": jnp.asarray(True)}
        | {"landmarks": jnp.zeros(0)}
    )
    T_xy, T_yx = (jnp.asarray(rng.integers(0, 5, n), jnp.int32) for n in (7, 5))
    C_yx = jnp.asarray(rng.normal(size=(4, 3)), jnp.float32)
    return Match(T_xy, T_yx, C_yx, certificate)


RECORDS = {
    "mesh": MESH,
    "spectrum": spectrum(MESH, 8, cache=False),
    "maps": Maps(jnp.arange(3, dtype=jnp.int32), jnp.arange(4, dtype=jnp.int32)),
    "match": match(),
}


@pytest.fixture
def torch():
    return pytest.importorskip("torch")


def assert_same(found, wanted):
    assert type(found) is type(wanted)
    for new, old in zip(jax.tree.leaves(found), jax.tree.leaves(wanted), strict=True):
        assert str(new.dtype).removeprefix("torch.") == str(old.dtype)
        np.testing.assert_array_equal(np.asarray(new), np.asarray(old))


@pytest.mark.parametrize("name", RECORDS)
def test_to_torch_and_back(name, torch):
    record = RECORDS[name]
    tensors = to_torch(record)
    assert all(isinstance(leaf, torch.Tensor) for leaf in jax.tree.leaves(tensors))
    assert_same(tensors, record)
    for back, kind in ((to_numpy(tensors), np.ndarray), (to_jax(tensors), jax.Array)):
        assert all(isinstance(leaf, kind) for leaf in jax.tree.leaves(back))
        assert_same(back, record)
    assert to_torch(tensors)[0] is tensors[0]


@pytest.mark.parametrize("name", RECORDS)
def test_numpy_to_jax_and_back(name):
    record = RECORDS[name]
    arrays = to_jax(record)
    assert all(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(arrays))
    assert_same(arrays, record)
    back = to_numpy(arrays)
    assert all(isinstance(leaf, np.ndarray) for leaf in jax.tree.leaves(back))
    assert_same(back, record)


def test_nothing_is_copied(torch):
    maps, mesh = RECORDS["maps"], RECORDS["mesh"]
    of_jax, of_numpy = to_torch(maps), to_torch(mesh)
    assert of_jax.T_xy.data_ptr() == maps.T_xy.unsafe_buffer_pointer()
    assert of_numpy.vertices.data_ptr() == mesh.vertices.ctypes.data
    assert to_numpy(of_numpy).vertices.ctypes.data == mesh.vertices.ctypes.data
    back = to_jax(of_jax).T_xy
    assert back.unsafe_buffer_pointer() == maps.T_xy.unsafe_buffer_pointer()


def test_views_keep_their_order(torch):
    # Faces turned over, columns of a matrix, every other row, Fortran order.
    values = np.arange(24.0).reshape(4, 6)
    for view in (values[:, ::-1], values[:, 1], values[::2], values.T):
        tensor = to_torch(view)
        np.testing.assert_array_equal(tensor.numpy(), view)
        np.testing.assert_array_equal(to_jax(tensor), view)
    tensor = torch.arange(24.0).reshape(4, 6)[::2, 1:5].T
    np.testing.assert_array_equal(to_jax(tensor), tensor.numpy())
    np.testing.assert_array_equal(to_numpy(tensor), tensor.numpy())


def test_arrays_of_all_kinds_may_mix(torch):
    mixed = Mesh(torch.zeros(4, 3), np.zeros((2, 3), np.int32))
    for function in (to_torch, to_numpy, to_jax):
        found = function(mixed)
        assert found.vertices.shape == (4, 3) and found.faces.shape == (2, 3)
        assert type(found.vertices) is type(found.faces)


def test_a_gradient_is_not_cut_in_silence(torch):
    maps = Maps(torch.zeros(3), torch.zeros(4, requires_grad=True))
    for function, name in ((to_numpy, "to_numpy"), (to_jax, "to_jax")):
        with pytest.raises(ValueError, match=rf"{name}: \.T_yx requires a gradient"):
            function(maps)
    assert to_torch(maps).T_yx.requires_grad


def test_doubles_are_not_halved_in_silence(torch):
    with jax.enable_x64(False):
        for record in (MESH, to_torch(MESH)):
            with pytest.raises(
                ValueError, match=r"\.vertices is float64 and jax's x64"
            ):
                to_jax(record)
        single = MESH._replace(vertices=MESH.vertices.astype(np.float32))
        assert_same(to_jax(to_torch(single)), single)


def test_what_is_no_array_is_named(torch):
    for function in (to_torch, to_numpy, to_jax):
        with pytest.raises(ValueError, match=r"\.T_yx is str of <U1; pass arrays"):
            function(Maps(np.zeros(3), "a"))


def test_missing_torch_says_where_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(ImportError, match="needs torch .*as pytorch.org says"):
        to_torch(MESH)

"""Which transformations of jax each function takes: a table of functions by these.

To trace a function under vmap is quick, and tells whether types fit; all other cells
are for the slow tests, but for those of a few small functions.
"""

import os
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.sharding import AbstractMesh, Mesh, PartitionSpec
from transformations import CASES, problem

# What differs from device to device where the rest is the same on all of them.
SOME = "x", "emb_x", "C_yx", "C_low", "filtered", "lam"


def is_real(x):
    return jnp.issubdtype(x.dtype, jnp.floating)


def stacked(dtype):
    both = problem(dtype), problem(dtype, 1)
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *both)


def real_part(run, p):
    """A function of the floats of `p`, to one number; and these floats."""
    leaves, tree = jax.tree.flatten(p)

    def value(reals):
        left = iter(reals)
        full = tree.unflatten([next(left) if is_real(x) else x for x in leaves])
        found = [x for x in jax.tree.leaves(run(full)) if is_real(x)]
        finite = (jnp.where(jnp.isfinite(x), x, 0) for x in found)
        return sum(jnp.sum(jnp.sin(x)) for x in finite)

    return value, [x for x in leaves if is_real(x)]


def sharded(run, mesh, p, batch, some):
    """`run` on two devices, each with its part of `some`; and its argument."""
    spec = PartitionSpec("pairs")
    both = dict.fromkeys(some, spec)
    specs = jax.tree.map(lambda _: PartitionSpec(), p)._replace(**both)
    given = p._replace(**{name: getattr(batch, name) for name in some})

    def own(q):
        parts = {n: jax.tree.map(lambda x: x[0], getattr(q, n)) for n in some}
        return jax.tree.map(lambda x: x[None], run(q._replace(**parts)))

    return jax.shard_map(own, mesh=mesh, in_specs=(specs,), out_specs=spec), given


def by_shard_map(run, p):
    """Traced with the check of what varies, for devices that need not be there."""
    mesh = AbstractMesh((2,), ("pairs",))
    batch = stacked(p.C_yx.dtype)
    for some in (p._fields, SOME):
        function, given = sharded(run, mesh, p, batch, some)
        found = jax.eval_shape(function, given)
        assert all(len(x.shape) and x.shape[0] == 2 for x in jax.tree.leaves(found))


def by_vmap(run, p):
    found = jax.eval_shape(jax.vmap(run), stacked(p.C_yx.dtype))
    assert all(x.shape[0] == 2 for x in jax.tree.leaves(found))
    check_precision(found, p)


def by_checking_leaks(run, p):
    with jax.checking_leaks():
        jax.eval_shape(run, p)


def by_jit(run, p):
    check_precision(jax.eval_shape(jax.jit(run), p), p)


def check_precision(found, p):
    kinds = {x.dtype for x in jax.tree.leaves(found) if is_real(x)}
    assert kinds <= {p.C_yx.dtype}


def by_grad(run, p):
    value, reals = real_part(run, p)
    slopes = jax.jit(jax.grad(value))(reals)
    assert all(np.isfinite(s).all() for s in slopes)
    assert any(np.any(s) for s in slopes)
    return slopes


def by_jvp(run, p):
    value, reals = real_part(run, p)
    rng = np.random.default_rng(0)
    steps = [jnp.asarray(rng.normal(size=x.shape), x.dtype) for x in reals]
    along = jax.jit(lambda x, step: jax.jvp(value, (x,), (step,))[1])(reals, steps)
    assert np.isfinite(along)
    slopes = jax.jit(jax.grad(value))(reals)
    exact = sum(float(jnp.sum(s * d)) for s, d in zip(slopes, steps, strict=True))
    size = sum(float(jnp.sum(abs(s * d))) for s, d in zip(slopes, steps, strict=True))
    tol = 1e-3 if p.C_yx.dtype == jnp.float32 else 1e-6
    assert abs(float(along) - exact) <= tol * max(size, 1)


def by_debug_nans(run, p):
    with jax.debug_nans(True):
        run(p)


def by_grad_with_debug_nans(run, p):
    value, reals = real_part(run, p)
    with jax.debug_nans(True):
        jax.grad(value)(reals)


def by_transfer_guard(run, p):
    with jax.transfer_guard("disallow"):
        jax.block_until_ready(run(p))


TRACED = {
    "jit": by_jit,
    "vmap": by_vmap,
    "shard_map": by_shard_map,
    "checking_leaks": by_checking_leaks,
}
RUN = {
    "grad": by_grad,
    "jvp": by_jvp,
    "debug_nans": by_debug_nans,
    "grad_with_debug_nans": by_grad_with_debug_nans,
    "transfer_guard": by_transfer_guard,
}
# Their programs are small.
SMALL = "embeddings", "polar", "pull_back", "plan", "orthogonality", "coverage"
# These take seconds to trace.
LONG = (
    *("precise", "arap", "fit, huber", "sinkhorn, tiles", "nearest, tiles"),
    "match_spectra",
)


def cells():
    for name, case in CASES.items():
        for kind in TRACED | RUN:
            if {kind, *kind.split("_with_")} & set(case.cannot):
                continue
            for dtype in (jnp.float32, jnp.float64):
                quick = dtype == jnp.float32 and (
                    name in SMALL or (kind == "vmap" and name not in LONG)
                )
                marks = () if quick else (pytest.mark.slow,)
                at = f"{name}-{kind}-{jnp.dtype(dtype)}"
                yield pytest.param(name, kind, dtype, marks=marks, id=at)


@pytest.mark.parametrize("name, kind, dtype", list(cells()))
def test_cell(name, kind, dtype):
    (TRACED | RUN)[kind](CASES[name].run, problem(dtype))


# On shapes as small as these rounding decides between starts of the search: that many
# at once by `match_spectra` are the loop is tested in test_batch.
ALIKE = [name for name in CASES if name != "match_spectra"]
SHARDED = [n for n, case in CASES.items() if "shard_map" not in case.cannot]


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(CASES.keys() - SHARDED))
def test_what_cannot_be_does_not_work(name):
    """Else the reason in the table is out of date."""
    with pytest.raises((TypeError, ValueError), match="varying|inconsistent"):
        by_shard_map(CASES[name].run, problem(jnp.float32))


@pytest.mark.slow
@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
@pytest.mark.parametrize("name", ALIKE)
def test_vmap_equals_the_loop(name, dtype):
    run = CASES[name].run
    found = jax.jit(jax.vmap(run))(stacked(dtype))
    tol = 1e-3 if dtype == jnp.float32 else 1e-6
    for i in range(2):
        for a, b in zip(
            jax.tree.leaves(found), jax.tree.leaves(run(problem(dtype, i))), strict=True
        ):
            if is_real(b):
                np.testing.assert_allclose(a[i], b, rtol=tol, atol=tol)
            else:  # a tie may go the other way
                assert np.sum(np.asarray(a[i]) != np.asarray(b)) <= 0.2 * b.size


def check_two_devices():
    """In a process with two devices: each has the result of its own problem."""
    assert len(jax.devices()) == 2
    mesh = Mesh(np.array(jax.devices()), ("pairs",))
    p, batch = problem(jnp.float64), stacked(jnp.float64)
    for name in sorted({*SHARDED} & {*ALIKE}):
        run = CASES[name].run
        function, given = sharded(run, mesh, p, batch, p._fields)
        found = jax.jit(function)(given)
        for i in range(2):
            own = jax.tree.leaves(run(problem(jnp.float64, i)))
            for a, b in zip(jax.tree.leaves(found), own, strict=True):
                np.testing.assert_allclose(a[i], b, rtol=1e-6, atol=1e-6, err_msg=name)


TWO_DEVICES = """
import jax
jax.config.update("jax_enable_x64", True)
from test_transformations import check_two_devices
check_two_devices()
"""


@pytest.mark.slow
def test_two_devices():
    root = Path(__file__).parents[1]
    flags = os.environ.get("XLA_FLAGS", "")
    flags += " --xla_force_host_platform_device_count=2"
    paths = os.pathsep.join([str(root), str(root / "tests")])
    env = {"PYTHONPATH": paths, "JAX_PLATFORMS": "cpu", "XLA_FLAGS": flags}
    done = subprocess.run(
        [sys.executable, "-c", TWO_DEVICES],
        env=os.environ | env,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr

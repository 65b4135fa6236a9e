"""Many pairs of shapes in one program: padded, vmapped, spread over all devices.

Pairs of unequal sizes are padded to a few common ones (`padding.rung`), so a hundred
pairs of mixed sizes cost a handful of compilations. A call of the program holds a fixed
number of pairs, whose axis is sharded over the devices; each device then walks through
its share, some pairs vmapped at a time, and stops where the pairs end. Results come
back unpadded, as numpy arrays in the order of the pairs: what a loop over the pairs
gives, up to ties.

With several hosts each process takes its share of the pairs (`hosts.share`) and runs it
on its own devices: a host waits for no other.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, Float

from jfsf.compiling import large_jit
from jfsf.convert import sinkhorn
from jfsf.match import common
from jfsf.padding import pad, rung
from jfsf.pipeline import match_spectra as match_one
from jfsf.refine import Converter, zoomout
from jfsf.search import Candidates
from jfsf.search import search as search_one
from jfsf.types import Maps, Match, Spectrum

PAIRS = 32  # pairs a call
AXIS = "pairs"
STATIC = (0, 1, 2, 3)  # arguments of `_spread`


def convert(
    embs_x: Sequence[Float[Array, "n_x k"]],
    embs_y: Sequence[Float[Array, "n_y k"]],
    *,
    converter: Converter = sinkhorn,
    **spread: Any,
) -> list[Maps]:
    """Both point-to-point maps of each pair of aligned embeddings.

    Args:
        embs_x, embs_y: one of each a pair (`fmap.embeddings`); n_x, n_y and k are any.
        converter: `sinkhorn`, `nearest` or any other with their signature; every
            vertex has the same marginal.
        spread: `devices`, `pairs` and `together`, see `each`.

    Raises:
        ValueError: not as many of one as of the other, or what the converter raises,
            after the number of the pair.
    """
    sizes = _sizes("convert", embs_x=embs_x, embs_y=embs_y)

    def padded(x, y):
        size = rung(max(len(x), len(y)))
        return *_with_marginal(x, size), *_with_marginal(y, size)

    inputs = (padded(x, y) for x, y in zip(embs_x, embs_y, strict=True))
    found = each(_convert, inputs, converter=converter, **spread)
    return [_cut(maps, *n) for maps, n in zip(found, sizes, strict=True)]


def refine(
    specs_x: Sequence[Spectrum],
    specs_y: Sequence[Spectrum],
    Cs_yx: Sequence[Float[Array, "k_x k_y"]],
    *,
    ks: tuple[int, ...],
    converter: Converter = sinkhorn,
    **options: Any,
) -> list[Float[Array, "k k"]]:
    """`zoomout` of each pair: C_yx at ks[-1].

    Args:
        specs_x, specs_y, Cs_yx: one of each a pair; programs are shared by pairs with
            as many eigenpairs.
        ks, converter: as `zoomout`.
        options: `space`, `weighted` and `both` of `zoomout`; `devices`, `pairs` and
            `together` of `each`.

    Raises:
        ValueError: as `convert`.
    """
    _sizes("refine", specs_x=specs_x, specs_y=specs_y, Cs_yx=Cs_yx)
    inputs = (
        (*_padded(x, y), np.asarray(C))
        for x, y, C in zip(specs_x, specs_y, Cs_yx, strict=True)
    )
    return each(zoomout, inputs, ks=tuple(ks), converter=converter, **options)


def search(
    specs_x: Sequence[Spectrum],
    specs_y: Sequence[Spectrum],
    descs_x: Sequence[Float[Array, "n_x d"]],
    descs_y: Sequence[Float[Array, "n_y d"]],
    **options: Any,
) -> list[Candidates]:
    """The initial functional maps of each pair: `jfsf.search.search`.

    Args:
        specs_x, specs_y, descs_x, descs_y: one of each a pair.
        options: `orientation`, `hypotheses` and `num` of `jfsf.search.search`;
            `devices`, `pairs` and `together` of `each`.

    Raises:
        ValueError: as `convert`.
    """
    _sizes("search", specs_x=specs_x, specs_y=specs_y, descs_x=descs_x, descs_y=descs_y)

    def padded(x, y, desc_x, desc_y):
        x, y = _padded(x, y)
        return x, y, _rows(desc_x, len(x.mass)), _rows(desc_y, len(y.mass))

    inputs = map(padded, specs_x, specs_y, descs_x, descs_y)
    return each(search_one, inputs, large=True, **options)


def match_spectra(
    specs_x: Sequence[Spectrum], specs_y: Sequence[Spectrum], **options: Any
) -> list[Match]:
    """`jfsf.match` of each pair, from the spectra on.

    Args:
        specs_x, specs_y: one of each a pair, from `jfsf.match.basis`; each pair is cut
            to as many eigenpairs of both, and pairs with as many share programs.
        options: `orientation` and `hypotheses` of `jfsf.match`; `devices`, `pairs` and
            `together` of `each`.

    Raises:
        ValueError: as `convert`.
    """
    sizes = _sizes("match_spectra", specs_x=specs_x, specs_y=specs_y)
    inputs = (_padded(*common(*pair)) for pair in zip(specs_x, specs_y, strict=True))
    found = each(match_one, inputs, large=True, **options)
    return [_cut(one, *n) for one, n in zip(found, sizes, strict=True)]


def each(
    function: Callable,
    inputs: Iterable[tuple],
    *,
    devices: Sequence[Any] | None = None,
    pairs: int = PAIRS,
    together: int | None = None,
    large: bool = False,
    **options: Any,
) -> list[Any]:
    """`function(*input, **options)` for each of `inputs`: what the others are made of.

    One program is compiled for each set of shapes among the inputs.

    Args:
        function: pure; the same object in each call, or it compiles anew.
        inputs: tuples of records of arrays.
        devices: those that share the work; all of this process when absent.
        pairs: inputs a call of the program, rounded up to fill the devices; memory
            grows with them.
        together: inputs vmapped at a time on a device; when absent, all of its share on
            an accelerator, and on a CPU, where more would only crowd the cache, one.
        large: compile in less time a program that may run a little longer
            (`jfsf.compiling.large_jit`).
        options: of `function`, hashable; they are static.

    Returns:
        What `function` returns for each, as numpy arrays.

    Raises:
        ValueError: `pairs` or `together` is below 1, or what `function` raises, after
            the number of the input.
    """
    if pairs < 1 or (together is not None and together < 1):
        raise ValueError(
            f"each: pairs and together must be positive, got {pairs} and {together}"
        )
    mesh = Mesh(np.array(devices or jax.local_devices()), (AXIS,))
    share = -(-pairs // mesh.size)
    if together is None:
        together = 1 if mesh.devices[0].platform == "cpu" else share
    together = min(together, share)
    share = -(-share // together) * together
    spread = _spread
    if large:
        spread = large_jit(_spread, mesh.devices[0].platform, static_argnums=STATIC)
    call = partial(spread, function, tuple(sorted(options.items())), mesh, together)

    found: dict[int, Any] = {}

    def finish(group):
        try:
            results = _call(call, mesh, share, [given for _, given in group])
        except ValueError as error:
            raise ValueError(f"pair {group[0][0]}: {error}") from error
        found.update((at, new) for (at, _), new in zip(group, results, strict=True))
        group.clear()

    # As they come, so that no more than a call of each kind is padded at a time.
    alike = defaultdict(list)
    for at, given in enumerate(inputs):
        given = jax.tree.map(_canonical, given)
        leaves, tree = jax.tree.flatten(given)
        group = alike[tree, *((leaf.shape, leaf.dtype) for leaf in leaves)]
        group.append((at, given))
        if len(group) == share * mesh.size:
            finish(group)
    for group in filter(None, alike.values()):
        finish(group)
    return [found[at] for at in range(len(found))]


def _call(call, mesh, share, inputs):
    """Deal the inputs out to the devices in turn, run, and collect."""
    slots = [inputs[i :: mesh.size] for i in range(mesh.size)]
    counts = np.array([len(slot) for slot in slots], np.int32)
    # What fills the axis is never computed.
    full = [x for slot in slots for x in (slot + inputs[:1] * share)[:share]]
    batch = jax.tree.map(lambda *leaves: np.stack(leaves), *full)
    sharding = NamedSharding(mesh, PartitionSpec(AXIS))
    found = jax.device_get(call(*jax.device_put((counts, batch), sharding)))
    at = [(i % mesh.size) * share + i // mesh.size for i in range(len(inputs))]
    return [jax.tree.map(lambda x, i=i: x[i], found) for i in at]


@partial(jax.jit, static_argnums=STATIC)
def _spread(function, options, mesh, together, counts, batch):
    many = _alone if together == 1 else jax.vmap
    function = many(partial(function, **dict(options)))

    def on_device(count, batch):
        take = lambda x, i: jax.lax.dynamic_slice_in_dim(x, i * together, together)
        some = lambda i: function(*jax.tree.map(lambda x: take(x, i), batch))
        share = len(jax.tree.leaves(batch)[0])
        blank = jax.tree.map(
            lambda x: jnp.zeros((share, *x.shape[1:]), x.dtype), jax.eval_shape(some, 0)
        )

        def step(i, found):
            put = lambda all, new: jax.lax.dynamic_update_slice_in_dim(
                all, new, i * together, 0
            )
            return jax.tree.map(put, found, some(i))

        return jax.lax.fori_loop(0, -(-count[0] // together), step, blank)

    spec = PartitionSpec(AXIS)
    # Inside, each device is on its own; the check would want that said of every scan.
    spread = jax.shard_map(
        on_device, mesh=mesh, in_specs=(spec, spec), out_specs=spec, check_vma=False
    )
    return spread(counts, batch)


def _alone(function):
    """vmap over one, without the axis: batched products are slower, and round so that
    ties fall otherwise."""

    def many(*batch):
        found = function(*jax.tree.map(lambda x: x[0], batch))
        return jax.tree.map(lambda x: x[None], found)

    return many


def _convert(emb_x, marginal_x, emb_y, marginal_y, *, converter):
    maps = converter(emb_x, emb_y, marginal_x, marginal_y)
    return Maps(maps.T_xy, maps.T_yx)


def _padded(x: Spectrum, y: Spectrum) -> tuple[Spectrum, Spectrum]:
    # A closed surface has twice as many faces as vertices, so one number says it all.
    x, y = (jax.tree.map(np.asarray, spec) for spec in (x, y))
    half = -(-max(len(x.faces), len(y.faces)) // 2)
    size = rung(max(len(x.mass), len(y.mass), half))
    return pad(x, size, 2 * size), pad(y, size, 2 * size)


def _with_marginal(emb, size):
    padded = _rows(emb, size)
    return padded, (np.arange(size) < len(emb)) / padded.dtype.type(len(emb))


def _rows(array, size):
    array = np.asarray(array)
    return np.pad(array, ((0, size - len(array)), (0, 0)))


def _canonical(array):
    array = np.asarray(array)
    return array.astype(jax.dtypes.canonicalize_dtype(array.dtype))


def _cut(maps, n_x, n_y):
    return maps._replace(T_xy=maps.T_xy[:n_x], T_yx=maps.T_yx[:n_y])


def _sizes(function, **lists):
    """(n_x, n_y) of each pair."""
    counts = {name: len(items) for name, items in lists.items()}
    if len(set(counts.values())) > 1:
        raise ValueError(f"{function}: not one of each a pair, got {counts}")
    first, second, *_ = lists.values()
    return [(_rows_of(x), _rows_of(y)) for x, y in zip(first, second, strict=True)]


def _rows_of(shape):
    return len(shape.mass if isinstance(shape, Spectrum) else shape)

"""Conversion, refinement, search and matching of many pairs of shapes.

Pairs of unequal sizes are padded to a few common ones (`common_size`), so
a hundred pairs of mixed sizes cost a handful of compilations. Results come back
unpadded, in the order of the pairs: those of a loop over the pairs, up to ties.
"""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jfsf.convert import Converter, maps_of, sinkhorn
from jfsf.initial import Candidates, orientation_sign
from jfsf.initial import search as search_one
from jfsf.initial._search import Orientation
from jfsf.initial._start import check_spectrum
from jfsf.matching import Settings
from jfsf.matching._arguments import MatchInputs
from jfsf.matching._pairs import PairState
from jfsf.matching._policy import match_pairs
from jfsf.refine import zoomout
from jfsf.runtime import map_pairs
from jfsf.runtime._map_pairs import PAIRS, check_batch
from jfsf.runtime._runners import OneByOne, Vmapped
from jfsf.runtime._sizes import common_size, padded_pair, with_rows
from jfsf.types import Maps, Match, Spectrum


def convert(
    embs_x: Sequence[Float[Array, "n_x k"]],
    embs_y: Sequence[Float[Array, "n_y k"]],
    *,
    converter: Converter = sinkhorn,
    **sharding: Any,
) -> list[Maps]:
    """Both point-to-point maps of each pair of aligned embeddings.

    Args:
        embs_x, embs_y: lists with the embeddings of each pair
            (`jfsf.spectral.embeddings`), of any sizes.
        converter: any `jfsf.convert.Converter`, hashable; every vertex has the same
            marginal, and all points are compared.
        sharding: `devices`, `pairs` and `batch_size` of `map_pairs`.

    Raises:
        ValueError: the lists differ in length, or what the converter raises, with the
            number of the pair before the message.
    """
    sizes = _sizes("convert", embs_x=embs_x, embs_y=embs_y)

    def padded(x, y):
        size = common_size(max(len(x), len(y)))
        return *_with_marginal(x, size), *_with_marginal(y, size)

    inputs = (padded(x, y) for x, y in zip(embs_x, embs_y, strict=True))
    maps = map_pairs(_convert, inputs, converter=converter, **sharding)
    return [
        Maps(T_xy[:n_x], T_yx[:n_y])
        for (T_xy, T_yx), (n_x, n_y) in zip(maps, sizes, strict=True)
    ]


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
        specs_x, specs_y, Cs_yx: lists with the spectra and the functional map of each
            pair. Each pair is cut to equal numbers of eigenpairs; pairs with equal
            numbers share programs.
        ks, converter: as `zoomout`.
        options: the static options of `zoomout`, such as `bidirectional`; `devices`,
            `pairs` and `batch_size` of `map_pairs`.

    Raises:
        ValueError: as `convert`.
    """
    _sizes("refine", specs_x=specs_x, specs_y=specs_y, Cs_yx=Cs_yx)
    inputs = (
        (*padded_pair(x, y), np.asarray(C))
        for x, y, C in zip(specs_x, specs_y, Cs_yx, strict=True)
    )
    return map_pairs(zoomout, inputs, ks=tuple(ks), converter=converter, **options)


def search(
    specs_x: Sequence[Spectrum],
    specs_y: Sequence[Spectrum],
    descs_x: Sequence[Float[Array, "n_x d"]],
    descs_y: Sequence[Float[Array, "n_y d"]],
    **options: Any,
) -> list[Candidates]:
    """The initial functional maps of each pair: `jfsf.initial.search`.

    Args:
        specs_x, specs_y, descs_x, descs_y: lists with the spectra and the descriptors
            of each pair.
        options: the static options of `jfsf.initial.search`, such as `orientation`;
            `devices`, `pairs` and `batch_size` of `map_pairs`.

    Raises:
        ValueError: as `convert`.
    """
    _sizes("search", specs_x=specs_x, specs_y=specs_y, descs_x=descs_x, descs_y=descs_y)

    def padded(x, y, desc_x, desc_y):
        x, y = padded_pair(x, y)
        sides = (x, desc_x), (y, desc_y)
        return x, y, *(with_rows(np.asarray(d), len(s.mass)) for s, d in sides)

    inputs = map(padded, specs_x, specs_y, descs_x, descs_y)
    return map_pairs(search_one, inputs, fast_compile=True, **options)


def match_spectra(
    specs_x: Sequence[Spectrum],
    specs_y: Sequence[Spectrum],
    *,
    orientation: Orientation = "preserve",
    settings: Settings = Settings(),
    devices: Sequence[Any] | None = None,
    pairs: int = PAIRS,
    batch_size: int | None = None,
    cache: bool = True,
) -> list[Match]:
    """`jfsf.match` of each pair, from the spectra on, doubtful pairs tried again.

    Args:
        specs_x, specs_y: lists with the spectra of each pair, from `jfsf.basis`. Each
            pair is cut to equal numbers of eigenpairs; pairs with equal numbers share
            programs.
        orientation, settings: as `jfsf.match`.
        devices, pairs, batch_size: as `map_pairs`. One pair at a time on one CPU shares
            its programs with `jfsf.match`. Of more pairs, the first attempts of `pairs`
            are made together, then those in doubt.
        cache: as `jfsf.match`: keep programs on disk. Those for more pairs never are.

    Raises:
        ValueError: the lists differ in length, a spectrum has too few eigenpairs (with
            the number of its pair), settings or batch sizes that do not fit.
    """
    check_batch(pairs, batch_size)
    sizes = _sizes("match_spectra", specs_x=specs_x, specs_y=specs_y)
    needed = settings.search.eigenpairs
    for i, pair in enumerate(zip(specs_x, specs_y, strict=True)):
        if (least := min(len(spec.evals) for spec in pair)) < needed:
            raise ValueError(
                f"pair {i}: match_spectra: a spectrum has {least} eigenpairs, the "
                f"search needs {needed}"
            )
    inputs = MatchInputs(sign=orientation_sign(orientation))
    devices = devices or jax.local_devices()
    alone = len(devices) == 1 and devices[0].platform == "cpu"
    runner, together, place = Vmapped(devices, pairs, batch_size), pairs, np.asarray
    if alone and batch_size in (None, 1):
        runner, together, place = OneByOne(cache), 1, jnp.asarray
    matches = []
    for first in range(0, len(sizes), together):
        some = range(first, min(first + together, len(sizes)))
        with jax.default_device(devices[0]):
            given = (padded_pair(specs_x[i], specs_y[i]) for i in some)
            states = [PairState(jax.tree.map(place, p), inputs) for p in given]
            found = match_pairs(states, runner, settings=settings)
        host = (jax.tree.map(np.asarray, match) for match in found)
        matches += [
            match.without_padding(*sizes[i])
            for i, match in zip(some, host, strict=True)
        ]
    return matches


def _convert(emb_x, marginal_x, emb_y, marginal_y, *, converter):
    return maps_of(converter(emb_x, emb_y, marginal_x, marginal_y, None))


def _with_marginal(emb, size):
    emb = np.asarray(emb)
    real = (np.arange(size) < len(emb)) / emb.dtype.type(len(emb))
    return with_rows(emb, size), real


def _sizes(function, **lists):
    """(n_x, n_y) of each pair."""
    counts = {name: len(items) for name, items in lists.items()}
    if len(set(counts.values())) > 1:
        raise ValueError(f"{function}: not one of each a pair, got {counts}")
    for name in ("specs_x", "specs_y"):
        for i, spec in enumerate(lists.get(name, ())):
            check_spectrum(spec, f"{function}: {name}[{i}]")
    first, second, *_ = lists.values()
    return [(_rows_of(x), _rows_of(y)) for x, y in zip(first, second, strict=True)]


def _rows_of(shape):
    return len(shape.mass if isinstance(shape, Spectrum) else shape)

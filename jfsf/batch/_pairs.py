"""Conversion, refinement, search and the whole pipeline over many pairs of shapes.

Pairs of unequal sizes are padded to a few common ones (`jfsf.array.common_size`), so a
hundred pairs of mixed sizes cost a handful of compilations. Results come back unpadded,
as numpy arrays in the order of the pairs: those of a loop over the pairs, up to ties.
"""

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float

from jfsf.array import common_size, pad
from jfsf.batch._map_pairs import map_pairs
from jfsf.convert import Converter, maps_of, sinkhorn
from jfsf.initial import Candidates
from jfsf.initial import search as search_one
from jfsf.pipeline import match_spectra as match_one
from jfsf.refine import zoomout
from jfsf.spectral import truncate_pair
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
        embs_x, embs_y: one of each a pair (`jfsf.spectral.embeddings`); n_x, n_y and k
            are any.
        converter: any `jfsf.convert.Converter`, hashable; every vertex has the same
            marginal.
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
    found = map_pairs(_convert, inputs, converter=converter, **sharding)
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
        specs_x, specs_y, Cs_yx: one of each a pair; pairs with equal numbers of
            eigenpairs share programs.
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
        specs_x, specs_y, descs_x, descs_y: one of each a pair.
        options: the static options of `jfsf.initial.search`, such as `orientation`;
            `devices`, `pairs` and `batch_size` of `map_pairs`.

    Raises:
        ValueError: as `convert`.
    """
    _sizes("search", specs_x=specs_x, specs_y=specs_y, descs_x=descs_x, descs_y=descs_y)

    def padded(x, y, desc_x, desc_y):
        x, y = padded_pair(x, y)
        return x, y, _rows(desc_x, len(x.mass)), _rows(desc_y, len(y.mass))

    inputs = map(padded, specs_x, specs_y, descs_x, descs_y)
    return map_pairs(search_one, inputs, fast_compile=True, **options)


def match_spectra(
    specs_x: Sequence[Spectrum], specs_y: Sequence[Spectrum], **options: Any
) -> list[Match]:
    """`jfsf.match` of each pair, from the spectra on.

    Args:
        specs_x, specs_y: one of each a pair, from `jfsf.basis`. Each pair is
            cut to equal numbers of eigenpairs; pairs with equal numbers share programs.
        options: `orientation` and `settings` of `jfsf.match_spectra`, but no landmarks,
            descriptors or initial maps; `devices`, `pairs` and `batch_size` of
            `map_pairs`.

    Raises:
        ValueError: as `convert`.
    """
    sizes = _sizes("match_spectra", specs_x=specs_x, specs_y=specs_y)
    pairs = zip(specs_x, specs_y, strict=True)
    inputs = (padded_pair(*truncate_pair(*pair)) for pair in pairs)
    found = map_pairs(match_one, inputs, fast_compile=True, **options)
    return [_cut(one, *n) for one, n in zip(found, sizes, strict=True)]


def padded_pair(spec_x: Spectrum, spec_y: Spectrum) -> tuple[Spectrum, Spectrum]:
    """Both spectra as numpy arrays, padded to one common size, for `map_pairs`.

    Pairs of many sizes are padded to few: n vertices (`jfsf.array.common_size`), and
    2 n faces. Mass 0 and face (0, 0, 0) mark the padding. `jfsf.match` leaves very
    different sizes apart.
    """
    x, y = (jax.tree.map(np.asarray, spec) for spec in (spec_x, spec_y))
    # A closed surface has twice as many faces as vertices, so one size decides both.
    half = -(-max(len(x.faces), len(y.faces)) // 2)
    size = common_size(max(len(x.mass), len(y.mass), half))
    return pad(x, size, 2 * size), pad(y, size, 2 * size)


def _convert(emb_x, marginal_x, emb_y, marginal_y, *, converter):
    return maps_of(converter(emb_x, emb_y, marginal_x, marginal_y))


def _with_marginal(emb, size):
    padded = _rows(emb, size)
    return padded, (np.arange(size) < len(emb)) / padded.dtype.type(len(emb))


def _rows(array, size):
    array = np.asarray(array)
    return np.pad(array, ((0, size - len(array)), (0, 0)))


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

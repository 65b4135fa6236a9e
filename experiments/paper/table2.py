"""Table 2 of Pai et al. (CVPR 2021): refinement of an initial map.

The start is the data folder's WKSini_direct/X_Y.map or, where there is none, the
nearest-neighbour map of a fit to descriptors (WKS, 30 x 30, all four terms). ICP and
ZoomOut compare in the direct space, as is usual.

    python -m experiments.paper.table2 --embedded --out experiments/results/table2.json
    python -m experiments.paper.table2 --data TOSCA --spread 60 --out t2.json
"""

from functools import partial
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from experiments.accuracy import datasets
from experiments.paper import compare
from experiments.paper.baselines import bcicp, deblur, pmf, rhm
from jfsf.convert import nearest, sinkhorn
from jfsf.initial import fit
from jfsf.refine import icp, zoomout
from jfsf.runtime._sizes import common_size, pad
from jfsf.spectral import embeddings, functional_map, spectrum, truncate, uniform, wks
from jfsf.types import Maps, Mesh, Spectrum

K = 100  # eigenfunctions of the metrics, and of ZoomOut at its end
K_ICP = 50
K_PMF = 500  # as its authors have
KS = tuple(range(20, K + 1, 5))
FIT_K = 30
WKS_EVERY = 5


class Start(NamedTuple):
    """specs: padded, so that pairs of nearly equal size share their programs."""

    pair: compare.Pair
    specs: tuple[Spectrum, Spectrum]
    maps: Maps

    @classmethod
    def of(cls, pair: compare.Pair, maps: Maps) -> "Start":
        x, y = (pad(spec, size := _padded_size(spec), 2 * size) for spec in pair[2:])
        return cls(pair, (x, y), maps)

    def C_yx(self, k: int) -> Float[Array, "k k"]:
        specs = (truncate(spec, k) for spec in self.pair[2:])
        return functional_map(self.maps.T_xy, *specs)


def _padded_size(spec: Spectrum) -> int:
    """Vertices; a closed surface has twice as many faces."""
    return common_size(max(len(spec.mass), -(-len(spec.faces) // 2)))


def convert(start: Start, C_yx, converter) -> Maps:
    """The maps of the unpadded shapes, from C_yx in the direct space."""
    emb = embeddings(C_yx, *(spec.evecs for spec in start.specs), space="direct")
    maps = converter(*emb, *(uniform(spec.mass) for spec in start.specs))
    n_x, n_y = (len(spec.mass) for spec in start.pair[2:])
    return Maps(maps.T_xy[:n_x], maps.T_yx[:n_y])


def _icp(start: Start, converter) -> Maps:
    first = start.C_yx(K_ICP)
    C_yx = icp(*start.specs, first, converter=converter, space="direct")
    return convert(start, C_yx, converter)


def _zoomout(start: Start, converter) -> Maps:
    C_yx = zoomout(*start.specs, start.C_yx(KS[0]), ks=KS, converter=converter)
    return convert(start, C_yx, converter)


def _meshes(start: Start) -> tuple[Mesh, Mesh]:
    return start.pair.x.mesh, start.pair.y.mesh


def _pmf(start: Start) -> Maps:
    x, y = _meshes(start)
    return pmf(spectrum(x, K_PMF), spectrum(y, K_PMF), start.maps.T_xy)


def _bcicp(start: Start) -> Maps:
    x, y = _meshes(start)
    spec_x, spec_y = start.pair[2:]
    return bcicp(x, y, spec_x, spec_y, start.maps)


METHODS: dict[str, compare.Method] = {
    "Ini": lambda start: start.maps,
    "ICP": lambda start: _icp(start, nearest),
    "ICP (sink)": lambda start: _icp(start, sinkhorn),
    "Deblur": lambda start: deblur(start.pair[2], start.pair[3], start.maps),
    "RHM": lambda start: rhm(*_meshes(start), start.maps),
    "PMF": _pmf,
    "BCICP": _bcicp,
    "ZoomOut": lambda start: _zoomout(start, nearest),
    "ZoomOut (sink)": lambda start: _zoomout(start, sinkhorn),
}


def main() -> None:
    parser = compare.arguments(__doc__, METHODS, "table2.json")
    args = parser.parse_args()
    datasets.check_arguments(parser, args)

    start = partial(start_of, args)
    compare.run(args, METHODS, start, k=K, functional=True)


def start_of(args, names: tuple[str, str], pair: compare.Pair) -> Start:
    """The maps that every method is given."""
    x, y = names
    there = datasets.initial_map(args, x, y)
    back = datasets.initial_map(args, y, x)
    if there is None:
        return Start.of(pair, _fitted(pair))
    if back is None:
        return Start.of(pair, _reversed(pair, there))
    return Start.of(pair, Maps(jnp.asarray(there), jnp.asarray(back)))


def _fitted(pair: compare.Pair) -> Maps:
    desc_x, desc_y = (wks(spec)[:, ::WKS_EVERY] for spec in pair[2:])
    C_yx = fit(*pair[2:], desc_x, desc_y, k=FIT_K).C_yx
    return _nearest(pair, C_yx)


def _reversed(pair: compare.Pair, T_xy: np.ndarray) -> Maps:
    specs = (truncate(spec, FIT_K) for spec in pair[2:])
    back = _nearest(pair, functional_map(jnp.asarray(T_xy), *specs))
    return Maps(jnp.asarray(T_xy), back.T_yx)


def _nearest(pair: compare.Pair, C_yx) -> Maps:
    evecs = (spec.evecs for spec in pair[2:])
    return nearest(*embeddings(C_yx, *evecs, space="direct"))


if __name__ == "__main__":
    main()

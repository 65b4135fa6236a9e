"""The pure functions of the package, each as a function of one small problem.

A problem holds all that any of them reads, so one set of checks serves them all. Y is
padded.
"""

from collections.abc import Callable
from functools import cache, partial
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jfsf import (
    Settings,
    convert,
    evaluate,
    geometry,
    initial,
    match_spectra,
    neighbours,
    refine,
    spectral,
)
from jfsf.convert._variants import quick_sinkhorn
from jfsf.geometry._surface import surface
from jfsf.initial import SearchSettings
from jfsf.neighbours import NeighbourSearch, spectral_tiles
from jfsf.runtime._sizes import pad
from jfsf.testing import blob, cast
from jfsf.types import Filtered, Maps, PreciseMap, Spectrum, Tiles

K, PADDING = 8, 5
FLAT = "what it returns are integers, or depends on its input by steps alone"
EAGER = "a few operations that are not compiled by themselves: their constants travel"
OPTIMISTIX = "optimistix begins its loop with a constant, which may not become varying"
SCALARS = "its numbers are Python's, and travel with each call outside of jax.jit"
SOLVED = "either mode solves systems to a tolerance, so they differ by as much"
SEARCH = "its maps come from a search, whose curvatures have no slope on padding"
NO_FIGURE = "figures of the certificate that were not measured are nan"
UNKNOWN = "the recall is nan, as who made the kernel knows it"
WHILE = "its second pass is a loop of unknown length, which has no derivative backwards"
LINEAX = "lineax describes arrays without the axes that they vary over"


class Problem(NamedTuple):
    """Two shapes, and what the stages make of them.

    whole: two others with as many eigenpairs as `match_spectra` needs.
    """

    x: Spectrum
    y: Spectrum
    C_yx: Any
    emb_x: Any
    emb_y: Any
    mass_x: Any
    mass_y: Any
    desc_x: Any
    desc_y: Any
    maps: Maps
    filtered: Filtered
    pmap: PreciseMap
    tiles: tuple[Tiles, Tiles]
    C_low: Any
    samples: Any
    target_y: Any
    reach: Any
    lam: Any
    tol: Any
    whole: tuple[Spectrum, Spectrum]


class Case(NamedTuple):
    """A function, and why some transformations of it cannot be.

    run: of a problem.
    cannot: reasons by the name of the transformation.
    """

    run: Callable[[Problem], Any]
    cannot: dict[str, str] = {}


@cache
def spectrum_of(seed: int) -> Spectrum:
    return spectral.spectrum(blob(seed, subdivisions=1), K, cache=False)


@cache
def problem(dtype, seed=0) -> Problem:
    """Of this precision."""
    x = cast(spectrum_of(seed), dtype)
    y = cast(pad(spectrum_of(seed + 1), 42 + PADDING, 80 + 6), dtype)
    rng = np.random.default_rng(seed)
    C_yx = jnp.asarray(np.eye(K) + 0.1 * rng.normal(size=(K, K)), dtype)
    emb_x, emb_y = spectral.embeddings(C_yx, x.evecs, y.evecs)
    mass_x, mass_y = spectral.uniform(x.mass), spectral.uniform(y.mass)
    filtered = convert.sinkhorn(emb_x, emb_y, mass_x, mass_y, k0=4, num_iters=6)
    return Problem(
        x,
        y,
        C_yx,
        emb_x,
        emb_y,
        mass_x,
        mass_y,
        jnp.asarray(rng.normal(size=(42, 3)), dtype),
        jnp.asarray(rng.normal(size=(42 + PADDING, 3)), dtype),
        convert.maps_of(filtered),
        filtered,
        PreciseMap(
            jnp.asarray(np.asarray(y.faces)[rng.integers(80, size=42)], jnp.int32),
            jnp.asarray(rng.dirichlet(np.ones(3), 42), dtype),
        ),
        (spectral_tiles(x), spectral_tiles(y)),
        C_yx[:4, :4],
        filtered.T_xy[:12],
        x.vertices[filtered.T_yx],
        jnp.asarray(1, dtype),
        jnp.asarray(4, dtype),
        jnp.asarray(1e-3, dtype),
        whole_of(dtype, seed),
    )


def whole_of(dtype, seed) -> tuple[Spectrum, Spectrum]:
    """Spectra of two shapes; that of Y is padded."""
    x, y = (spectral.spectrum(blob(seed + i), 40, cache=False) for i in (0, 1))
    return cast(x, dtype), cast(pad(y, 162 + PADDING, 320 + 6), dtype)


# Every stage of `match_spectra`, in short.
SHORT = Settings(
    ks=(30, 40), k=40, bend_rounds=1, search=SearchSettings(final_ks=(30, 30))
)
small = partial(convert.sinkhorn, k0=4, num_iters=6)
soft = partial(small, relax=1.0)


def embs(p: Problem):
    return p.emb_x, p.emb_y, p.mass_x, p.mass_y


def search_of(p: Problem) -> NeighbourSearch:
    return NeighbourSearch(p.tiles)


CASES = {
    "neighbours": Case(lambda p: neighbours.neighbours(p.emb_x, p.emb_y, k0=3)),
    "spectral_tiles": Case(lambda p: spectral_tiles(p.x), {"grad": FLAT, "jvp": FLAT}),
    "embeddings": Case(lambda p: spectral.embeddings(p.C_yx, p.x.evecs, p.y.evecs)),
    "functional_map": Case(lambda p: spectral.functional_map(p.maps.T_xy, p.x, p.y)),
    "polar": Case(lambda p: spectral.polar(p.C_yx)),
    "uniform": Case(
        lambda p: spectral.uniform(p.y.mass),
        {"grad": FLAT, "jvp": FLAT, "transfer_guard": EAGER},
    ),
    "wks": Case(lambda p: spectral.wks(p.y, num=4)),
    "hks": Case(lambda p: spectral.hks(p.y, num=4)),
    "curvature": Case(lambda p: spectral.curvature(p.y)),
    "farthest_points": Case(
        lambda p: spectral.farthest_points(p.y, num=9), {"grad": FLAT, "jvp": FLAT}
    ),
    "restrict": Case(
        lambda p: spectral.restrict(p.y, p.samples), {"transfer_guard": EAGER}
    ),
    "features": Case(lambda p: spectral.features(p.y)),
    "normals": Case(
        lambda p: geometry.normals(p.y.vertices, p.y.faces), {"transfer_guard": EAGER}
    ),
    "nearest": Case(lambda p: convert.nearest(*embs(p)), {"grad": FLAT, "jvp": FLAT}),
    "nearest, tiles": Case(
        lambda p: convert.nearest(*embs(p), search_of(p)), {"grad": FLAT, "jvp": FLAT}
    ),
    "sinkhorn": Case(lambda p: small(*embs(p))),
    "sinkhorn, tiles": Case(lambda p: small(*embs(p), search_of(p))),
    "sinkhorn, reach": Case(lambda p: small(*embs(p), reach=p.reach)),
    "sinkhorn, tol": Case(
        lambda p: convert.sinkhorn(*embs(p), k0=12, lam=p.lam, tol=p.tol),
        {"shard_map": OPTIMISTIX, "jvp": SOLVED},
    ),
    "quick_sinkhorn": Case(
        lambda p: quick_sinkhorn(*embs(p)), {"transfer_guard": SCALARS}
    ),
    "authors_sinkhorn": Case(
        lambda p: convert.authors_sinkhorn(*embs(p)), {"transfer_guard": SCALARS}
    ),
    "algorithm_2": Case(lambda p: convert.algorithm_2(*embs(p), lam=p.lam, k0=4)),
    "scale_kernel": Case(
        lambda p: convert.scale_kernel(
            p.filtered.kernel, p.mass_x, p.mass_y, num_iters=6
        ),
        {"debug_nans": UNKNOWN},
    ),
    "pull_back": Case(lambda p: convert.pull_back(p.filtered, p.desc_y)),
    "plan": Case(lambda p: convert.plan(p.filtered)),
    "precise": Case(
        lambda p: convert.precise(p.emb_x, p.emb_y, p.y.faces),
        {"grad": WHILE, "jvp": WHILE},  # compared with those of reverse mode
    ),
    "functional_map_precise": Case(
        lambda p: convert.functional_map_precise(p.pmap, p.x, p.y)
    ),
    "pull_back_precise": Case(lambda p: convert.pull_back_precise(p.pmap, p.desc_y)),
    "to_vertex": Case(lambda p: convert.to_vertex(p.pmap), {"grad": FLAT, "jvp": FLAT}),
    "icp": Case(
        lambda p: refine.icp(p.x, p.y, p.C_yx, num_iters=2, converter=convert.nearest)
    ),
    "zoomout": Case(
        lambda p: refine.zoomout(
            p.x, p.y, p.C_yx, ks=(4, 6, 8), converter=small, weighted=True
        )
    ),
    "soft_map": Case(lambda p: refine.soft_map(p.x, p.y, p.C_yx, converter=soft)),
    "soft_functional_map": Case(
        lambda p: refine.soft_functional_map(p.filtered, p.x, p.y)
    ),
    "soft_zoomout_step": Case(
        lambda p: refine.soft_zoomout_step(p.x, p.y, p.C_low, k=6, converter=soft)
    ),
    "soft_icp_step": Case(
        lambda p: refine.soft_icp_step(p.x, p.y, p.C_yx, converter=soft)
    ),
    "arap": Case(
        lambda p: refine.arap(p.x, p.y, p.maps, rounds=2, converter=convert.nearest),
        {"jvp": SOLVED},
    ),
    "deform": Case(
        lambda p: refine.deform(
            surface(p.y.vertices, p.y.faces, p.y.mass),
            p.target_y,
            p.y.vertices,
            p.y,
        ),
        {"jvp": SOLVED},
    ),
    "fit": Case(lambda p: initial.fit(p.x, p.y, p.desc_x, p.desc_y, k=6)),
    "fit, lineax": Case(
        lambda p: initial.fit(p.x, p.y, p.desc_x, p.desc_y, k=6, solver="lineax"),
        {"shard_map": LINEAX},
    ),
    "fit, huber": Case(
        lambda p: initial.fit(p.x, p.y, p.desc_x, p.desc_y, k=6, loss="huber"),
        {"shard_map": LINEAX},
    ),
    "orthogonality": Case(lambda p: evaluate.orthogonality(p.C_yx)),
    "laplacian_commutativity": Case(
        lambda p: evaluate.laplacian_commutativity(p.C_yx, p.x.evals, p.y.evals)
    ),
    "zoomout_energy": Case(lambda p: evaluate.zoomout_energy(p.C_yx)),
    "spectral_chamfer": Case(
        lambda p: evaluate.spectral_chamfer(p.emb_x, p.emb_y, mass_y=p.mass_y)
    ),
    "coverage": Case(lambda p: evaluate.coverage(p.maps.T_xy, p.y.mass)),
    "match_spectra": Case(
        lambda p: match_spectra(*p.whole, settings=SHORT),
        {
            "grad": SEARCH,
            "jvp": SEARCH,
            "debug_nans": NO_FIGURE,
            "transfer_guard": EAGER,
        },
    ),
}

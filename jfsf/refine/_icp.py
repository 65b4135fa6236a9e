"""Spectral ICP: alternate map and functional map, made orthonormal each time.

Ovsjanikov et al. (SIGGRAPH 2012), as an instance of algorithm 1 of Pai et al. (CVPR
2021), with any converter.
"""

import jax
from jaxtyping import Array, Float

from jfsf.array._jit import jit
from jfsf.array._loops import varying_as
from jfsf.convert import Converter, maps_of
from jfsf.neighbours import NeighbourSearch
from jfsf.spectral import embeddings, functional_map, polar, truncate, uniform
from jfsf.spectral._functional_maps import Space
from jfsf.types import Spectrum


@jit(static_argnames=("num_iters", "converter", "space"))
def icp(
    spec_x: Spectrum,
    spec_y: Spectrum,
    C_yx: Float[Array, "k_x k_y"],
    *,
    num_iters: int = 10,
    converter: Converter,
    space: Space = "adjoint",
    search: NeighbourSearch | None = None,
) -> Float[Array, "k_x k_y"]:
    """Refine C_yx at its own size.

    Algorithm 1 of Pai et al. (CVPR 2021), with C = U V^T, of the SVD of the functional
    map (eq. 4), in place of that map in each round.

    Args:
        spec_x, spec_y: as many eigenpairs as C_yx has rows and columns, or more.
        C_yx: the start.
        converter: any `jfsf.convert.Converter`.
        space: which embeddings the converter compares; see `jfsf.spectral.embeddings`.
        search: how neighbours are searched, handed to the converter.

    Returns:
        The last functional map, with orthonormal columns (rows if there are fewer).

    Raises:
        ValueError: C_yx is larger than a basis, or num_iters is negative.
    """
    if num_iters < 0:
        raise ValueError(f"icp: num_iters is {num_iters}, it must not be negative")
    k_x, k_y = C_yx.shape
    spec_x, spec_y = truncate(spec_x, k_x), truncate(spec_y, k_y)
    C_yx = C_yx.astype(spec_x.evecs.dtype)
    marginals = uniform(spec_x.mass), uniform(spec_y.mass)

    def step(C_yx, _):
        emb_x, emb_y = embeddings(C_yx, spec_x.evecs, spec_y.evecs, space=space)
        maps = maps_of(converter(emb_x, emb_y, *marginals, search))
        return polar(functional_map(maps.T_xy, spec_x, spec_y)), None

    start = varying_as(C_yx, spec_x, spec_y, search)
    return jax.lax.scan(step, start, None, length=num_iters)[0]

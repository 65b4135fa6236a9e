"""Soft steps of ZoomOut and ICP: differentiable, for losses on pairs of shapes.

A soft map sends a vertex of X to its row of a transport plan, in place of the row's
largest entry. Its functional map pulls back functions as averages over that row. A
chain of such steps is differentiable in the spectra, the functional map and the
filter's arguments; `Filtered` at its end also holds the point-to-point maps.

Soft maps are those of the learned functional maps, as in Marin et al. (Correspondence
Learning via Linearly-invariant Embedding, 2020), with the plan of algorithm 2 of Pai et
al. (CVPR 2021) in place of a softmax.
"""

from collections.abc import Callable
from functools import partial

from jaxtyping import Array, Float

from jfsf.array._jit import jit
from jfsf.convert import pull_back, sinkhorn
from jfsf.neighbours import NeighbourSearch
from jfsf.spectral import embeddings, polar, truncate, uniform
from jfsf.spectral._functional_maps import Space, coefficients
from jfsf.types import Filtered, Spectrum

soft_sinkhorn: partial[Filtered] = partial(
    sinkhorn, k0=10, lam=10.0, num_iters=12, relax=1.0
)
soft_sinkhorn.__doc__ = """`sinkhorn` with a kernel soft enough for derivatives.

It uses ten neighbours and twelve plain updates.
Arguments and result are those of `jfsf.convert.sinkhorn`.
"""


@jit(static_argnames=("space", "converter"))
def soft_map(
    spec_x: Spectrum,
    spec_y: Spectrum,
    C_yx: Float[Array, "k_x k_y"],
    *,
    space: Space = "direct",
    converter: Callable[..., Filtered] = soft_sinkhorn,
    search: NeighbourSearch | None = None,
) -> Filtered:
    """The plan between the embeddings that C_yx aligns, with uniform marginals.

    Steps 1 and 2 of algorithm 2 of Pai et al. (CVPR 2021).

    Args:
        spec_x, spec_y: as many eigenpairs as C_yx has rows and columns, or more.
        C_yx: functions on Y pulled back to X.
        space: see `jfsf.spectral.embeddings`.
        converter: `jfsf.convert.sinkhorn` with any arguments, also with tol=.
        search: how neighbours are searched, handed to the converter.

    Raises:
        ValueError: C_yx is larger than a basis.
    """
    emb_x, emb_y = embeddings(C_yx, spec_x.evecs, spec_y.evecs, space=space)
    marginals = uniform(spec_x.mass), uniform(spec_y.mass)
    return converter(emb_x, emb_y, *marginals, search)


@jit
def soft_functional_map(
    filtered: Filtered, spec_x: Spectrum, spec_y: Spectrum
) -> Float[Array, "k_x k_y"]:
    """The functional map C_yx = Phi_X^+ S Phi_Y of a plan S, its rows scaled to sum 1.

    Args:
        filtered: the result of a filter between the vertices of X and Y.
        spec_x, spec_y: the spectra, whose eigenpairs give the size of C_yx.
    """
    return coefficients(pull_back(filtered, spec_y.evecs), spec_x)


@jit(static_argnames=("k", "space", "converter"))
def soft_zoomout_step(
    spec_x: Spectrum,
    spec_y: Spectrum,
    C_yx: Float[Array, "l m"],
    *,
    k: int,
    space: Space = "direct",
    converter: Callable[..., Filtered] = soft_sinkhorn,
    search: NeighbourSearch | None = None,
) -> Float[Array, "k k"]:
    """The functional map with k eigenfunctions of the soft map of C_yx.

    Arguments and errors as for `soft_map`; ValueError if there are fewer than k
    eigenpairs.
    """
    options = {"space": space, "converter": converter, "search": search}
    found = soft_map(spec_x, spec_y, C_yx, **options)
    return soft_functional_map(found, truncate(spec_x, k), truncate(spec_y, k))


@jit(static_argnames=("space", "converter"))
def soft_icp_step(
    spec_x: Spectrum,
    spec_y: Spectrum,
    C_yx: Float[Array, "k_x k_y"],
    *,
    space: Space = "adjoint",
    converter: Callable[..., Filtered] = soft_sinkhorn,
    search: NeighbourSearch | None = None,
) -> Float[Array, "k_x k_y"]:
    """The functional map of the soft map of C_yx at its own size, made orthonormal.

    Arguments and errors as for `soft_map`.
    """
    k_x, k_y = C_yx.shape
    options = {"space": space, "converter": converter, "search": search}
    found = soft_map(spec_x, spec_y, C_yx, **options)
    C_yx = soft_functional_map(found, truncate(spec_x, k_x), truncate(spec_y, k_y))
    return polar(C_yx)

"""Deblur: precise maps from functional maps, and rough maps made smooth by them.

Ezuz and Ben-Chen, Deblurring and denoising of maps between shapes (SGP 2017). The
precise map P (n_x, n_y), whose rows are barycentric coordinates on one triangle of Y,
is recovered from C_yx by

    min |Phi_X^+ P Phi_Y - C_yx|^2 + |(I - Phi_X Phi_X^+) P Phi_Y|^2_A
      = min |P Phi_Y - Phi_X C_yx|^2_A:

the first term undoes the blur of the small basis, the second asks P to carry smooth
functions to smooth ones. The rows are independent: each takes the point nearest to its
row of Phi_X C_yx on the triangles of Y embedded by Phi_Y. The same step on the
functional map of a noisy map, Phi_X^+ P Phi_Y, denoises it. Here the two alternate.

Each direction is refined by itself. The default size of the basis and the default
number of rounds are not from the paper; `num_iters=1` is a single recovery.
"""

import jax.numpy as jnp
import numpy as np

from jfsf.convert import functional_map_precise, nearest, precise, to_vertex
from jfsf.geometry._geodesics import vertex_indices
from jfsf.spectral import embeddings, functional_map, truncate
from jfsf.spectral._functional_maps import Space
from jfsf.types import ArrayLike, Maps, PreciseMap, Spectrum


def deblur(
    spec_x: Spectrum,
    spec_y: Spectrum,
    start: ArrayLike | Maps,
    *,
    k: int = 50,
    num_iters: int = 5,
    space: Space = "adjoint",
) -> Maps:
    """Refine a map; see `deblur_precise`, whose points it rounds to vertices.

    Returns:
        The corner of largest weight of each point.

    Raises:
        ValueError: as `deblur_precise`.
    """
    pmap_xy, pmap_yx = deblur_precise(
        spec_x, spec_y, start, k=k, num_iters=num_iters, space=space
    )
    return Maps(to_vertex(pmap_xy), to_vertex(pmap_yx))


def deblur_precise(
    spec_x: Spectrum,
    spec_y: Spectrum,
    start: ArrayLike | Maps,
    *,
    k: int = 50,
    num_iters: int = 5,
    space: Space = "adjoint",
) -> tuple[PreciseMap, PreciseMap]:
    """Vertex-to-point maps X to Y and Y to X.

    Args:
        spec_x, spec_y: spectra of triangle meshes.
        start: `Maps` to denoise, each direction from its own; T_xy (n_x,) integers; or
            C_yx (k_x, k_y) to recover maps from. Without T_yx, the map from Y to X
            starts with the nearest rows of the embeddings that C_yx aligns.
        k: eigenpairs of both shapes in which a vertex map is represented, or as many as
            there are if fewer; C_yx keeps its size.
        num_iters: recoveries; between two of them C_yx is that of the precise map.
        space: "adjoint" is the paper's (Phi_X C_yx, Phi_Y); "direct" (Phi_X,
            Phi_Y C_yx^T) holds up better where C_yx is far from orthonormal.

    Raises:
        ValueError: start does not fit the spectra, a shape has no faces, or an option
            is out of range.
    """
    name = "deblur"
    if k < 1 or num_iters < 1:
        raise ValueError(
            f"{name}: k and num_iters must be 1 or more, got {k} and {num_iters}"
        )
    for argument, spec in (("spec_x", spec_x), ("spec_y", spec_y)):
        if len(spec.faces) == 0:
            raise ValueError(
                f"{name}: {argument} has 0 faces; points lie on triangles, give a mesh"
            )
    spec_x, spec_y = (Spectrum(*map(jnp.asarray, s)) for s in (spec_x, spec_y))
    n_x, n_y = len(spec_x.mass), len(spec_y.mass)
    T_yx = None
    if isinstance(start, Maps):
        T_xy = _vertex_map(name, "start.T_xy", start.T_xy, n_x, n_y)
        T_yx = _vertex_map(name, "start.T_yx", start.T_yx, n_y, n_x)
    elif np.ndim(start) == 1:
        T_xy = _vertex_map(name, "start", start, n_x, n_y)
    elif np.ndim(start) == 2:
        T_xy = None
    else:
        raise ValueError(
            f"{name}: start has shape {np.shape(start)}, expected Maps, (n_x,) or "
            "(k_x, k_y)"
        )
    if T_xy is None:
        C_yx = jnp.asarray(start, spec_x.evecs.dtype)
        _check_fits(name, C_yx, spec_x, spec_y)
        spec_x, spec_y = truncate(spec_x, len(C_yx)), truncate(spec_y, C_yx.shape[1])
    else:
        spec_x, spec_y = (truncate(s, min(k, len(s.evals))) for s in (spec_x, spec_y))
        C_yx = functional_map(T_xy, spec_x, spec_y)
    if T_yx is None:
        T_yx = nearest(*embeddings(C_yx, spec_x.evecs, spec_y.evecs, space=space)).T_yx
    C_xy = functional_map(T_yx, spec_y, spec_x)
    return (
        _alternate(spec_x, spec_y, C_yx, num_iters, space),
        _alternate(spec_y, spec_x, C_xy, num_iters, space),
    )


def _alternate(spec_x, spec_y, C_yx, num_iters, space) -> PreciseMap:
    def recover(C_yx):
        emb_x, emb_y = embeddings(C_yx, spec_x.evecs, spec_y.evecs, space=space)
        return precise(emb_x, emb_y, spec_y.faces)

    pmap = recover(C_yx)
    for _ in range(num_iters - 1):
        pmap = recover(functional_map_precise(pmap, spec_x, spec_y))
    return pmap


def _vertex_map(name, argument, T, n_from, n_to):
    T = vertex_indices(name, argument, T, n_to)
    if len(T) != n_from:
        raise ValueError(
            f"{name}: {argument} has {len(T)} entries, its shape has {n_from} "
            "vertices; is it the map the other way?"
        )
    return jnp.asarray(T, jnp.int32)


def _check_fits(name, C_yx, spec_x, spec_y):
    most = len(spec_x.evals), len(spec_y.evals)
    if C_yx.shape[0] > most[0] or C_yx.shape[1] > most[1]:
        raise ValueError(
            f"{name}: start is {C_yx.shape}, the spectra have {most} eigenpairs; "
            "compute more, or cut it"
        )

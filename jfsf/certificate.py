"""Evidence of how good a map is, from the map and the spectra alone."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf.metrics import coverage, orthogonality
from jfsf.orientation import SEEN, brackets, score
from jfsf.sampling import biharmonic
from jfsf.types import Certificate, Filtered, Spectrum


@jax.jit
def certify(
    filtered: Filtered,
    emb_x: Float[Array, "n_x d"],
    emb_y: Float[Array, "n_y d"],
    C_yx: Float[Array, "k_x k_y"],
    spec_x: Spectrum,
    spec_y: Spectrum,
    gap: Float[Array, ""] | float = jnp.nan,
) -> Certificate:
    """The evidence for `filtered`, which came from (emb_x, emb_y).

    Args:
        filtered: the maps and their plan.
        emb_x, emb_y: the aligned embeddings that were converted.
        C_yx: the functional map of filtered.T_xy.
        spec_x, spec_y: spectra; faces wound outward, or none.
        gap: of the search that began it, if one did.
    """
    T_xy, T_yx = filtered.T_xy, filtered.T_yx
    real_x = spec_x.mass > 0
    # Neighbours stand in order.
    agree = jnp.sum(real_x & (filtered.kernel.idx_xy[:, 0] == T_xy)) / jnp.sum(real_x)
    every = (C_yx, emb_x, emb_y, filtered.f, filtered.g)
    finite = jnp.stack([jnp.all(jnp.isfinite(x)) for x in every]).all()
    k = min(SEEN, *C_yx.shape)
    return Certificate(
        marginal_error=filtered.marginal_error,
        empty=filtered.empty_x + filtered.empty_y,
        coverage_xy=coverage(T_xy, spec_y.mass, mass_x=spec_x.mass),
        coverage_yx=coverage(T_yx, spec_x.mass, mass_x=spec_y.mass),
        bijectivity_x=_there_and_back(T_yx[T_xy], spec_x),
        bijectivity_y=_there_and_back(T_xy[T_yx], spec_y),
        orthogonality=orthogonality(C_yx),
        orientation=score(C_yx, brackets(spec_x, k=k), brackets(spec_y, k=k)),
        gap=jnp.asarray(gap, C_yx.dtype),
        nn_agreement=agree.astype(C_yx.dtype),
        finite=finite,
    )


def _there_and_back(returned, spec: Spectrum):
    points = biharmonic(spec)
    moved = jnp.sqrt(jnp.sum((points - points[returned]) ** 2, 1))
    # Mean squared distance of two random vertices is twice the variance.
    centre = spec.mass @ points
    spread = jnp.sqrt(2 * spec.mass @ jnp.sum((points - centre[None]) ** 2, 1))
    return spec.mass @ moved / spread

"""Point descriptors from the spectrum: WKS and HKS, global or seen from landmarks.

WKS: Aubry, Schlickewei and Cremers (2011). HKS: Sun, Ovsjanikov and Guibas (2009). The
ranges are automatic, with the constants the field has settled on. Spectra are of unit
area, so none of this changes with the size of the mesh.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jfsf.types import Spectrum

SMALLEST = 1e-6  # eigenvalues below are the constant's: log and division stay finite


@partial(jax.jit, static_argnames="num")
def wks(
    spec: Spectrum, landmarks: Int[Array, " l"] | None = None, *, num: int = 100
) -> Float[Array, "n d"]:
    """Wave kernel signature at `num` log-spaced energies, low to high.

    Args:
        spec: all its eigenpairs take part; padding gets rows of zeros.
        landmarks: vertices; the signature then says how each vertex sees them.

    Returns:
        d = num columns, or num columns a landmark, one landmark after the other.

    Raises:
        ValueError: num is not positive, or fewer than three eigenpairs.
    """
    _check("wks", spec, num)
    energy = jnp.log(jnp.maximum(spec.evals, SMALLEST))
    low, high = energy[1], energy[-1]
    sigma = 7 * (high - low) / num
    centres = jnp.linspace(0, 1, num, dtype=energy.dtype)
    centres = low + 2 * sigma + centres * (high - low - 4 * sigma)
    weight = jnp.exp(-((centres[:, None] - energy) ** 2) / (2 * sigma**2))
    weight = jnp.where(spec.evals > SMALLEST, weight, 0)
    return _signature(spec, weight / weight.sum(1, keepdims=True), landmarks)


@partial(jax.jit, static_argnames="num")
def hks(
    spec: Spectrum, landmarks: Int[Array, " l"] | None = None, *, num: int = 100
) -> Float[Array, "n d"]:
    """Heat kernel signature at `num` log-spaced times, long to short.

    Times run from 4 ln 10 / lambda_2 to 4 ln 10 / lambda_k, each column divided by the
    heat trace. Arguments, result and errors as `wks`.
    """
    _check("hks", spec, num)
    evals = jnp.maximum(spec.evals, SMALLEST)
    times = jnp.geomspace(evals[1], evals[-1], num, dtype=evals.dtype)
    weight = jnp.exp(-4 * jnp.log(10.0).astype(evals.dtype) / times[:, None] * evals)
    return _signature(spec, weight / weight.sum(1, keepdims=True), landmarks)


def _signature(spec, weight, landmarks):
    if landmarks is None:
        return spec.evecs**2 @ weight.T
    seen = spec.evecs[landmarks][:, None] * weight
    return spec.evecs @ seen.reshape(-1, weight.shape[1]).T


def _check(name, spec, num):
    if num < 1:
        raise ValueError(f"{name}: num is {num}, it must be positive")
    if len(spec.evals) < 3:
        raise ValueError(f"{name}: needs 3 eigenpairs or more, got {len(spec.evals)}")

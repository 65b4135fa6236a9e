"""Point descriptors from the spectrum: WKS and HKS, global or seen from landmarks.

WKS: Aubry, Schlickewei and Cremers (2011). HKS: Sun, Ovsjanikov and Guibas (2009). The
ranges are automatic, with the constants the field has settled on. Spectra are of unit
area, so none of this changes with the size of the mesh; eigenvectors enter in pairs, so
none of it changes with their signs.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jfsf.array import matmul
from jfsf.array._jit import jit
from jfsf.array._precision import HIGHEST
from jfsf.geometry import normals
from jfsf.types import Spectrum

SMALLEST = 1e-6  # eigenvalues below are the constant's: log and division stay finite
# Times of the heat flow on a shape of area 1, no unit. Half the wavelengths that they
# damp are 0.04 to 0.3: from a wrist to a thigh.
CURVATURE_TIMES = (1 / 8000, 1 / 4000, 1 / 2000, 1 / 1000, 1 / 500, 1 / 250, 1 / 125)
CONSTANT = 100  # roundings of its values by which a constant column may vary


@jit(static_argnames="num")
def wks(
    spec: Spectrum, landmarks: Int[Array, " l"] | None = None, *, num: int = 100
) -> Float[Array, "n d"]:
    """Wave kernel signature at `num` energies, evenly spaced in log(eigenvalue).

    Gaussian bands of width sigma = 7 range / num, whose centres run from low to high
    and stay 2 sigma inside the range; with fewer than 28 they run the other way.

    Args:
        spec: all its eigenpairs but the constant take part; the range is theirs.
        landmarks: vertices, in range (not checked); column e of landmark p is then
            sum_i w_e(i) phi_i phi_i[p]: how each vertex sees it.

    Returns:
        (n, num), or (n, l num), one landmark after the other. The weights of a column
        sum to 1. Padding gets rows of zeros.

    Raises:
        ValueError: num is not positive, or fewer than three eigenpairs.
    """
    _check("wks", spec, num)
    energy = jnp.log(jnp.maximum(spec.evals, SMALLEST))
    low, high = energy[1], energy[-1]
    # Where all eigenvalues are one, any width will do.
    sigma = jnp.maximum(7 * (high - low) / num, 1e-3)
    centres = jnp.linspace(0, 1, num, dtype=energy.dtype)
    centres = low + 2 * sigma + centres * (high - low - 4 * sigma)
    log_weight = -((centres[:, None] - energy[None]) ** 2) / (2 * sigma**2)
    log_weight = jnp.where((spec.evals > SMALLEST)[None], log_weight, -jnp.inf)
    return _signature(spec, log_weight, landmarks)


@jit(static_argnames="num")
def hks(
    spec: Spectrum, landmarks: Int[Array, " l"] | None = None, *, num: int = 100
) -> Float[Array, "n d"]:
    """Heat kernel signature at `num` log-spaced times, long to short.

    Times run from 4 ln 10 / evals[1] to 4 ln 10 / evals[-1]; each column is divided by
    the heat trace. Arguments, result and errors are those of `wks`, but the constant
    eigenfunction takes part too.
    """
    _check("hks", spec, num)
    dtype = spec.evals.dtype
    low, high = jnp.maximum(spec.evals[jnp.array([1, -1])], SMALLEST)
    rate = jnp.geomspace(low, high, num, dtype=dtype)
    log_weight = -4 * jnp.log(10.0).astype(dtype) * spec.evals[None] / rate[:, None]
    return _signature(spec, log_weight, landmarks)


@jit(static_argnames="times")
def curvature(
    spec: Spectrum, *, times: tuple[float, ...] = CURVATURE_TIMES
) -> Float[Array, "n d"]:
    """Curvature of the surface in space at several heat scales; no spectrum holds it.

    Positions diffused by heat for a time t move along the mean curvature normal,
    dx/dt = -2 H n (Desbrun et al., 1999). The first columns are the steps between
    successive times along the outward normal, with their sign, so they tell a bump from
    a dent. The others are the lengths of the steps, which need no faces. A joint that
    bends changes both nearby only.

    Args:
        spec: with its vertices; faces wound outward. The finest scales sharpen with
            more eigenpairs, as the shortest time leaves three quarters of the 200th:
            compare shapes with equally many.
        times: increasing, on the shape of area 1.

    Returns:
        (n, 2 (times - 1)): signed, then unsigned, fine to coarse, in units of
        sqrt(area). Nothing changes under rigid motion, scaling or mirroring. Without
        faces the signed ones are 0. Rows of zeros on padding.
    """
    dtype = spec.evecs.dtype
    weight = jnp.exp(-spec.evals[None] * jnp.asarray(times, dtype)[:, None])
    flow = matmul((spec.evecs * spec.mass[:, None]).T, spec.vertices)
    flow = jnp.einsum("nk,tk,kc->tnc", spec.evecs, weight, flow, precision=HIGHEST)
    step = flow[:-1] - flow[1:]
    signed = jnp.sum(step * normals(flow[0], spec.faces)[None], 2)
    size = jnp.sum(step**2, 2)
    moved = size > 0
    size = jnp.where(moved, jnp.sqrt(jnp.where(moved, size, 1)), 0)
    return jnp.concatenate([signed, size]).T


@jit
def standardise(
    desc: Float[Array, "n d"], mass: Float[Array, " n"]
) -> Float[Array, "n d"]:
    """Each column with mean 0 and mean square 1 over the shape; 0 on padding.

    A column that is constant but for rounding becomes 0.
    """
    centred = desc - matmul(mass, desc)[None, :]
    square = matmul(mass, centred**2)
    rounded = CONSTANT * jnp.finfo(desc.dtype).eps
    varies = square > rounded**2 * matmul(mass, desc**2)
    size = jnp.sqrt(jnp.where(varies, square, 1))
    scaled = centred * jnp.where(varies, 1 / size, 0)[None, :]
    return jnp.where((mass > 0)[:, None], scaled, 0)


def _signature(spec, log_weight, landmarks):
    # Of narrow bands between two eigenvalues every weight may underflow: not here.
    weight = jax.nn.softmax(log_weight, axis=1)
    if landmarks is None:
        return matmul(spec.evecs**2, weight.T)
    seen = spec.evecs[landmarks][:, None] * weight[None]
    seen = seen.reshape(-1, weight.shape[1])
    return matmul(spec.evecs, seen.T)


def _check(name, spec, num):
    if num < 1:
        raise ValueError(f"{name}: num is {num}, it must be positive")
    if len(spec.evals) < 3:
        raise ValueError(f"{name}: needs 3 eigenpairs or more, got {len(spec.evals)}")

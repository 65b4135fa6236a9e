"""What the network reads of a shape: functions that turn with nothing, and gradients.

- log(h_t(i, i) / (1 + 1 / (4 pi t))): heat kernels beside those of a plane
- arsinh(5 s / (sqrt(t') - sqrt(t))): steps of the mean curvature flow (`curvature`)
- arsinh of the heat that the rim of an open surface has spread
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jfsf.array import einsum, matmul
from jfsf.array._jit import jit
from jfsf.array._precision import safe_divide
from jfsf.geometry import normals
from jfsf.spectral import curvature
from jfsf.types import ArrayLike, Spectrum

EIGENPAIRS = 80
HEAT_TIMES = tuple(np.geomspace(1e-3, 0.25, 14))  # on the shape of area 1
RIM_TIMES = (1e-3, 8e-3, 6e-2)
# From a wrist to a half of a body.
FLOW_TIMES = tuple(2.0 ** np.arange(-13, -1))
STEEPEST = 300.0  # slope that is read as such; needles have steeper ones


class NetworkInput(NamedTuple):
    """A shape as the network reads it; padding has mass 0.

    evals, mass, evecs: of its `Spectrum`, the first `EIGENPAIRS`.
    slopes: gradients of the eigenvectors, in a frame of the tangent plane of each
        vertex whose normal points outward.
    inputs: of each vertex, in the order of the head of this file.
    """

    evals: Float[ArrayLike, " k"]
    mass: Float[ArrayLike, " n"]
    evecs: Float[ArrayLike, "n k"]
    slopes: Float[ArrayLike, "n 2 k"]
    inputs: Float[ArrayLike, "n c"]


@jit
def network_input(spec: Spectrum) -> NetworkInput:
    """What the network reads of a shape, in float32.

    Args:
        spec: of a mesh with `EIGENPAIRS` eigenpairs or more; faces wound outward.
    """
    spec = spec._replace(
        evals=spec.evals[:EIGENPAIRS], evecs=spec.evecs[:, :EIGENPAIRS]
    )
    found = NetworkInput(
        spec.evals, spec.mass, spec.evecs, _slopes(spec), _inputs(spec)
    )
    return NetworkInput(*(a.astype(jnp.float32) for a in found))


def _inputs(spec: Spectrum):
    dtype = spec.evecs.dtype
    row = lambda values: jnp.asarray(values, dtype)[None]
    decay = lambda times: jnp.exp(-spec.evals[:, None] * row(times))
    heat = matmul(spec.evecs**2, decay(HEAT_TIMES))
    plane = 1 + 1 / (4 * np.pi * row(HEAT_TIMES))
    heat = jnp.log(jnp.maximum(heat, 1e-6)) - jnp.log(plane)
    step = jnp.diff(jnp.sqrt(jnp.asarray(FLOW_TIMES, dtype)))
    bends = curvature(spec, times=FLOW_TIMES) / jnp.tile(step, 2)[None]
    spread = decay(RIM_TIMES) * matmul(spec.evecs.T, _rim(spec))[:, None]
    spread = jnp.arcsinh(matmul(spec.evecs, spread))
    found = jnp.concatenate([heat, jnp.arcsinh(5 * bends), spread], 1)
    return jnp.where((spec.mass > 0)[:, None], found, 0)


def _rim(spec: Spectrum):
    """(n,) half of the length of the boundary edges at each vertex."""
    tail = spec.faces.ravel()
    head = jnp.roll(spec.faces, -1, 1).ravel()
    low, high = jnp.minimum(tail, head), jnp.maximum(tail, head)
    order = jnp.lexsort((high, low))
    low, high = low[order], high[order]
    same = (low[1:] == low[:-1]) & (high[1:] == high[:-1])
    alone = ~(jnp.pad(same, (1, 0)) | jnp.pad(same, (0, 1))) & (low < high)
    step = spec.vertices[high] - spec.vertices[low]
    half = jnp.where(alone, jnp.sqrt(jnp.sum(step**2, 1)) / 2, 0)
    return jnp.zeros_like(spec.mass).at[low].add(half).at[high].add(half)


def _slopes(spec: Spectrum):
    """(n, 2, k) of the eigenvectors, means over the faces of a vertex by area."""
    points, faces = spec.vertices, spec.faces
    a, b, c = (points[faces[:, i]] for i in range(3))
    normal = jnp.cross(b - a, c - a)
    double = jnp.sqrt(jnp.sum(normal**2, 1))
    unit = safe_divide(normal, double[:, None])
    # The gradient of a corner's hat is its opposite edge, turned, over twice the area;
    # times that area, it is the turned edge.
    hats = jnp.stack([jnp.cross(unit, e) for e in (c - b, a - c, b - a)], 1)
    gradient = einsum("fcd,fck->fdk", hats, spec.evecs[faces])
    n, k = spec.evecs.shape
    total = jnp.zeros((n, 3, k), gradient.dtype)
    area = jnp.zeros(n, gradient.dtype)
    for corner in range(3):
        total = total.at[faces[:, corner]].add(gradient)
        area = area.at[faces[:, corner]].add(double)
    total = safe_divide(total, area[:, None, None])
    outward = normals(points, faces)
    axis = jnp.eye(3, dtype=points.dtype)[jnp.argmin(jnp.abs(outward), 1)]
    first = jnp.cross(outward, axis)
    size = jnp.sqrt(jnp.sum(first**2, 1))
    first = safe_divide(first, size[:, None])
    frame = jnp.stack([first, jnp.cross(outward, first)], 1)
    slopes = einsum("nad,ndk->nak", frame, total)
    return jnp.clip(slopes, -STEEPEST, STEEPEST)

"""Product manifold filter: the bijection densest in the product of the two shapes.

Vestner, Litman, Rodola, Bronstein and Cremers ("Product manifold filter", CVPR 2017)
regard a noisy map Pi as samples of its graph in X x Y, estimate their density with a
kernel on each shape, and take the assignment of largest density. They repeat this with
narrower kernels:

    Pi <- argmax_P <P, K_X Pi K_Y^T>  over one-to-one P.

The kernels are heat kernels, K_t = sum_k exp(-t lambda_k) phi_k phi_k^T, as in the
sequel (Vestner, Laehner, Boyarski, Litany et al., "Efficient deformable shape
correspondence via kernel matching", 3DV 2017), so no geodesic distances are needed.
They are positive semidefinite: at one t the objective <Pi, K_X Pi K_Y^T> is convex, and
a step from one assignment to the next never lowers it.

Departures:

- The sequel starts from SHOT descriptors, which it keeps as a data term of weight 1e-7.
  Here the start is a map, and there is no data term.
- The sequel solves for 3000 farthest points and extends the solution to the others in
  patches of 1500. Here all vertices take part at once, as in the first paper.
- If n_x != n_y, the sequel fills up with small random densities and leaves some
  vertices without a match. Here the assignment of the smaller side is optimal. Each
  remaining vertex of the larger side takes its largest density, but does not enter Pi.

Dense, as the source: three n_x by n_y arrays in float64. At n = 5000 the ten default
steps take one to one and a half minutes on two cores.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from experiments.paper.baselines._auction import one_to_one
from jfsf.types import ArrayLike, Maps, Spectrum

# The authors' ten steps from 500 to 10, on TOSCA's cat of area 19 563, at unit area.
TIMES = tuple(float(t) for t in np.geomspace(500, 10, 10) / 19_563)


def pmf(
    spec_x: Spectrum,
    spec_y: Spectrum,
    T_xy: Int[Array, " n_x"],
    *,
    times: tuple[float, ...] = TIMES,
    eps: float = 1e-4,
) -> Maps:
    """Refine a map to one that is one to one. Host side.

    Args:
        spec_x, spec_y: spectra; mass 0 is padding, which is mapped to 0. The authors
            use 500 eigenpairs.
        T_xy: the start: a vertex of Y for each vertex of X, not necessarily injective.
        times: diffusion times on shapes of area 1, one step each, not increasing.
        eps: an assignment's total density is within n eps of the largest, n vertices on
            the smaller side, in units of the density's standard deviation.

    Returns:
        Inverse permutations if n_x = n_y. Otherwise every vertex of the smaller side
        has a vertex of its own, and the remaining vertices of the larger side have the
        one of largest density.

    Raises:
        ValueError: T_xy does not fit the spectra, times is empty, increases or holds
            one that is not positive, or eps is not positive.
    """
    real_x, real_y = (np.flatnonzero(np.asarray(s.mass) > 0) for s in (spec_x, spec_y))
    start = _start(T_xy, spec_x, spec_y, real_x, real_y)
    if not times or min(times) <= 0 or list(times) != sorted(times, reverse=True):
        raise ValueError(
            f"pmf: times are {times}; give positive diffusion times, largest first"
        )
    if not eps > 0:
        raise ValueError(f"pmf: eps is {eps}, it must be positive")
    evecs_x, evals_x = _real(spec_x, real_x)
    evecs_y, evals_y = _real(spec_y, real_y)
    pairs = np.arange(len(real_x)), np.searchsorted(real_y, start)
    to_y, to_x = pairs[1], np.zeros(len(real_y), np.int64)
    for time in times:
        at_x, at_y = pairs
        factor = evecs_x[at_x].T @ evecs_y[at_y]
        factor *= np.exp(-time * (evals_x[:, None] + evals_y))
        density = evecs_x @ factor @ evecs_y.T
        spread = _spread(density)
        to_y, to_x = one_to_one(density, eps=eps * spread, start=spread)
        every_x, every_y = np.arange(len(to_y)), np.arange(len(to_x))
        pairs = (every_x, to_y) if len(to_y) <= len(to_x) else (to_x, every_y)
    found_x, found_y = (np.zeros(len(s.mass), np.int32) for s in (spec_x, spec_y))
    found_x[real_x], found_y[real_y] = real_y[to_y], real_x[to_x]
    return Maps(jnp.asarray(found_x), jnp.asarray(found_y))


def _start(T_xy: ArrayLike, spec_x, spec_y, real_x, real_y) -> np.ndarray:
    """T_xy at the vertices of X that are not padding, checked."""
    T_xy, n_y = np.asarray(T_xy), len(spec_y.mass)
    if T_xy.shape != (len(spec_x.mass),) or T_xy.dtype.kind not in "iu":
        raise ValueError(
            f"pmf: T_xy is {T_xy.shape} {T_xy.dtype}, expected integers "
            f"({len(spec_x.mass)},), one a vertex of X"
        )
    T_xy = T_xy[real_x]
    unknown = T_xy[~np.isin(T_xy, real_y)]
    if len(unknown):
        raise ValueError(
            f"pmf: T_xy holds {unknown[0]}, which is no vertex of Y: it has {n_y}, "
            "0-based, of which those of mass 0 are padding"
        )
    return T_xy


def _real(spec: Spectrum, real) -> tuple[np.ndarray, np.ndarray]:
    evecs = np.asarray(spec.evecs, np.float64)[real]
    return evecs, np.asarray(spec.evals, np.float64)


def _spread(density: Float[np.ndarray, "n_x n_y"]) -> float:
    """Standard deviation after the means of rows and columns are subtracted."""
    rows = density - density.mean(1, keepdims=True)
    rows -= rows.mean(0)
    return float(rows.std()) or 1.0

"""How the surface curves, at several scales. Host side (numpy).

Two open surfaces that lie on each other slide along each other at little cost. What
keeps them in place is that a bump lies on a bump. It is read from the surface within
sqrt(t), so a cut changes it only there. `jfsf.spectral.curvature` is for whole shapes:
it reads eigenfunctions, which a cut changes everywhere.
"""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from jfsf.mesh._geometry import vertex_normals
from jfsf.spectral._laplacian import definite_solver, operators
from jfsf.types import ArrayLike, Mesh

# Heat times that are compared, in squared sqrt(area of the whole).
TIMES = 0.0003, 0.001, 0.003
MAX_CURVATURE = 3.0  # in standard deviations; a greater one counts as this
# Of a normal distribution: the standard deviation over the median absolute value.
SPREAD = 1.4826
TINY = 1e-9
STEP = 0.4  # at most, between logarithms of times


class Curvatures(NamedTuple):
    """Curvature of one mesh at many times, for that at any time between.

    log_times: (k,) logarithms of the times, evenly spaced.
    values: (n, k) `curvature`.
    """

    log_times: np.ndarray
    values: np.ndarray

    def at(self, times: ArrayLike) -> np.ndarray:
        """(n, times), linear in the logarithm of the time; beyond the ends as there."""
        first, last = self.log_times[[0, -1]]
        place = np.clip(np.log(times), first, last) - first
        place *= (len(self.log_times) - 1) / (last - first)
        before = np.minimum(place.astype(int), len(self.log_times) - 2)
        share = place - before
        low, high = self.values[:, before], self.values[:, before + 1]
        return (1 - share) * low + share * high


def curvatures(mesh: Mesh, least: float, most: float) -> Curvatures:
    """For times from `least` to `most`, in squared units of the mesh."""
    num = 2 + int(np.log(most / least) / STEP)
    log_times = np.linspace(np.log(least), np.log(most), num)
    return Curvatures(log_times, curvature(mesh, np.exp(log_times)))


def curvature(mesh: Mesh, times: ArrayLike) -> np.ndarray:
    """(n, times) how far heat moves each vertex along the outward normal.

    An implicit step of mean curvature flow (Desbrun et al., 1999),
    (M + t L) p = M vertices, then <p - vertices, normal> / sqrt(t): negative where the
    surface is convex, and no unit. A mirror image has the same.

    Args:
        mesh: wound outward.
        times: t, in squared units of the mesh.
    """
    at, normal = np.asarray(mesh.vertices, float), vertex_normals(*mesh)
    stiffness, area = operators(mesh)
    mass = sp.diags(area)
    columns = []
    for time in np.asarray(times):
        diffused = definite_solver(mass + time * stiffness)(area[:, None] * at)
        columns.append(np.sum((diffused - at) * normal, 1) / np.sqrt(time))
    return np.stack(columns, 1)


def usual_curvature(values: np.ndarray) -> np.ndarray:
    """(times,) what `standard_curvature` divides by: a standard deviation.

    It is made from the median, so a few sharp vertices hardly change it.
    """
    return SPREAD * np.sqrt(np.median(values**2, 0)) + TINY


def standard_curvature(values: np.ndarray, usual: np.ndarray) -> np.ndarray:
    """(n, times) rows whose squared distance is the mean square of the differences.

    Args:
        values: `curvature`.
        usual: what counts as 1, the same for both shapes.
    """
    return np.clip(values / usual, -MAX_CURVATURE, MAX_CURVATURE) / np.sqrt(
        values.shape[1]
    )

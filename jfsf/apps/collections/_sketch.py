"""What a collection keeps of each shape: enough to choose pairs and to compare maps."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jfsf.spectral._sampling import biharmonic, rms_distance
from jfsf.types import ArrayLike, Spectrum

SIGNATURE = 30  # eigenvalues: how a shape differs from others as a whole
_GROWTH = 4 * np.pi * SIGNATURE


class Sketch(NamedTuple):
    """What tells a shape from others, and how far apart its vertices are.

    signature: square roots of eigenvalues, in units of their mean growth (Weyl's law).
        The shape has area 1, so size plays no part; nor does the pose (Reuter et al.
        2006, "Laplace-Beltrami spectra as Shape-DNA").
    points: their Euclidean distance is the biharmonic one; that of two random vertices
        has root mean square 1.
    mass: of the vertices, sums to 1.
    """

    signature: Float[ArrayLike, " f"]
    points: Float[ArrayLike, "n d"]
    mass: Float[ArrayLike, " n"]


def sketch(spec: Spectrum) -> Sketch:
    """Of a spectrum without padding, from `jfsf.basis`. In float32."""
    points = biharmonic(spec)
    unit = float(rms_distance(points, spec.mass))
    evals = np.maximum(np.asarray(spec.evals)[1 : SIGNATURE + 1], 0)
    numbers = (
        np.sqrt(evals / _GROWTH),
        np.asarray(points) / unit,
        np.asarray(spec.mass),
    )
    return Sketch(*(np.asarray(values, np.float32) for values in numbers))


def evals_of(
    signature: Float[ArrayLike, " f"],
) -> Float[np.ndarray, " f"]:
    """The eigenvalues of a signature, from the first that is not 0 on, at area 1."""
    return _GROWTH * np.asarray(signature, float) ** 2

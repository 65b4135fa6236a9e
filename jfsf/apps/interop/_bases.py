"""Eigenpairs of a shape of any area <-> a `Spectrum`, which is of area 1.

On a shape of area a: evals_own = evals / a, mass_own = a mass, and
evecs_own = evecs diag(factors), where the factors are 1 / sqrt(a) but for the sign of
the constant function. So C_other = diag(1 / factors_x) C_yx diag(factors_y).
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jfsf.mesh._values import check_values, mesh_arrays
from jfsf.types import ArrayLike, Mesh, Spectrum

# Of Phi^T A Phi from I. Single precision stays far below, other areas far above.
ORTHONORMAL_TO = 1e-2


class Correspondence(NamedTuple):
    """A map from X to Y, as points and as functions; None for what was not given.

    T_xy: (n_x,) int32, the vertex of Y for each vertex of X.
    C_yx: (k_x, k_y), functions on Y pulled back to X, in the bases of our spectra.
    """

    T_xy: Any
    C_yx: Any


class Bases(NamedTuple):
    """How the eigenvectors that another code has for X and Y differ from ours.

    factors_x, factors_y: (k,) each; column j of the other's eigenvectors is factors[j]
        times column j of ours.
    """

    factors_x: Float[np.ndarray, " k"]
    factors_y: Float[np.ndarray, " l"]

    def to_other(self, C_yx: ArrayLike) -> Float[np.ndarray, "k_x k_y"]:
        """The other code's functional map from Y to X, from ours.

        Raises:
            ValueError: C_yx is no matrix, or has more rows or columns than there are
                eigenvectors of X or Y.
        """
        C_yx, by_x, by_y = self._fitting("C_yx", C_yx)
        return C_yx / by_x[:, None] * by_y

    def from_other(self, C_other: ArrayLike) -> Float[np.ndarray, "k_x k_y"]:
        """Our C_yx from the other code's functional map from Y to X.

        Raises:
            ValueError: as `to_other`.
        """
        C_other, by_x, by_y = self._fitting("C_other", C_other)
        return C_other * by_x[:, None] / by_y

    def _fitting(self, name, C):
        C = np.asarray(C)
        most = len(self.factors_x), len(self.factors_y)
        if C.ndim != 2 or C.dtype.kind not in "fiu" or np.any(np.array(C.shape) > most):
            raise ValueError(
                f"{name} is {C.dtype} {C.shape}, but X has {most[0]} eigenvectors "
                f"(rows) and Y has {most[1]} (columns): does it run the other way?"
            )
        # In C's own precision.
        return C, *(
            factors[:size].astype(C.dtype if C.dtype.kind == "f" else np.float64)
            for factors, size in zip(self, C.shape, strict=True)
        )


class Rescaled(NamedTuple):
    """A spectrum of area 1, and the factors (k,) from its eigenvectors to the given."""

    spectrum: Spectrum
    factors: Float[np.ndarray, " k"]


def at_unit_area(
    name: str, mesh: Mesh, evals: ArrayLike, evecs: ArrayLike, mass: ArrayLike
) -> Rescaled:
    """The eigenpairs of a shape of any area as a `Spectrum`.

    Args:
        name: opens the message: the file, or the argument.
        mesh: in any unit of length.
        evals: (k,) ascending, in 1 / unit^2; the first about 0.
        evecs: (n, k) mass-orthonormal; the first constant, of either sign.
        mass: (n,) lumped areas in unit^2.

    Raises:
        ValueError: these are not the eigenpairs of one connected shape.
    """
    mesh = Mesh(*mesh_arrays(mesh, name))
    check_values(*mesh, name)
    evals, evecs, mass = (np.asarray(a, np.float64) for a in (evals, evecs, mass))
    n = len(mesh.vertices)
    if evecs.ndim != 2 or (n, *evals.shape, *mass.shape) != (*evecs.shape, n):
        raise ValueError(
            f"{name}: {n} vertices do not go with evecs {evecs.shape}, evals "
            f"{evals.shape} and areas {mass.shape}; pass those of one shape"
        )
    if not all(np.isfinite(a).all() for a in (evals, evecs, mass)) or mass.min() <= 0:
        raise ValueError(
            f"{name}: eigenpairs must be finite and areas positive (the least is "
            f"{mass.min():.3g}); compute them again"
        )
    if (np.diff(evals) < -1e-6 * np.abs(evals).max()).any():
        raise ValueError(
            f"{name}: evals are not ascending; sort them and the columns of evecs"
        )
    gram = evecs.T @ (evecs * mass[:, None])
    gap = np.abs(gram - np.eye(len(gram))).max()
    if gap > ORTHONORMAL_TO:
        raise ValueError(
            f"{name}: evecs are not orthonormal for these areas (off by {gap:.3g}); "
            "take both from one shape, in one unit"
        )
    first = evecs[:, 0]
    if first.std() > 0.01 * abs(first.mean()):
        raise ValueError(
            f"{name}: the first eigenvector is not constant; keep the eigenvalue 0, "
            "and one connected piece"
        )

    area = mass.sum()
    factors = factors_of(evecs, area)
    centre = mass @ mesh.vertices / area
    spectrum = Spectrum(
        np.maximum(evals, 0) * area,
        evecs / factors,
        mass / area,
        mesh.faces.astype(np.int32),
        (mesh.vertices - centre) / np.sqrt(area),
    )
    return Rescaled(spectrum, factors)


def factors_of(evecs: ArrayLike, area: float) -> Float[np.ndarray, " k"]:
    """What the eigenvectors of a shape of this area are, relative to ours."""
    factors = np.full(evecs.shape[1], 1 / np.sqrt(area))
    factors[:1] *= np.where(evecs[:, :1].mean(0) < 0, -1, 1)
    return factors


def zero_based_map(
    name: str, T: ArrayLike, n_from: int, n_to: int, base: int = 0
) -> Int[np.ndarray, " n"]:
    """A point map (n_from,) int32, 0-based, of indices below n_to from `base` on.

    Raises:
        ValueError: it is something else; `name` opens the message.
    """
    T = np.asarray(T)
    if T.ndim == 2 and 1 in T.shape:  # MATLAB's vectors
        T = T.ravel()
    if T.ndim != 1 or len(T) != n_from:
        hint = "; it runs the other way" if T.shape == (n_to,) != (n_from,) else ""
        raise ValueError(
            f"{name} has shape {T.shape}, the shape that it runs from has {n_from} "
            f"vertices{hint}"
        )
    if T.dtype.kind not in "iuf" or (T != np.floor(T)).any():
        raise ValueError(f"{name} holds {T.dtype}, expected vertex numbers")
    low, high = T.min(initial=base), T.max(initial=base)
    if low < base or high >= n_to + base:
        raise ValueError(
            f"{name} runs from {low:g} to {high:g}, the shape that it runs to has "
            f"vertices {base} to {n_to - 1 + base}: does it run the other way?"
        )
    return (T.astype(np.int64) - base).astype(np.int32)

"""Chances of places on a person, and how well a map agrees with them."""

import jax
import numpy as np
from jaxtyping import Array, Float

from jfsf.array._jit import jit
from jfsf.geometry import GeodesicSolver
from jfsf.learned._inputs import EIGENPAIRS, network_input
from jfsf.learned._network import anchor_distances, trained
from jfsf.mesh._geometry import farthest_vertices
from jfsf.runtime._sizes import surface_of
from jfsf.types import ArrayLike, Spectrum

Places = tuple[ArrayLike, ArrayLike]
"""(n_x, a) and (n_y, a): chances of the anchors on a person, without padding."""
PEOPLE = 0.078  # `likeness_of_both` from which on shapes are taken for people
SOME = 60  # vertices, far from each other, between which distances are compared


@jit
def place_chances(spec: Spectrum) -> Float[Array, "n a"]:
    """How likely each vertex lies at each of the anchors on a person.

    Args:
        spec: of a mesh, with `EIGENPAIRS` eigenpairs or more and faces wound outward.

    Returns:
        In float32, rows sum to 1; the last column is the chance that the shape is no
        person. Rows of padding mean nothing.

    Raises:
        ValueError: fewer eigenpairs.
    """
    if (k := spec.evals.shape[0]) < EIGENPAIRS:
        raise ValueError(
            f"place_chances: the spectrum has {k} eigenpairs; the network reads "
            f"{EIGENPAIRS}, give as many to jfsf.spectrum"
        )
    with jax.default_matmul_precision("highest"):
        return jax.nn.softmax(trained()(network_input(spec)))


def places_on_person(
    chances: tuple[ArrayLike, ArrayLike], spectra: tuple[Spectrum, Spectrum]
) -> Places | None:
    """Chances of the anchors of both shapes; None unless they are people. Host side.

    Args:
        chances: of `place_chances`, (n, a + 1) of each shape.
        spectra: of both.

    Returns:
        (n, a) of each shape, without rows of padding.
    """
    if likeness_of_both(chances, spectra) < PEOPLE:
        return None
    x, y = (
        np.asarray(own)[np.asarray(spec.mass) > 0, :-1]
        for own, spec in zip(chances, spectra, strict=True)
    )
    return x, y


def likeness_of_both(
    chances: tuple[ArrayLike, ArrayLike], spectra: tuple[Spectrum, Spectrum]
) -> float:
    """The geometric mean of the `likeness` of two shapes. Host side.

    What is matched is alike, so a body that is hard to recognise, folded up or half of
    it seen, is taken for a person beside one that is easy; nothing else is.
    `experiments/learn/evaluate.py` says what pairs of all kinds have.

    Args:
        chances: of `place_chances`, (n, a + 1) of each shape.
        spectra: of both.
    """
    x, y = map(likeness, chances, spectra)
    return float(np.sqrt(max(x, 0) * max(y, 0)))


def likeness(chances: ArrayLike, spec: Spectrum) -> float:
    """How surely, and how consistently, the network sees a person. Host side.

    The mean of the greatest chance of a vertex, times the correlation of distances
    between vertices on the shape with those of their anchors on the template. Of what
    it was not trained on the network may be sure, but its places are in disorder.

    Args:
        chances: (n, a + 1) of `place_chances`.
        spec: of the shape; padding at the end is left out.

    Returns:
        At most 1.
    """
    mass = np.asarray(spec.mass)
    real = mass > 0
    places = np.asarray(chances)[real, :-1]
    sure = float(mass[real] @ places.max(1) / mass[real].sum())
    mesh = surface_of(spec)
    at = farthest_vertices(mesh, SOME)
    own = places[at] / places[at].sum(1, keepdims=True)
    there = own @ anchor_distances() @ own.T
    here = GeodesicSolver(mesh).rows(at)[:, at]
    above = np.triu_indices(len(at), 1)
    return sure * float(np.corrcoef(here[above], there[above])[0, 1])


def agreement(T_xy: ArrayLike, places_x: ArrayLike, places_y: ArrayLike) -> np.ndarray:
    """sum_a sqrt(p_a(i) q_a(T(i))) of each vertex i of X, (n_x,): 1 for equal chances.

    The Bhattacharyya coefficient of the chances at a vertex and its image. Host side.

    Args:
        T_xy: (n_x,) the map.
        places_x, places_y: (n_x, a) and (n_y, a) of `places_on_person`.
    """
    others = np.sqrt(np.asarray(places_y)[np.asarray(T_xy)])
    return (np.sqrt(np.asarray(places_x)) * others).sum(1)


def best_agreement(places_x: ArrayLike, places_y: ArrayLike) -> np.ndarray:
    """(n_x,) the vertex of Y where `agreement` is greatest, for each vertex of X.

    All pairs of vertices are compared: (n_x, n_y) numbers in memory. Host side.

    Args:
        places_x, places_y: as `agreement`.
    """
    return (np.sqrt(places_x) @ np.sqrt(places_y).T).argmax(1)

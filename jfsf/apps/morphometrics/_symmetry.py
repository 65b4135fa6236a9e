"""Shapes that have a left and a right: the symmetric part of each, and the rest.

Mardia, Bookstein and Moreton (Biometrika 2000); Klingenberg, Barluenga and Meyer
(Evolution 2002), for objects that are symmetric in themselves. A shape and its mirror
image, whose left and right landmarks are exchanged, are superimposed with those of all
other specimens; their mean is the symmetric part, and the difference of the shape from
it the asymmetric one.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jfsf.apps.morphometrics._checks import check_numbers, check_once, check_points
from jfsf.apps.morphometrics._procrustes import procrustes
from jfsf.types import ArrayLike


class SymmetricParts(NamedTuple):
    """Each shape is symmetric + asymmetric.

    symmetric: (s, l, 3) shapes that are their own mirror image, in x, y or z, for left
        and right exchanged.
    asymmetric: (s, l, 3) differences from them, which the mirror image has with the
        other sign. Their mean over the specimens is directional asymmetry.
    distances: (s,) |asymmetric|: the Procrustes distance of each shape from its
        symmetric part, half of that from its mirror image.
    """

    symmetric: Float[np.ndarray, "s l 3"]
    asymmetric: Float[np.ndarray, "s l 3"]
    distances: Float[np.ndarray, " s"]


def symmetric_parts(
    shapes: Float[ArrayLike, "s l 3"], pairs: Int[ArrayLike, "p 2"]
) -> SymmetricParts:
    """The symmetric and the asymmetric part of each shape.

    They are `symm.shape` of `geomorph::bilat.symmetry` (object.sym = TRUE), and its
    `asymm.shape` less the mean, up to a rotation of all.

    Args:
        shapes: landmarks; as of `procrustes` if semilandmarks are to slide first.
        pairs: landmarks of the left and the right side, from 0. The others are on the
            midline.

    Raises:
        ValueError: a landmark in two pairs or not there; or as `procrustes`.
    """
    name = "symmetric_parts"
    shapes = check_points(name, shapes)
    left, right = check_numbers(name, "pairs", pairs, 2, shapes.shape[1]).T
    check_once(name, "pairs", np.concatenate([left, right]))
    partner = np.arange(shapes.shape[1])
    partner[left], partner[right] = right, left
    mirrored = shapes[:, partner] * [-1, 1, 1]
    own, other = np.split(procrustes(np.concatenate([shapes, mirrored])).shapes, 2)
    asymmetric = (own - other) / 2
    distances = np.linalg.norm(asymmetric, axis=(1, 2))
    return SymmetricParts((own + other) / 2, asymmetric, distances)

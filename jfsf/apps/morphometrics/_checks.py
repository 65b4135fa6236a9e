"""Arguments, checked: landmarks of specimens, and numbers of landmarks."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

# Singular values of landmarks about their centroid, over the largest, below which they
# count as in a plane or on a line: the roundings of a system of a hundred of them.
FLAT = 1e-10


class PointsError(ValueError):
    """Specimens or landmarks that cannot be compared; the message has their numbers.

    words: the message, with `{specimen}` and `{landmarks[0]}` for these.
    """

    def __init__(self, name: str, words: str, specimen: Any = -1, landmarks: Any = ()):
        self.words, self.specimen, self.landmarks = words, specimen, landmarks
        said = words.format(specimen=specimen, landmarks=landmarks)
        super().__init__(f"{name}: {said}")

    def named(self, specimens: Sequence[str], landmarks: Sequence[str]) -> str:
        """The message with names for numbers; from 1 for a landmark without one."""
        own = [repr(landmarks[i] or i + 1) for i in self.landmarks]
        specimen = repr(specimens[self.specimen])
        return self.words.format(specimen=specimen, landmarks=own)


def check_points(
    name: str, points: Any, *, least: int = 2, missing: bool = False
) -> Float[np.ndarray, "s l 3"]:
    """Landmarks of specimens, in double precision.

    Args:
        name: the function that asks; it opens the message.
        points: what it was given.
        least: how many specimens it needs.
        missing: whether landmarks may be nan.

    Raises:
        ValueError: another shape, too few specimens or landmarks, coordinates that are
            not finite, or a specimen whose landmarks are all at one place.
    """
    points = np.asarray(points, float)
    if points.ndim != 3 or points.shape[2] != 3 or points.shape[1] < 3:
        words = f"points are {points.shape}; pass (s, l, 3) of three landmarks or more"
        raise PointsError(name, words)
    if len(points) < least:
        words = f"specimens are {len(points)}; it needs {least} or more"
        raise PointsError(name, words)
    bad = ~np.isfinite(points).all(2)
    if missing:
        bad &= ~np.isnan(points).all(2)
    if bad.any():
        specimen, landmark = np.argwhere(bad)[0]
        raise PointsError(
            name,
            f"landmark {{landmarks[0]}} of specimen {{specimen}} is "
            f"{points[specimen, landmark]}; estimate it (`estimate_missing`) or leave "
            "the specimen out",
            specimen=specimen,
            landmarks=[landmark],
        )
    if not missing and len(small := np.flatnonzero(~np.ptp(points, axis=1).any(1))):
        words = "all landmarks of specimen {specimen} are at one place; leave it out"
        raise PointsError(name, words, specimen=small[0])
    return points


def check_numbers(name: str, what: str, numbers: Any, columns: int, landmarks: int):
    """Numbers of landmarks from 0, (r, columns); no rows if None.

    Args:
        name: the function that asks; it opens the message.
        what: the argument.
        numbers: what it was given.
        columns: how many a row.
        landmarks: how many there are.

    Raises:
        ValueError: another shape, no whole numbers, a landmark that is not there, or
            one that a row has twice.
    """
    if numbers is None:
        return np.zeros((0, columns), int)
    numbers = np.asarray(numbers)
    if columns == 1 and numbers.ndim == 1:
        numbers = numbers[:, None]
    is_whole = numbers.dtype.kind in "iu" or not numbers.size
    if numbers.ndim != 2 or numbers.shape[1] != columns or not is_whole:
        raise ValueError(
            f"{name}: {what} are {numbers.dtype} {numbers.shape}; pass (r, {columns}) "
            "whole numbers of landmarks, from 0"
        )
    if numbers.size and not 0 <= numbers.min() <= numbers.max() < landmarks:
        raise ValueError(
            f"{name}: {what} go from {numbers.min()} to {numbers.max()}, and landmarks "
            f"from 0 to {landmarks - 1}"
        )
    for row in numbers.tolist():
        if len(set(row)) < columns:
            raise ValueError(f"{name}: {what} have {row}, a landmark twice in a row")
    return numbers.astype(int)


def check_once(name: str, what: str, numbers: Int[np.ndarray, " r"]) -> None:
    """PointsError if a landmark is there twice."""
    values, counts = np.unique(numbers, return_counts=True)
    if len(twice := values[counts > 1]):
        words = f"landmark {{landmarks[0]}} is twice in {what}; take one out"
        raise PointsError(name, words, landmarks=twice[:1])


def is_flat(shape: Float[np.ndarray, "l 3"]) -> bool:
    """Whether landmarks lie in a plane, or are fewer than four."""
    sizes = np.linalg.svd(shape - shape.mean(0), compute_uv=False)
    return len(sizes) < 3 or bool(sizes[2] <= FLAT * sizes[0])

"""Colours of vertices: by place, through a map, of errors."""

import numpy as np
from jaxtyping import Bool, Float, Int

from jfsf.apps.plot._frames import Up, checked_mask, frame, points_of
from jfsf.types import ArrayLike

# Of what is not matched, sRGB: pale, and without any hue that a place has.
UNMATCHED = (0.80, 0.81, 0.82)


def coordinate_colours(
    vertices: Float[ArrayLike, "n 3"], *, up: Up = "y"
) -> Float[np.ndarray, "n 3"]:
    """A smooth colouring of a shape by its coordinates, whatever their unit and origin.

    Hue and saturation follow height and side, so that the four limbs differ and a
    mirrored map is visible. Lightness follows depth.

    Args:
        vertices: in any unit.
        up: the axis that points up.

    Returns:
        sRGB in [0, 1], one row for each vertex.

    Raises:
        ValueError: vertices that are not finite (n, 3), or an unknown axis.
    """
    return body_colours(points_of(vertices) @ frame(up))


def body_colours(body: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """`coordinate_colours` of points whose axes are right, up and front."""
    spread = body.std(0)
    # A flat shape has no spread in some direction: its coordinate there stays 0.
    coords = (body - body.mean(0)) / np.where(spread > 0, spread, 1)
    side, height, depth = np.tanh(coords * [0.8, 0.8, 1]).T
    # The root keeps the middle of the body from being grey.
    chroma = 0.15 * np.sqrt(np.hypot(side, height))
    hue = np.arctan2(height, side) + 3.6
    return _oklab(0.78 + 0.05 * depth, chroma * np.cos(hue), chroma * np.sin(hue))


def pull_back(
    colours_y: Float[ArrayLike, "n_y c"], T_xy: Int[ArrayLike, " n_x"]
) -> Float[np.ndarray, "n_x c"]:
    """Colours of X through the map from X to Y: colours_y[T_xy].

    Raises:
        ValueError: T_xy is not a vector of vertices of Y.
    """
    T_xy = np.asarray(T_xy)
    if T_xy.ndim != 1 or not np.issubdtype(T_xy.dtype, np.integer):
        raise ValueError(
            "pull_back: T_xy is a list of vertices of Y, one for each of X; got "
            f"{T_xy.dtype} of shape {T_xy.shape}"
        )
    n_y = len(colours_y)
    if T_xy.size and not 0 <= T_xy.min() <= T_xy.max() < n_y:
        raise ValueError(
            f"pull_back: T_xy runs from {T_xy.min()} to {T_xy.max()}, but Y has "
            f"vertices 0 to {n_y - 1}: is it the map from Y to X?"
        )
    return np.asarray(colours_y)[T_xy]


def matched_colours(
    colours: Float[ArrayLike, "n 3"], matched: Bool[ArrayLike, " n"] | None
) -> Float[np.ndarray, "n 3"]:
    """Colours of vertices, those that are not matched grey.

    Args:
        colours: sRGB in [0, 1], one row for each vertex.
        matched: `Match.matched_x` or `matched_y`; None greys nothing.

    Raises:
        ValueError: `matched` is not one truth value a vertex.
    """
    if matched is None:
        return np.asarray(colours)
    colours = np.asarray(colours)
    matched = checked_mask(matched, len(colours))
    return np.where(matched[:, None], colours, UNMATCHED)


def error_colours(
    errors: Float[ArrayLike, " n"], n: int
) -> tuple[Float[np.ndarray, "n 3"], float]:
    """Colours (n, 3) of errors (n,), and the error of the darkest; nan is grey."""
    errors = np.asarray(errors, float)
    if errors.shape != (n,):
        raise ValueError(f"draw: the shape has {n} vertices, errors {errors.shape}")
    finite = np.isfinite(errors)
    # By a quantile: with the maximum one outlier would make all others pale.
    top = float(np.quantile(errors[finite], 0.99)) if finite.any() else 0.0
    share = np.where(finite, errors, 0) / (top if top > 0 else 1)
    return np.where(finite[:, None], ramp(share), 0.6), top


def ramp(share: Float[ArrayLike, "..."]) -> Float[np.ndarray, "... 3"]:
    """sRGB (..., 3) from sand at 0 to dark red at 1, in even steps of lightness."""
    share = np.clip(share, 0, 1)
    chroma, hue = 0.03 + 0.15 * share, np.radians(95 - 75 * share)
    return _oklab(0.93 - 0.5 * share, chroma * np.cos(hue), chroma * np.sin(hue))


def diverging(share):
    """sRGB (..., 3): blue at -1, white at 0, red at 1, in even steps of lightness."""
    share = np.clip(share, -1, 1)
    size, hue = np.abs(share), np.where(share < 0, np.radians(245), np.radians(35))
    return _oklab(1 - 0.5 * size, 0.17 * size * np.cos(hue), 0.17 * size * np.sin(hue))


def texture_coordinates(body: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
    """Right and up, the longer side in [0, 1]: a projection from the front."""
    flat = body[:, :2] - body[:, :2].min(0)
    return flat / (flat.max() or 1)


def _oklab(lightness, a, b):
    # Ottosson's Oklab (2020) to sRGB. Equal steps look equal, which they do not in HSV.
    to_lms = np.array(
        [
            [1, 0.3963377774, 0.2158037573],
            [1, -0.1055613458, -0.0638541728],
            [1, -0.0894841775, -1.2914855480],
        ]
    )
    to_rgb = np.array(
        [
            [4.0767416621, -3.3077115913, 0.2309699292],
            [-1.2684380046, 2.6097574011, -0.3413193965],
            [-0.0041960863, -0.7034186147, 1.7076147010],
        ]
    )
    lms = (np.stack([lightness, a, b], -1) @ to_lms.T) ** 3
    rgb = np.clip(lms @ to_rgb.T, 0, 1)
    return np.where(rgb > 0.0031308, 1.055 * rgb ** (1 / 2.4) - 0.055, 12.92 * rgb)

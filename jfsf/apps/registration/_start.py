"""Size and side of a template beside a scan, read from a map."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from jfsf.apps.registration._settings import RegistrationSettings

SAMPLES = 400


class Start(NamedTuple):
    """scale: factor of the template's lengths. sign: -1 for a map that mirrors."""

    scale: float
    sign: int


def start_of(vertices, images, settings: RegistrationSettings) -> Start:
    """Scale and side of a map.

    They are read in small neighbourhoods, since the shape as a whole bends: the scale
    is the median of what the map stretches these by, the side that of most of their
    volume.

    Args:
        vertices: (n, 3) of the template.
        images: (n, 3) their images.
        settings: see `RegistrationSettings`.
    """
    n = len(vertices)
    size = min(n, max(12, round(settings.scale_neighbours * n)))
    at = np.unique(np.linspace(0, n - 1, min(n, SAMPLES)).round().astype(int))
    near = np.asarray(KDTree(vertices).query(vertices[at], size)[1])
    here, there = (p[near] - p[near].mean(1, keepdims=True) for p in (vertices, images))
    before, after = ((one**2).sum((1, 2)) for one in (here, there))
    scale = np.sqrt(np.median(after / np.maximum(before, 1e-300)))
    spread = np.einsum("skc,skd->scd", there, here)
    least = np.linalg.svd(spread, compute_uv=False)[:, 2]
    side = np.sum(np.sign(np.linalg.det(spread)) * least)
    return Start(float(scale), -1 if side < 0 else 1)

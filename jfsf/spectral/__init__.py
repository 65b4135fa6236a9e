"""Shapes by their spectra: eigenpairs, and all that is made of them.

Read in this order:

- `_laplacian`: stiffness and mass of a mesh, and solves with such matrices
- `_lanczos`: the largest eigenpairs of an operator, many at a time
- `_eigenpairs`: `Mesh` to `Spectrum`, on the host
- `_descriptors`: wave and heat kernel signatures, curvature
- `_functional_maps`: point maps to functional maps and to aligned embeddings
- `_orientation`: oriented products of gradients, which tell left from right
- `_sampling`: farthest points, and a spectrum at samples only
- `_features`: all that search and refinement read of one shape
"""

from jfsf.spectral._descriptors import curvature, hks, wks
from jfsf.spectral._eigenpairs import spectrum
from jfsf.spectral._features import Features, FeatureSettings, features
from jfsf.spectral._functional_maps import (
    embeddings,
    functional_map,
    polar,
    truncate,
    truncate_pair,
    uniform,
)
from jfsf.spectral._sampling import farthest_points, restrict, tile_points

__all__ = [
    "FeatureSettings",
    "Features",
    "curvature",
    "embeddings",
    "farthest_points",
    "features",
    "functional_map",
    "hks",
    "polar",
    "restrict",
    "spectrum",
    "tile_points",
    "truncate",
    "truncate_pair",
    "uniform",
    "wks",
]

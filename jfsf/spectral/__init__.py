"""Shapes by their spectra: eigenpairs, and all that is made of them.

Read in this order:

- `_laplacian`: stiffness and mass of a mesh
- `_definite`: solves with a sparse matrix that is positive definite
- `_lanczos`: the largest eigenpairs of an operator, many at a time
- `_eigenpairs`: `Mesh` to `Spectrum`, on the host
- `_descriptors`: wave and heat kernel signatures, curvature
- `_functional_maps`: point maps to functional maps and to aligned embeddings
- `_orientation`: oriented products of gradients, which tell left from right
- `_sampling`: farthest points, and a spectrum at samples only
- `_features`: all that search and refinement read of one shape
"""

from jfsf.spectral._definite import definite_solver
from jfsf.spectral._descriptors import (
    CURVATURE_TIMES,
    curvature,
    hks,
    standardise,
    wks,
)
from jfsf.spectral._eigenpairs import spectrum, spectrum_of_valid
from jfsf.spectral._features import Features, FeatureSettings, features
from jfsf.spectral._functional_maps import (
    Space,
    coefficients,
    embeddings,
    functional_map,
    polar,
    truncate,
    truncate_pair,
    uniform,
)
from jfsf.spectral._laplacian import operators, plain_arrays
from jfsf.spectral._orientation import (
    COLUMN_WEIGHT,
    FUNCTIONS,
    PULLED_BACK,
    at_vertices,
    bracket_fields,
    brackets,
    carried_fields,
    orientation_score,
)
from jfsf.spectral._sampling import (
    DISTANCE_PAIRS,
    biharmonic,
    even_points,
    farthest_points,
    restrict,
    rms_distance,
    tile_points,
)

__all__ = [
    "COLUMN_WEIGHT",
    "CURVATURE_TIMES",
    "DISTANCE_PAIRS",
    "FUNCTIONS",
    "FeatureSettings",
    "Features",
    "PULLED_BACK",
    "Space",
    "at_vertices",
    "biharmonic",
    "definite_solver",
    "rms_distance",
    "bracket_fields",
    "brackets",
    "carried_fields",
    "curvature",
    "coefficients",
    "embeddings",
    "even_points",
    "farthest_points",
    "features",
    "functional_map",
    "hks",
    "operators",
    "plain_arrays",
    "orientation_score",
    "polar",
    "restrict",
    "spectrum",
    "spectrum_of_valid",
    "standardise",
    "tile_points",
    "truncate",
    "truncate_pair",
    "uniform",
    "wks",
]

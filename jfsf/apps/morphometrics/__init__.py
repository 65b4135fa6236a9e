"""Geometric morphometrics of landmarks: from an array of them to shapes compared.

The array holds specimens by landmarks by x, y and z, as `jfsf collection` and
`jfsf.apps.landmarks.read_specimens` give it. Superimpose the specimens, slide their
semilandmarks, then look at their principal components, at size, and at asymmetry.
Arrays are numpy's, in double precision.

Read in this order:

- `_checks`: arguments, checked
- `_sliding`: semilandmarks along curves and surfaces
- `_procrustes`: specimens superimposed, with sliding semilandmarks or without
- `_spline`: the thin-plate spline in space: shapes warped, missing landmarks estimated
- `_statistics`: principal components, and shape against size
- `_symmetry`: the symmetric and the asymmetric part of each specimen
- `_tables`: lists of semilandmarks, pairs and groups, as files
- `_draw`: charts
"""

from jfsf.apps.morphometrics._procrustes import procrustes
from jfsf.apps.morphometrics._spline import estimate_missing, warp
from jfsf.apps.morphometrics._statistics import allometry, components
from jfsf.apps.morphometrics._symmetry import symmetric_parts

__all__ = [
    "allometry",
    "components",
    "estimate_missing",
    "procrustes",
    "symmetric_parts",
    "warp",
]

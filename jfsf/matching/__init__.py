"""Two meshes to their maps, on the host.

Read in this order:

- `_match`: checks and spectra, then the policy: `match`, `alternatives`,
  `symmetry`, `basis`, `attempted_pair`
"""

from jfsf.matching._match import (
    alternatives,
    attempted_pair,
    basis,
    check_matchable,
    match,
    symmetry,
)

__all__ = [
    "alternatives",
    "attempted_pair",
    "basis",
    "check_matchable",
    "match",
    "symmetry",
]

"""Two meshes to their maps, on the host.

Read in this order:

- `_match`: checks and spectra, then the policy: `match`, `alternatives`,
  `symmetry`, `basis`, `attempted_pair`
- `_warm_up`: the programs of `match`, compiled before there are shapes
"""

from jfsf.matching._match import (
    alternatives,
    attempted_pair,
    basis,
    check_matchable,
    match,
    symmetry,
)
from jfsf.matching._warm_up import warm_up

__all__ = [
    "alternatives",
    "attempted_pair",
    "basis",
    "check_matchable",
    "match",
    "symmetry",
    "warm_up",
]

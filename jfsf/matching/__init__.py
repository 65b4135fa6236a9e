"""Two meshes to their maps, on the host.

Read in this order:

- `_shapes`: what can be matched, and its spectrum: `check_matchable`, `basis`
- `_attempted`: spectra and programs at the same time, then the policy
- `_partial`: the same of parts
- `_match`: `match`, `alternatives`, `symmetry`, `attempted_pair`
- `_warm_up`: the programs of `match`, compiled before there are shapes
"""

from jfsf.matching._match import (
    alternatives,
    attempted_pair,
    match,
    symmetry,
)
from jfsf.matching._shapes import basis, check_matchable
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

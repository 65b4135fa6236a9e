"""Two meshes to their maps, on the host.

Read in this order:

- `_match`: checks and spectra, then the policy: `match`, `symmetry`, `basis`
"""

from jfsf.matching._match import basis, check_matchable, match, symmetry

__all__ = ["basis", "check_matchable", "match", "symmetry"]

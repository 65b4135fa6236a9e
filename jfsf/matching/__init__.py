"""Two meshes to their maps, on the host.

Read in this order:

- `_running`: the stages of the pipeline as compiled programs
- `_coarse`: copies of large shapes, on which starts are compared
- `_match`: checks and spectra, then the stages: `match`, `symmetry`, `basis`
"""

from jfsf.matching._match import basis, check_matchable, match, padded_bases, symmetry

__all__ = ["basis", "check_matchable", "match", "padded_bases", "symmetry"]

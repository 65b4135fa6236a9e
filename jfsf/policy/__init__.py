"""Which starts are attempted, and when it ends: for one pair or many. Host side.

An attempt (`jfsf.attempt`) makes a match of a start, and says how likely it is right.
Sources of starts are asked in turn, for all pairs that are still in doubt: below
`Settings.retry_below`, or after a first map that misses a landmark. So the first
attempts of all pairs are made together, then the doubtful pairs are gathered, and pairs
without doubt cost nothing more. The more confident match is kept.

The last source, of starts for other proportions, tries all of them on coarse copies
(`jfsf.coarse`), which takes little time, together with the map so far. Only if another
map ranks above this one it goes on to the whole shapes. Maps that differ and rank
nearly as high are rivals: a map that cannot be told from another one is not certain.

Shapes of many vertices are bent as such copies, too (`_bending`), and follow them.

Where a similarity lays the shapes nearly on each other (`_rigid`), nearest points are
the start of a last map, which is the map so far but slides less, and is kept.

Some pairs without doubt are compared so, too (`_others`): where the search found other
candidates that are about as good, as of a shape with a symmetry; where it says that the
mirror image fits better; and two disks, since the search does not see where a rim
begins.

Read in this order:

- `_pairs`: a pair on the way, its attempts, and the best of them
- `_bending`: large shapes are bent as coarse copies first
- `_stages`: the stages of an attempt, run for many pairs
- `_rigid`: shapes that nearly coincide after a similarity
- `_disks`: maps between two disks that turn the rim
- `_others`: maps that may fit as well as one that is not in doubt
- `_sources`: where starts come from: the search, landmarks, coarse copies
- `_match`: the sources in turn, for the pairs in doubt
"""

from jfsf.policy._match import (
    attempt_pairs,
    compile_copies,
    compile_first_attempt,
    match_pairs,
)
from jfsf.policy._pairs import Attempt, PairState
from jfsf.policy._rigid import moved_by_map
from jfsf.policy._sources import Proposal, Source

__all__ = [
    "Attempt",
    "PairState",
    "Proposal",
    "Source",
    "attempt_pairs",
    "compile_copies",
    "compile_first_attempt",
    "match_pairs",
    "moved_by_map",
]

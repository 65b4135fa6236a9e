"""Two meshes to their maps: starts, attempts, evidence, and which attempt is kept.

An attempt makes a match of a start, and says how likely it is right. Sources of starts
are asked in turn, for all pairs that are still in doubt: below `Settings.retry_below`,
or after a first map that misses a landmark. So the first attempts of all pairs are made
together, then the doubtful pairs are gathered, and pairs without doubt cost nothing
more. The more confident match is kept.

The last source, of starts for other proportions, finds them on the whole shapes and
tries all of them on coarse copies (`_coarse`), which takes little time, together with
the map so far. Only if another map ranks above this one it goes on to the whole shapes.
Maps that differ and rank nearly as high are rivals: a map that cannot be told from
another one is not certain.

Shapes of many vertices are bent as such copies, too (`_bent_copies`), and follow them.

Where a similarity and a stiff deformation lay the shapes on each other (`_rigid`,
`_stiff`), a last map is read from there: the map so far, but it slides less.

Some pairs without doubt are compared so, too (`_others`): where the search found other
candidates that are about as good, as of a shape with a symmetry; where it says that the
mirror image fits better; and two disks, since the search does not see where a rim
begins.

Read in this order. Settings and the pure attempt:

- `parts`: the region that two shapes share, where one is a part of the other
- `_stages`: the stages of an attempt that can be replaced, and their defaults
- `_settings`: the tuned numbers of all stages, and those that can be replaced

How likely a map is right, from evidence that needs no ground truth:

- `_kept_landmarks`: whether a map agrees with landmarks, and features without those it
  misses
- `_confidence`: the probability that a map is right, that its mirror image is, and that
  the region of two parts is
- `_rivals`: how a map compares with others that fit nearly as well
- `_vertices`: how far off the image of a vertex may be, and the probability that it is
  mapped right
- `_certificate`: all the evidence that `match` returns, and the cost of bending

Two shapes and a start to a match:

- `_steps`: the steps of an attempt, and their order
- `_attempt`: these folded: the pure `attempt` and `match_spectra`
- `_arguments`: what `match` is given, checked and padded
- `_coarse`: a pair at few vertices, for further starts and for bending large shapes

Which starts are attempted, and when it ends: for one pair or many, on the host:

- `_pairs`: a pair on the way, its attempts, and the best of them
- `_bent_copies`: large shapes are bent as coarse copies first
- `_run_stages`: the stages of an attempt, run for many pairs
- `_stiff`: what a similarity leaves, as a smooth field of few degrees of freedom
- `_rigid`: shapes that nearly coincide after a similarity
- `_disks`: maps between two disks that turn the rim
- `_others`: maps that may fit as well as one that is not in doubt
- `_people`: what a network that knows people says of pairs in doubt
- `_sources`: where starts come from: the search, landmarks, coarse copies
- `_policy`: the sources in turn, for the pairs in doubt

Two meshes:

- `_shapes`: what can be matched, and its spectrum: `check_matchable`, `basis`
- `_attempted`: spectra and programs at the same time, then the policy; `warm_up`
- `_partial`: shapes of which one is a part of the other
- `_match`: `match`, `alternatives`, `symmetry`, `attempted_pair`
"""

from jfsf.matching._attempt import attempt, match_spectra
from jfsf.matching._attempted import warm_up
from jfsf.matching._coarse import carried
from jfsf.matching._confidence import confidence
from jfsf.matching._match import alternatives, match, symmetry
from jfsf.matching._settings import Settings
from jfsf.matching._shapes import basis, check_matchable
from jfsf.matching._stages import (
    Deform,
    Describe,
    Refine,
    deform_by_arap,
    refine_by_zoomout,
)
from jfsf.matching._steps import shape_samples
from jfsf.matching._vertices import vertex_confidence, vertex_radius

__all__ = [
    "Deform",
    "Describe",
    "Refine",
    "Settings",
    "alternatives",
    "attempt",
    "basis",
    "carried",
    "check_matchable",
    "confidence",
    "deform_by_arap",
    "match",
    "match_spectra",
    "refine_by_zoomout",
    "shape_samples",
    "symmetry",
    "vertex_confidence",
    "vertex_radius",
    "warm_up",
]

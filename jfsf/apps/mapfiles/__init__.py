"""Maps, ground truth and matches on disk, checked for base, length and range.

In memory every map is 0-based. On disk `.vts`, `.map` (one index on each line) and
`.mat` are 1-based by convention, `.npz` is 0-based. Some files break the convention
(pyFM's text files are 0-based), so `base` overrides it, and values that contradict it
are an error.
One mistake cannot be detected: a 0-based file that does not use 0, read as 1-based.

Ground truth (FAUST, SCAPE, TOSCA, remeshed): line i of `NAME.vts` is the vertex of that
shape at template point i, whatever the number of vertices; `NAME.sym.vts` is the same
for the left-right mirror image.

Read in this order:

- `_formats`: suffixes, first indices, keys of a match; checks of what is read
- `_arrays`: a file -> its arrays, as they are stored
- `_read`: read maps, ground truth and matches
- `_stored`: all that a map file holds about a pair of meshes
- `_write`: write maps, matches and MATLAB's variables
"""

from jfsf.apps.mapfiles._arrays import read_mat
from jfsf.apps.mapfiles._formats import MapFileError
from jfsf.apps.mapfiles._read import (
    GroundTruth,
    read_ground_truth,
    read_map,
    read_match,
    read_notes,
)
from jfsf.apps.mapfiles._write import write_map, write_mat, write_match

__all__ = [
    "GroundTruth",
    "MapFileError",
    "read_ground_truth",
    "read_map",
    "read_mat",
    "read_match",
    "read_notes",
    "write_map",
    "write_mat",
    "write_match",
]

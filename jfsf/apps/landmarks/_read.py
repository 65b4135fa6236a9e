"""A landmark file of any format that is known, to its landmarks."""

from pathlib import Path

from jfsf.apps.landmarks._fcsv import read_fcsv
from jfsf.apps.landmarks._markups import read_markups
from jfsf.apps.landmarks._meshlab import read_picked_points
from jfsf.apps.landmarks._record import Landmarks, decoded
from jfsf.apps.landmarks._table import read_table

READERS = {
    ".json": read_markups,
    ".fcsv": read_fcsv,
    ".pp": read_picked_points,
    ".csv": read_table,
    ".tsv": read_table,
    ".txt": read_table,
    ".particles": read_table,
}
SUFFIXES = tuple(READERS)
FORMATS = ".mrk.json, .fcsv, .pp, .csv, .tsv, .txt or .particles"


def read_landmarks(path: Path) -> Landmarks:
    """Read named points, or vertices, of one shape.

    Args:
        path: 3D Slicer's .mrk.json and .fcsv, MeshLab's .pp, ShapeWorks' .particles, or
            a table (.csv, .tsv, .txt): a line holds name, x, y and z; or x, y and z; or
            a name and a vertex; or a vertex, counted from 0. Its first line may hold
            titles, and Slicer's l, p, s or r, a, s, or ParaView's Points:0 and so on,
            in place of x, y, z.

    Returns:
        The landmarks that have a position, in the order and the coordinates of the
        file; `said` names the others.

    Raises:
        ValueError: another format, or no landmark; it names the file and the line.
        OSError: the file cannot be read.
    """
    path = Path(path)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise ValueError(f"{path}: unknown format of landmarks; they are {FORMATS}")
    return reader(decoded(path.read_bytes()), path)

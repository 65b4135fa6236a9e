"""Landmarks to a file of any format that is read, completely or not at all."""

from pathlib import Path

from jfsf.apps.landmarks._fcsv import fcsv_text
from jfsf.apps.landmarks._markups import markups_text
from jfsf.apps.landmarks._meshlab import picked_points_text
from jfsf.apps.landmarks._read import FORMATS
from jfsf.apps.landmarks._record import Landmarks, checked, clean_name
from jfsf.apps.landmarks._table import particles_text, table_text
from jfsf.storage._atomic import write_text

_WRITERS = {
    ".json": markups_text,
    ".fcsv": fcsv_text,
    ".pp": picked_points_text,
    ".csv": lambda landmarks: table_text(landmarks, ","),
    ".tsv": lambda landmarks: table_text(landmarks, "\t"),
    ".txt": lambda landmarks: table_text(landmarks, "\t"),
    ".particles": particles_text,
}
_TABLES = ".csv", ".tsv", ".txt"


def write_landmarks(path: Path, landmarks: Landmarks) -> None:
    """Write landmarks as `read_landmarks` reads them, and the program of the format.

    Slicer needs a coordinate system: landmarks without one are written as LPS, in which
    it saves and loads meshes. MeshLab's format does not hold the system, and
    ShapeWorks' neither the system nor names.

    Args:
        path: its suffix is the format: .mrk.json, .fcsv, .pp, .csv, .tsv, .txt or
            .particles.
        landmarks: points in any format; vertices in a table only.

    Raises:
        ValueError: another suffix; vertices and no table; no landmark; a name of
            several lines or with characters that no text holds; wrong shapes.
        OSError: the file cannot be written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in _WRITERS:
        raise ValueError(f"{path}: unknown format of landmarks; they are {FORMATS}")
    landmarks = checked(landmarks, f"{path}: write_landmarks")
    if not landmarks.names:
        raise ValueError(f"{path}: there is no landmark to write")
    if landmarks.points is None and suffix not in _TABLES:
        raise ValueError(
            f"{path}: holds points, and these landmarks are vertices; write "
            f"{', '.join(_TABLES)}, or give mesh.vertices[vertices] as points"
        )
    for name in landmarks.names:
        if clean_name(name) != name:
            raise ValueError(
                f"{path}: the name {name!r} has line ends, control characters or "
                "blanks around it; rename that landmark"
            )
    write_text(path, _WRITERS[suffix](landmarks))

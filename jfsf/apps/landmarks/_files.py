"""Landmark files of any format: read, and written completely or not at all."""

import re
from pathlib import Path

import numpy as np

from jfsf.apps.landmarks._morphometrics import (
    TABLES,
    pts_text,
    read_pts,
    read_tps,
    tps_text,
)
from jfsf.apps.landmarks._programs import (
    fcsv_text,
    markups_text,
    picked_points_text,
    read_fcsv,
    read_markups,
    read_picked_points,
)
from jfsf.apps.landmarks._record import (
    Landmarks,
    check_names,
    checked,
    is_number,
    numbered_lines,
    to_vertex,
)
from jfsf.apps.landmarks._table import particles_text, read_table, table_text
from jfsf.storage._atomic import write_text
from jfsf.storage._text import find_separator, read_text

_READERS = {
    ".json": read_markups,
    ".fcsv": read_fcsv,
    ".pp": read_picked_points,
    ".tps": read_tps,
    ".pts": read_pts,
    **dict.fromkeys((*TABLES, ".particles"), read_table),
}
_WRITERS = {
    ".json": markups_text,
    ".fcsv": fcsv_text,
    ".pp": picked_points_text,
    ".tps": tps_text,
    ".pts": pts_text,
    ".csv": lambda landmarks: table_text(landmarks, ","),
    ".tsv": lambda landmarks: table_text(landmarks, "\t"),
    ".txt": lambda landmarks: table_text(landmarks, "\t"),
    ".particles": particles_text,
}
SUFFIXES = tuple(_READERS)
FORMATS = ".mrk.json, .fcsv, .pp, .tps, .pts, .csv, .tsv, .txt or .particles"
_PAIRS = "a line holds a vertex of X and one of Y, counted from 0"


def read_landmarks(path: Path) -> Landmarks:
    """Read named points, or vertices, of one shape.

    Args:
        path: 3D Slicer's .mrk.json and .fcsv, MeshLab's .pp, ShapeWorks' .particles,
            .tps of one specimen, .pts, or a table (.csv, .tsv, .txt): a line holds
            name, x, y and z; or x, y and z; or a name and a vertex; or a vertex,
            counted from 0. Its first line may hold titles, and Slicer's l, p, s or r,
            a, s in place of x, y, z; a line `sep=;` may come before it. Files are
            UTF-8, or UTF-16 with a byte order mark.

    Returns:
        The landmarks that have a position, in the order and the coordinates of the
        file; `said` names the others.

    Raises:
        ValueError: another format, no UTF-8, or no landmark; it names the file and the
            line.
        OSError: the file cannot be read.
    """
    path = Path(path)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise ValueError(f"{path}: unknown format of landmarks; they are {FORMATS}")
    return reader(read_text(path), path)


def write_landmarks(path: Path, landmarks: Landmarks) -> None:
    """Write landmarks as `read_landmarks` reads them, and the program of the format.

    Slicer needs a coordinate system: landmarks without one are written as LPS, in which
    it saves and loads meshes. MeshLab's format and .pts do not hold the system, and
    ShapeWorks' and .tps neither the system nor names.

    Args:
        path: its suffix is the format: .mrk.json, .fcsv, .pp, .tps, .pts, .csv, .tsv,
            .txt or .particles.
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
    if landmarks.points is None and suffix not in TABLES:
        raise ValueError(
            f"{path}: holds points, and these landmarks are vertices; write "
            f"{', '.join(TABLES)}, or give mesh.vertices[vertices] as points"
        )
    check_names(landmarks, path)
    write_text(path, _WRITERS[suffix](landmarks))


def read_vertex_pairs(path: Path) -> np.ndarray:
    """Pairs of vertices that correspond, counted from 0.

    Args:
        path: a vertex of X and one of Y a line, with blanks, a comma, a semicolon or a
            tab between. # begins a comment, and the first line may hold two titles.

    Returns:
        (l, 2) int64: vertex of X, vertex of Y.

    Raises:
        ValueError: a line of another form, no UTF-8, or no pair; it names the file and
            the line.
        OSError: the file cannot be read.
    """
    path = Path(path)
    if path.suffix.lower() in set(_READERS) - set(TABLES):
        raise ValueError(
            f"{path}: holds points of one shape; give such files as --landmarks-x and "
            "--landmarks-y"
        )
    lines = numbered_lines(read_text(path))
    lines = lines[find_separator([line for _, line in lines], "")[1] :]
    lines = [(number, line.split("#")[0].strip()) for number, line in lines]
    lines = [(number, line) for number, line in lines if line]
    pairs = []
    for at, (number, line) in enumerate(lines):
        words = re.split(r"\s*[,;]\s*|\s+", line)
        words = [word.strip('"') for word in words]
        pair = [to_vertex(word) for word in words]
        if len(pair) == 2 and None not in pair:
            pairs.append(pair)
        elif at or len(pair) != 2 or any(map(is_number, words)):
            raise ValueError(f"{path}: line {number} is {line[:60]!r}; {_PAIRS}")
    if not pairs:
        raise ValueError(f"{path}: holds no pair of vertices; {_PAIRS}")
    return np.array(pairs, np.int64)

"""Pairs of vertices of two shapes in a file of text: one of X and one of Y a line."""

import re
from pathlib import Path

import numpy as np

from jfsf.apps.landmarks._record import decoded, numbered_lines, to_number, to_vertex

EXPECTED = "a line holds a vertex of X and one of Y, counted from 0"
# Those that hold points of one shape in other programs.
_OF_ONE_SHAPE = {".json", ".fcsv", ".pp", ".particles"}


def read_vertex_pairs(path: Path) -> np.ndarray:
    """Pairs of vertices that correspond, counted from 0.

    Args:
        path: a vertex of X and one of Y a line, with blanks, a comma, a semicolon or a
            tab between. # begins a comment, and the first line may hold two titles.

    Returns:
        (l, 2) int64: vertex of X, vertex of Y.

    Raises:
        ValueError: a line of another form, or no pair; it names the file and the line.
        OSError: the file cannot be read.
    """
    path = Path(path)
    if path.suffix.lower() in _OF_ONE_SHAPE:
        raise ValueError(
            f"{path}: holds points of one shape; give such files as --landmarks-x and "
            "--landmarks-y"
        )
    lines = numbered_lines(decoded(path.read_bytes()))
    lines = [(number, line.split("#")[0].strip()) for number, line in lines]
    lines = [(number, line) for number, line in lines if line]
    pairs = []
    for at, (number, line) in enumerate(lines):
        words = re.split(r"\s*[,;]\s*|\s+", line)
        words = [word.strip('"') for word in words]
        pair = [to_vertex(word) for word in words]
        if len(pair) == 2 and None not in pair:
            pairs.append(pair)
        elif at or len(pair) != 2 or any(to_number(w) is not None for w in words):
            raise ValueError(f"{path}: line {number} is {line[:60]!r}; {EXPECTED}")
    if not pairs:
        raise ValueError(f"{path}: holds no pair of vertices; {EXPECTED}")
    return np.array(pairs, np.int64)

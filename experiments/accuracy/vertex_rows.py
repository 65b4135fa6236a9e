"""Evidence and errors of some vertices of a pair, as text in a results file.

A column is one string of numbers: a number a line would make the files long.
"""

import numpy as np
from jaxtyping import Float, Int

from jfsf.matching._vertices import VERTEX_EVIDENCE
from jfsf.types import ArrayLike

NUMBER = 30  # vertices a direction: those of one pair are not independent
ERROR = "error"


def chosen(points: int, *, number: int = NUMBER, seed: int = 0) -> np.ndarray:
    """Which of the points of a ground truth are written, ascending."""
    order = np.random.default_rng(seed).permutation(points)
    return np.sort(order[:number])


def to_row(
    evidence: Float[ArrayLike, "n f"],
    vertices: Int[ArrayLike, " p"],
    errors: Float[ArrayLike, " p"],
    confidence: Float[ArrayLike, " n"],
) -> dict[str, str]:
    """The columns of one direction.

    Args:
        evidence: of all vertices, by `jfsf.matching.vertex_evidence`.
        vertices: those whose error is known.
        errors: theirs, geodesic, in sqrt(area) of the other shape.
        confidence: of all vertices, as `match` returned it.
    """
    columns = zip(VERTEX_EVIDENCE, np.asarray(evidence)[vertices].T, strict=True)
    text = {name: _text(values, "%.2f") for name, values in columns}
    text["confidence"] = _text(np.asarray(confidence)[vertices], "%.2f")
    return {ERROR: _text(errors, "%.3f"), **text}


def from_row(row: dict[str, str]) -> tuple[np.ndarray, np.ndarray]:
    """Evidence (p, f) and errors (p,)."""
    names = (*VERTEX_EVIDENCE, ERROR)
    *evidence, errors = (np.array(row[name].split(), float) for name in names)
    return np.stack(evidence, 1), errors


def _text(values, form):
    return " ".join(form % value for value in np.asarray(values))

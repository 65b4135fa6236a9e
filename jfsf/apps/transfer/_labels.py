"""Labels of Y's vertices or faces -> labels of X's vertices or faces."""

from typing import Literal

import numpy as np

from jfsf.apps.transfer._laid import Laid
from jfsf.apps.transfer._points import (
    Points,
    at_vertices,
    in_faces,
    nearest,
    place,
    sides,
    target,
)
from jfsf.types import ArrayLike

Of = Literal["vertices", "faces"]
PARTS = 4  # of an edge: the square of it are the points of a face that vote
NO_NUMBER, NO_NAME = -1, ""  # where Y has no surface


def labels(
    laid: Laid, labels_y: ArrayLike, *, of: Of | None = None, to: Of | None = None
) -> ArrayLike:
    """Labels carried from Y to X.

    A vertex of X takes the label of its point on Y. A face takes the label of most of
    its area: of points spread evenly over it. A point of Y has the label of its face,
    or of the vertices of its face that weigh most.

    Args:
        laid: X and Y laid on each other (`lay`).
        labels_y: whole numbers, or names, of each vertex or face of Y.
        of: whether they are of Y's "vertices" or "faces"; None: by their number, of
            vertices where it fits both.
        to: whether X's "vertices" or "faces" get them; None: as of Y.

    Returns:
        (n_x,) or (m_x,) of the type of `labels_y`. Where Y has no surface: -1, or "".

    Raises:
        ValueError: other values, or as many as neither the vertices nor the faces; X or
            Y has no faces, and they are asked for.
    """
    labels_y = np.asarray(labels_y)
    n_y, m_y = len(laid.mesh_y.vertices), len(laid.mesh_y.faces)
    if labels_y.ndim != 1 or labels_y.dtype.kind not in "iubUS":
        raise ValueError(
            f"labels: labels_y is {labels_y.dtype} {labels_y.shape}; give whole "
            "numbers or names, one a vertex or one a face of Y"
        )
    for name, value in (("of", of), ("to", to)):
        if value not in (None, "vertices", "faces"):
            raise ValueError(
                f'labels: {name} is {value!r}; "vertices", "faces" or None'
            )
    of = of or ("vertices" if len(labels_y) == n_y else "faces")
    to = to or of
    expected = n_y if of == "vertices" else m_y
    if len(labels_y) != expected or not expected:
        raise ValueError(
            f"labels: labels_y has {len(labels_y)} labels, and Y has {n_y} vertices "
            f"and {m_y} faces; give one a vertex or one a face"
        )
    if to == "faces" and not len(laid.mesh_x.faces):
        raise ValueError("labels: X has no faces; carry to its vertices")
    names, code_y = np.unique(labels_y, return_inverse=True)
    x, y = sides(laid)
    points = at_vertices(x) if to == "vertices" else in_faces(x, _spread(PARTS))
    found = nearest(target(y), *place(x, points))
    code = code_y[found.face] if of == "faces" else _heaviest(found, code_y)
    known = laid.known_x[points.corners].all(1)
    if to == "faces":
        code, known = _most(points.face, code, known, len(x.faces), len(names))
    nothing = NO_NAME if labels_y.dtype.kind in "US" else NO_NUMBER
    kind = np.int64 if labels_y.dtype.kind in "ub" else labels_y.dtype
    return np.where(known, names[code].astype(kind), np.array(nothing).astype(kind))


def _heaviest(found: Points, code):
    """The label of each point: that of the most weight among the corners."""
    at = code[found.corners]
    same = at[:, :, None] == at[:, None, :]
    best = np.einsum("qcd,qd->qc", same, found.weights).argmax(1)
    return np.take_along_axis(at, best[:, None], 1)[:, 0]


def _most(face, code, known, m: int, number: int):
    """The most frequent label (m,) of the known points of a face; whether there is one.

    Among equals it is the first.
    """
    pair, count = np.unique(face[known] * number + code[known], return_counts=True)
    order = np.lexsort((-pair, count))  # so that the best of a face comes last
    label, one = np.zeros(m, int), np.zeros(m, bool)
    label[pair[order] // number] = pair[order] % number
    one[pair // number] = True
    return label, one


def _spread(parts: int):
    """(parts^2, 3) barycentric centres of the equal triangles of a triangle."""
    i, j = np.meshgrid(np.arange(parts), np.arange(parts), indexing="ij")
    up = np.stack([i, j], 2)[i + j < parts] + 1 / 3
    down = np.stack([i, j], 2)[i + j < parts - 1] + 2 / 3
    two = np.concatenate([up, down]) / parts
    return np.concatenate([1 - two.sum(1, keepdims=True), two], 1)

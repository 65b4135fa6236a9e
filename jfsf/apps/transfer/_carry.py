"""Values, labels and landmarks of Y -> X."""

from typing import Literal

import numpy as np
from jaxtyping import Float

from jfsf.apps.landmarks import Landmarks
from jfsf.apps.landmarks._place import on_surface
from jfsf.apps.transfer._nearest import (
    Points,
    finder,
    from_x_to_y,
    in_faces,
    nearest,
    place,
    placed,
    vertices_as_points,
    weighted,
)
from jfsf.apps.transfer._overlay import Overlay
from jfsf.mesh._closest import middles
from jfsf.types import ArrayLike

Of = Literal["vertices", "faces"]
PARTS = 4  # of an edge: the square of it are the points of a face that vote
NO_NUMBER, NO_NAME = -1, ""  # where Y has no surface


def values(overlay: Overlay, values_y: Float[ArrayLike, "n_y ..."]) -> ArrayLike:
    """Values carried from Y to X: each vertex of X gets the value at its point on Y.

    Args:
        overlay: X and Y laid over each other (`overlay`).
        values_y: numbers of each vertex of Y, one or several; nan where there is none.

    Returns:
        (n_x, ...) float64, in the unit of `values_y`: linear on Y's triangles. nan
        where Y has no surface for a vertex, or no value around its point.

    Raises:
        ValueError: not one row of real numbers a vertex of Y.
    """
    values_y = np.asarray(values_y)
    n_y = len(overlay.mesh_y.vertices)
    if values_y.ndim < 1 or len(values_y) != n_y or values_y.dtype.kind not in "fiub":
        raise ValueError(
            f"values: values_y is {values_y.dtype} {values_y.shape}; give ({n_y},) or "
            f"({n_y}, d) numbers, one row a vertex of Y"
        )
    on_y = from_x_to_y(overlay)(vertices_as_points(np.arange(len(overlay.at_x))))
    rows = weighted(values_y.astype(np.float64).reshape(n_y, -1), on_y)
    carried = np.where(overlay.known_x[:, None], rows, np.nan)
    return carried.reshape(-1, *values_y.shape[1:])


def labels(
    overlay: Overlay, labels_y: ArrayLike, *, of: Of | None = None, to: Of | None = None
) -> ArrayLike:
    """Labels carried from Y to X.

    A vertex of X takes the label of its point on Y. A face takes the label of most of
    its area: of points spread evenly over it. A point of Y has the label of its face,
    or of the vertices of its face that weigh most.

    Args:
        overlay: X and Y laid over each other (`overlay`).
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
    n_y, m_y = len(overlay.mesh_y.vertices), len(overlay.mesh_y.faces)
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
    if to == "faces" and not len(overlay.mesh_x.faces):
        raise ValueError("labels: X has no faces; carry to its vertices")
    names, code_y = np.unique(labels_y, return_inverse=True)
    if to == "vertices":
        points = vertices_as_points(np.arange(len(overlay.at_x)))
    else:
        points = in_faces(np.asarray(overlay.mesh_x.faces), middles(PARTS))
    on_y = from_x_to_y(overlay)(points)
    code = code_y[on_y.face] if of == "faces" else _heaviest(on_y, code_y)
    known = overlay.known_x[points.corners].all(1)
    if to == "faces":
        m_x = len(overlay.mesh_x.faces)
        code, known = _most(points.face, code, known, m_x, len(names))
    nothing = NO_NAME if labels_y.dtype.kind in "US" else NO_NUMBER
    kind = np.int64 if labels_y.dtype.kind in "ub" else labels_y.dtype
    return np.where(known, names[code].astype(kind), np.array(nothing).astype(kind))


def _heaviest(points: Points, code):
    """The label of each point: that of the most weight among the corners."""
    at = code[points.corners]
    same = at[:, :, None] == at[:, None, :]
    best = np.einsum("qcd,qd->qc", same, points.weights).argmax(1)
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


def landmarks(overlay: Overlay, landmarks_y: Landmarks) -> Landmarks:
    """Landmarks carried from Y to X.

    Each is a point of the surface of Y. The nearest point of X, where it lies on Y, is
    taken there, and is a point of a triangle of X.

    Args:
        overlay: X and Y laid over each other (`overlay`).
        landmarks_y: points in Y's coordinates, or vertices of Y.

    Returns:
        Points on X, in its coordinates, with the names and the order of the landmarks.
        The system is that of the landmarks: both meshes are taken to have the same
        axes. `said` names those where Y has a surface and X has none.

    Raises:
        ValueError: as `on_surface`; or a landmark on a piece of Y
            that was not matched, so that it has no place (`extended`).
    """
    at = on_surface(landmarks_y, overlay.mesh_y)
    x, y = placed(overlay)
    weights = np.asarray(at.weights)
    points = Points(np.full(len(weights), -1), np.asarray(at.corners), weights)
    positions, normals = place(y, points)
    nowhere = np.flatnonzero(~np.isfinite(positions).all(1))
    if len(nowhere):
        raise ValueError(
            f"landmarks: {_named(landmarks_y, nowhere)} lie on pieces of Y that were "
            "not matched; leave them out"
        )
    on_x = nearest(finder(x), positions, normals)
    there = weighted(np.asarray(overlay.mesh_x.vertices, np.float64), on_x)
    said = [*landmarks_y.said]
    unknown = np.flatnonzero(~overlay.known_x[on_x.corners].all(1))
    if len(unknown):
        names = _named(landmarks_y, unknown)
        said.append(f"{len(unknown)} lie where the map counts for nothing: {names}")
    return Landmarks(
        tuple(landmarks_y.names), there, None, landmarks_y.system, tuple(said)
    )


def _named(landmarks: Landmarks, rows: np.ndarray) -> list[str]:
    """Names of some of them; where they have none, their numbers from 1."""
    return [landmarks.names[i] or str(i + 1) for i in rows.tolist()]

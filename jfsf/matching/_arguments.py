"""The arrays that `jfsf.match` is given, checked on the host before any work.

Each check returns None for None, and raises a ValueError that names the argument, what
was found and what to do.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from jfsf.mesh import surface_area
from jfsf.runtime._sizes import PaddedShape, with_rows
from jfsf.types import ArrayLike, Mesh

# Two shapes of which one is a part of the other: beyond these factors between the
# diagonals of their bounding boxes they may be, or are taken to be, in two units, if
# their triangles differ too. A hand and a body differ by 9 and have triangles of any
# size; smaller parts are not found.
MAYBE_UNITS, TWO_UNITS, TWO_SIZES = 5.0, 12.0, 4.0
# The smaller unit, the larger one, and how many of the first are one of the second.
_UNITS = {
    10.0: ("millimetres", "centimetres"),
    25.4: ("millimetres", "inches"),
    100.0: ("centimetres", "metres"),
    1000.0: ("millimetres", "metres"),
    1e6: ("micrometres", "metres"),
}


class MatchInputs(NamedTuple):
    """What a match is made from beside the shapes; None is left out.

    landmarks: vertices of X, and those of Y in their order.
    descriptors: of X and of Y.
    initial: C_yx or T_xy.
    sign: of the wanted orientation, see `jfsf.initial.orientation_sign`.
    self_map: X and Y are one shape.
    """

    landmarks: Any = None
    descriptors: Any = None
    initial: Any = None
    sign: Any = 1
    self_map: Any = False


def padded_inputs(inputs: MatchInputs, shapes: Sequence[PaddedShape]) -> MatchInputs:
    """The inputs in the padded sizes of X and Y, which may be one shape."""
    descriptors, initial = inputs.descriptors, inputs.initial
    n_x, n_y, k = shapes[0].vertices, shapes[-1].vertices, shapes[0].eigenpairs
    if descriptors is not None:
        sides = zip(descriptors, (n_x, n_y), strict=True)
        descriptors = tuple(jnp.asarray(with_rows(*side)) for side in sides)
    if initial is not None:
        # Shapes that are small have fewer eigenpairs than C_yx may have rows.
        is_map = initial.ndim == 1
        initial = jnp.asarray(with_rows(initial, n_x) if is_map else initial[:k, :k])
    return inputs._replace(descriptors=descriptors, initial=initial)


def checked_landmarks(
    landmarks: ArrayLike, sizes: tuple[int, int]
) -> tuple[Int[Array, " l"], Int[Array, " l"]] | None:
    """Vertices of X, and those of Y, as int32; `sizes` are n_x and n_y."""
    if landmarks is None:
        return None
    pairs = _array("landmarks", landmarks)
    # No rows are none, of any type: numpy makes floats of an empty list.
    if pairs.shape in ((0,), (0, 2)):
        return None
    if pairs.ndim != 2 or pairs.shape[1] != 2:
        raise ValueError(
            f"match: landmarks have shape {pairs.shape}; give rows (vertex of X, "
            "vertex of Y)"
        )
    if not np.issubdtype(pairs.dtype, np.integer):
        raise ValueError(f"match: landmarks are {pairs.dtype}; give vertex numbers")
    for column, (n, name) in enumerate(zip(sizes, ("mesh_x", "mesh_y"), strict=True)):
        low, high = pairs[:, column].min(), pairs[:, column].max()
        if low < 0 or high >= n:
            raise ValueError(
                f"match: landmarks name vertices {low} to {high} of {name}, which has "
                f"vertices 0 to {n - 1}"
            )
    at_x, at_y = jnp.asarray(pairs.T, jnp.int32)
    return at_x, at_y


def checked_map(
    T_xy: Any,
    matched_x: Any,
    sizes: tuple[int, int],
    *,
    caller: str,
    called: tuple[str, str] = ("T_xy", "matched_x"),
    names: tuple[str, str] = ("X", "Y"),
) -> tuple[np.ndarray, np.ndarray]:
    """A point-to-point map and where it counts, everywhere if `matched_x` is None.

    Args:
        T_xy, matched_x: of each vertex of X.
        sizes: n_x and n_y.
        caller, called, names: the function, its arguments, and both shapes, in errors.

    Raises:
        ValueError: they do not fit the shapes.
    """
    (n_x, n_y), (map_name, matched_name), (one, other) = sizes, called, names
    T = np.asarray(T_xy)
    if T.shape != (n_x,) or T.dtype.kind not in "iu":
        raise ValueError(
            f"{caller}: {map_name} is {T.dtype} {T.shape}; give ({n_x},) whole "
            f"numbers, the vertex of {other} for each of {one}: does it run the other "
            "way?"
        )
    if T.min() < 0 or T.max() >= n_y:
        raise ValueError(
            f"{caller}: {map_name} names vertices {T.min()} to {T.max()}, and {other} "
            f"has {n_y}, from 0 on: does it run the other way?"
        )
    matched = np.ones(n_x, bool) if matched_x is None else np.asarray(matched_x)
    if matched.shape != (n_x,) or matched.dtype != bool:
        raise ValueError(
            f"{caller}: {matched_name} is {matched.dtype} {matched.shape}; give "
            f"({n_x},) bool"
        )
    return T, matched


def doubtful_units(
    mesh_x: Mesh,
    mesh_y: Mesh,
    *,
    names: tuple[str, str] = ("mesh_x", "mesh_y"),
    above: float = MAYBE_UNITS,
) -> str:
    """A sentence on two shapes that may be in different units; "" if they are not.

    Args:
        mesh_x, mesh_y: with faces; one is a part of the other, or both overlap.
        names: of them, in the sentence.
        above: the factor between their sizes from which on it is said.
    """
    sizes = [
        float(np.linalg.norm(np.ptp(np.asarray(mesh.vertices, float), axis=0)))
        for mesh in (mesh_x, mesh_y)
    ]
    triangles = [
        np.sqrt(surface_area(mesh) / max(len(mesh.faces), 1))
        for mesh in (mesh_x, mesh_y)
    ]
    large, small = (0, 1) if sizes[0] > sizes[1] else (1, 0)
    if sizes[small] <= 0 or triangles[small] <= 0:
        return ""
    factor = sizes[large] / sizes[small]
    if factor < above or triangles[large] / triangles[small] < TWO_SIZES:
        return ""
    of_unit = min(_UNITS, key=lambda known: abs(np.log(factor / known)))
    fine, coarse = _UNITS[of_unit]
    return (
        f"{names[large]} is {sizes[large]:.4g} across and {names[small]} "
        f"{sizes[small]:.4g}, {factor:.4g} times less, and parts are found in one unit "
        f"only. If {names[large]} is in {fine}, and {names[small]} in {coarse}, "
        f"multiply the coordinates of {names[small]} by {of_unit:g}"
    )


def check_one_unit(mesh_x: Mesh, mesh_y: Mesh) -> None:
    """ValueError for parts that must be in two units: see `doubtful_units`."""
    if doubt := doubtful_units(mesh_x, mesh_y, above=TWO_UNITS):
        raise ValueError(f"match: partial=True: {doubt}, or give same_unit=False")


def checked_descriptors(
    descriptors: Any, sizes: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray] | None:
    """(desc_x, desc_y), finite, in jax's default precision."""
    if descriptors is None:
        return None
    if not isinstance(descriptors, tuple | list) or len(descriptors) != 2:
        raise ValueError(
            f"match: descriptors are {type(descriptors).__name__}; give (desc_x, "
            "desc_y), a matrix a shape"
        )
    dtype = jnp.zeros(0).dtype
    found = [_array("descriptors", matrix) for matrix in descriptors]
    for matrix, n, name in zip(found, sizes, ("mesh_x", "mesh_y"), strict=True):
        if matrix.ndim != 2 or len(matrix) != n or matrix.shape[1] == 0:
            raise ValueError(
                f"match: descriptors of {name} are {matrix.shape}; give ({n}, d), a "
                "row a vertex"
            )
        if matrix.dtype.kind not in "fiub" or not np.isfinite(matrix).all():
            raise ValueError(
                f"match: descriptors of {name} are {matrix.dtype}, or not finite; give "
                "finite numbers"
            )
    if found[0].shape[1] != found[1].shape[1]:
        raise ValueError(
            f"match: descriptors have {found[0].shape[1]} columns on mesh_x and "
            f"{found[1].shape[1]} on mesh_y; column i of one corresponds to column i "
            "of the other"
        )
    with np.errstate(over="ignore"):
        desc_x, desc_y = (matrix.astype(dtype) for matrix in found)
        if not all(np.isfinite(matrix**2).all() for matrix in (desc_x, desc_y)):
            most = max(np.abs(np.asarray(m, float)).max() for m in found)
            raise ValueError(
                f"match: descriptors go up to {most:.3g}, whose square {dtype} does "
                "not hold; divide them by that"
            )
    return desc_x, desc_y


def checked_initial(initial: Any, sizes: tuple[int, int]) -> np.ndarray | None:
    """C_yx (k_x, k_y) in jax's default precision, or T_xy (n_x,) as int32."""
    if initial is None:
        return None
    values = _array("initial", getattr(initial, "T_xy", initial))
    if values.ndim == 1 and np.issubdtype(values.dtype, np.integer):
        n_x, n_y = sizes
        if len(values) == 0:
            raise ValueError(f"match: initial is a map of 0 vertices; mesh_x has {n_x}")
        if len(values) != n_x or values.min() < 0 or values.max() >= n_y:
            raise ValueError(
                f"match: initial is a map of {len(values)} vertices to vertices "
                f"{values.min()} to {values.max()}; mesh_x has {n_x} vertices, mesh_y "
                f"vertices 0 to {n_y - 1}: is it the map from Y to X?"
            )
        return values.astype(np.int32)
    if values.ndim != 2 or min(values.shape) < 2 or values.dtype.kind != "f":
        raise ValueError(
            f"match: initial is {values.dtype} {values.shape}; give C_yx (k_x, k_y), "
            "T_xy (n_x,) as integers, or a record with T_xy"
        )
    if not np.isfinite(values).all():
        raise ValueError("match: initial is not finite; give another functional map")
    return values.astype(jnp.zeros(0).dtype)


def _array(name: str, values: Any) -> np.ndarray:
    """An array; ValueError for rows of unequal lengths."""
    try:
        return np.asarray(values)
    except ValueError:
        raise ValueError(
            f"match: {name} has rows of unequal lengths; give one array"
        ) from None

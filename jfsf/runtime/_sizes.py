"""Few sizes, so few programs: the shapes of a pair are padded to common ones.

Mass 0 and face (0, 0, 0) mark the padding. Functions of this package ignore it, so the
results on the other vertices stay the same.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jfsf.types import Mesh, Spectrum

SMALLEST = 320
# Up to FINER_ABOVE it takes longer to compile for another size than to run for twice as
# many vertices.
FINER_ABOVE = 64 * SMALLEST


class PaddedShape(NamedTuple):
    """All that programs are compiled for, of one shape."""

    eigenpairs: int
    vertices: int
    faces: int


def common_size(size: int) -> int:
    """The size to which a shape of `size` vertices is padded.

    From 320 up each is twice the one before, to 20 480; from there on there are four a
    doubling. 5120 suits the meshes of about 5000 vertices that this field uses most.
    """
    power = SMALLEST
    while 2 * power < size:
        power *= 2
    step = power // 4 if size > FINER_ABOVE else power
    return power + max(-(-(size - power) // step), 0) * step


def padded_shapes(
    eigenpairs: int, sizes: Sequence[tuple[int, int]]
) -> list[PaddedShape]:
    """What the shapes of a pair are padded to.

    Args:
        eigenpairs: of each shape.
        sizes: vertices and faces of each shape; the one shape of a self map.
    """
    # A closed surface has twice as many faces as vertices, so one number serves both.
    counts = [common_size(max(n, -(-m // 2))) for n, m in sizes]
    # One size for both is half the program, and fewer programs over many pairs. For
    # very different shapes it would be far more work.
    if max(counts) <= 4 * min(counts):
        counts = [max(counts)] * len(counts)
    # Beside a mesh, a cloud without a surface is padded with faces: one program.
    faces = any(m for _, m in sizes)
    return [PaddedShape(eigenpairs, n, 2 * n if faces else 0) for n in counts]


def spectrum_like(shape: PaddedShape, dtype: Any = None) -> Spectrum:
    """A spectrum's shapes and types, before its values are there.

    Args:
        shape: what it is padded to.
        dtype: of its numbers; jax's own (float64 with x64) if None.
    """
    k, n, m = shape
    number = jnp.zeros(0).dtype if dtype is None else dtype
    like: Any = jax.ShapeDtypeStruct
    return Spectrum(
        like((k,), number),
        like((n, k), number),
        like((n,), number),
        like((m, 3), jnp.int32),
        like((n, 3), number),
    )


def padded(spec: Spectrum, shape: PaddedShape) -> Spectrum:
    """The spectrum, cut and padded to this size, as numpy arrays."""
    k, n, m = shape
    # By numpy: operations on jax arrays of each size would compile for each size.
    spec = jax.tree.map(np.asarray, spec)
    return pad(spec._replace(evals=spec.evals[:k], evecs=spec.evecs[:, :k]), n, m)


def padded_pair(spec_x: Spectrum, spec_y: Spectrum) -> tuple[Spectrum, Spectrum]:
    """Both spectra, cut to equally many eigenpairs and padded as `jfsf.match` does."""
    pair = spec_x, spec_y
    k = min(len(spec.evals) for spec in pair)
    shapes = padded_shapes(k, [(len(spec.mass), len(spec.faces)) for spec in pair])
    x, y = map(padded, pair, shapes)
    return x, y


def pad(spec: Spectrum, n: int, m: int) -> Spectrum:
    """`spec` with n vertices and m faces. numpy arrays stay numpy arrays.

    Raises:
        ValueError: `spec` has more than n vertices or more than m faces.
    """
    n_spec, m_spec = len(spec.mass), len(spec.faces)
    if n < n_spec or m < m_spec:
        raise ValueError(
            f"pad: {(n_spec, m_spec)} vertices and faces do not fit into {(n, m)}"
        )
    rows = len(spec.evals), n, n, m, n  # of its fields
    return Spectrum(*map(with_rows, spec, rows))


def surface_of(spec: Spectrum) -> Mesh:
    """The mesh of a spectrum, without padding."""
    n = int(np.sum(np.asarray(spec.mass) > 0))
    faces = np.asarray(spec.faces)
    real = (faces[:, 0] != faces[:, 1]) | (faces[:, 1] != faces[:, 2])
    return Mesh(np.asarray(spec.vertices, float)[:n], faces[real])


def with_rows(array: Any, n: int) -> Any:
    """The array filled up with zeros to n rows; a numpy array stays one."""
    width = [(0, n - len(array))] + [(0, 0)] * (array.ndim - 1)
    return (np if isinstance(array, np.ndarray) else jnp).pad(array, width)

"""Common sizes for arrays, so that one compiled program serves many meshes."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from jfsf.types import Spectrum

# Up to FINER_ABOVE it takes longer to compile for another size than to run for twice as
# many vertices.
SMALLEST = 320
FINER_ABOVE = 64 * SMALLEST


def padded_size(size: int, *, per_doubling: int = 8, first: int = 256) -> int:
    """The smallest common size that is at least `size`.

    The common sizes are first * 2^i * (1 + j / per_doubling) for i = 0, 1, 2, ... and
    j < per_doubling. From `first` up, the padding is less than size / per_doubling: the
    default wastes little, and per_doubling=2 (256, 384, 512, 768, 1024, ...) compiles
    few programs.

    Raises:
        ValueError: per_doubling is below 1, or first is not a positive multiple of it.
    """
    if per_doubling < 1 or first < 1 or first % per_doubling:
        raise ValueError(
            f"padded_size: first is {first}, which is no positive multiple of "
            f"per_doubling = {per_doubling}"
        )
    power = first
    while 2 * power < size:
        power *= 2
    step = power // per_doubling
    return power + max(-(-(size - power) // step), 0) * step


def common_size(size: int) -> int:
    """The size to which `jfsf.match` pads a shape of `size` vertices.

    From 320 up each is twice the one before, to 20 480; from there on there are four a
    doubling. 5120 suits the meshes of about 5000 vertices that this field uses most.
    """
    large = size > FINER_ABOVE
    return padded_size(size, per_doubling=4 if large else 1, first=SMALLEST)


def pad(spec: Spectrum, n: int, m: int) -> Spectrum:
    """`spec` with n vertices and m faces: mass 0 and face (0, 0, 0) mark the padding.

    Functions of this package ignore padding, so the results on the other vertices stay
    the same. numpy arrays stay numpy arrays: padding them compiles nothing.

    Raises:
        ValueError: `spec` has more than n vertices or more than m faces.
    """
    n_spec, m_spec = len(spec.mass), len(spec.faces)
    if n < n_spec or m < m_spec:
        raise ValueError(
            f"pad: {(n_spec, m_spec)} vertices and faces do not fit into {(n, m)}"
        )
    rows, faces = ((0, n - n_spec),), ((0, m - m_spec), (0, 0))
    return Spectrum(
        spec.evals,
        _pad(spec.evecs, (*rows, (0, 0))),
        _pad(spec.mass, rows),
        _pad(spec.faces, faces),
        _pad(spec.vertices, (*rows, (0, 0))),
    )


def _pad(array, width) -> Any:
    return (np if isinstance(array, np.ndarray) else jnp).pad(array, width)

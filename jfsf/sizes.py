"""Few sizes, so few programs: what `match` hands to its stages is padded to them."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jfsf.array import common_size, pad
from jfsf.settings import Settings
from jfsf.spectral import truncate
from jfsf.types import Spectrum


class Given(NamedTuple):
    """The arguments of `run_stages` beside the spectra; None is left out."""

    landmarks: Any
    descriptors: Any
    initial: Any
    sign: Any
    self_map: bool


class Size(NamedTuple):
    """All that programs are compiled for, of one shape."""

    eigenpairs: int
    vertices: int
    faces: int


def padded_sizes(meshes, settings: Settings) -> list[Size]:
    """The sizes to which these meshes, surfaces or clouds, are padded."""
    meshes = list(meshes)
    k = min(settings.eigenpairs(len(mesh.vertices)) for mesh in meshes)
    # A closed surface has twice as many faces as vertices, so one number serves both.
    wanted = [max(len(m.vertices), -(-len(m.faces) // 2)) for m in meshes]
    sizes = list(map(common_size, wanted))
    # One size for both is half the program, and fewer programs over many pairs. For
    # very different shapes it would be far more work.
    if max(sizes) <= 4 * min(sizes):
        sizes = [max(sizes)] * len(sizes)
    # Beside a mesh, a cloud without a surface is padded with faces: one program.
    faces = any(len(mesh.faces) for mesh in meshes)
    return [Size(k, n, 2 * n if faces else 0) for n in sizes]


def spectrum_like(size: Size) -> Spectrum:
    """A spectrum's shapes and types, before its values are there."""
    k, n, m = size
    return jax.eval_shape(
        lambda: Spectrum(
            jnp.zeros(k),
            jnp.zeros((n, k)),
            jnp.zeros(n),
            jnp.zeros((m, 3), jnp.int32),
            jnp.zeros((n, 3)),
        )
    )


def padded(spec: Spectrum, size: Size) -> Spectrum:
    """The spectrum in this size."""
    # By numpy: operations on jax arrays of each size would compile for each size.
    cut = truncate(spec, size.eigenpairs)
    return jax.tree.map(jnp.asarray, pad(cut, size.vertices, size.faces))


def padded_arguments(given: Given, sizes: list[Size]) -> Given:
    """The arguments in the sizes of X and Y."""
    n = [size.vertices for size in sizes]
    if given.descriptors is not None:
        pair = zip(given.descriptors, (n[0], n[-1]), strict=True)
        given = given._replace(descriptors=tuple(_rows(*side) for side in pair))
    if given.initial is not None and given.initial.ndim == 1:
        given = given._replace(initial=_rows(given.initial, n[0]))
    elif given.initial is not None and max(given.initial.shape) > sizes[0].eigenpairs:
        k = sizes[0].eigenpairs  # the shapes are small, and have no more
        given = given._replace(initial=given.initial[:k, :k])
    return given


def _rows(array: np.ndarray, n: int) -> Array:
    """The array as jax's own, filled up with zeros to n rows."""
    width = [(0, n - len(array))] + [(0, 0)] * (array.ndim - 1)
    return jnp.asarray(np.pad(array, width))

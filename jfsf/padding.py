"""Spectra padded to common sizes: one compiled program serves meshes of many sizes."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from jfsf.types import Spectrum


def pad(spec: Spectrum, n: int, m: int) -> Spectrum:
    """`spec` with n vertices and m faces: mass 0 and face (0, 0, 0) mark the padding.

    Every function of jfsf leaves the padding out, so the results on the real vertices
    do not change. numpy arrays stay numpy arrays: for them nothing is compiled.

    Raises:
        ValueError: n or m is less than what is there.
    """
    have = len(spec.mass), len(spec.faces)
    if n < have[0] or m < have[1]:
        raise ValueError(f"pad: {have} vertices and faces do not fit into {(n, m)}")
    rows, faces = ((0, n - have[0]),), ((0, m - have[1]), (0, 0))
    return Spectrum(
        spec.evals,
        _pad(spec.evecs, (*rows, (0, 0))),
        _pad(spec.mass, rows),
        _pad(spec.faces, faces),
        _pad(spec.vertices, (*rows, (0, 0))),
    )


def bucket(size: int, step: int = 512) -> int:
    """`size` rounded up, so that sizes nearby share a program."""
    return -(-size // step) * step


def rung(size: int, first: int = 256) -> int:
    """`size` rounded up to 256, 384, 512, 768, 1024, 1536, ...: few sizes, near enough.

    A rung is at most half as large again as `size`, from `first` up.
    """
    power = first
    while power < size:
        if size <= power + power // 2:
            return power + power // 2
        power *= 2
    return power


def _pad(array, width) -> Any:
    return (np if isinstance(array, np.ndarray) else jnp).pad(array, width)

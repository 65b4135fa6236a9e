"""Spectra padded to common sizes: one compiled program serves meshes of many sizes."""

import jax.numpy as jnp

from jfsf.types import Spectrum


def pad(spec: Spectrum, n: int, m: int) -> Spectrum:
    """`spec` with n vertices and m faces: mass 0 and face (0, 0, 0) mark the padding.

    Every function of jfsf leaves the padding out, so the results on the real vertices
    do not change.

    Raises:
        ValueError: n or m is less than what is there.
    """
    have = len(spec.mass), len(spec.faces)
    if n < have[0] or m < have[1]:
        raise ValueError(f"pad: {have} vertices and faces do not fit into {(n, m)}")
    rows, faces = ((0, n - have[0]),), ((0, m - have[1]), (0, 0))
    return Spectrum(
        spec.evals,
        jnp.pad(spec.evecs, (*rows, (0, 0))),
        jnp.pad(spec.mass, rows),
        jnp.pad(spec.faces, faces),
        jnp.pad(spec.vertices, (*rows, (0, 0))),
    )


def bucket(size: int, step: int = 512) -> int:
    """`size` rounded up, so that sizes nearby share a program."""
    return -(-size // step) * step

"""What a match of two spectra is given beside them: arrays whose shapes fit."""

from typing import Any

import jax.numpy as jnp

from jfsf.types import Spectrum


def check_spectrum(spec: Any, name: str) -> None:
    """ValueError, which `name` opens, if a mesh or a file stands for a spectrum."""
    if not (hasattr(spec, "evals") and hasattr(spec, "mass")):
        raise ValueError(
            f"{name} is a {type(spec).__name__}, not a spectrum; pass "
            "jfsf.basis(mesh), of a mesh that jfsf.read has read"
        )


def given_arrays(
    pair: tuple[Spectrum, Spectrum], landmarks: Any, descriptors: Any, initial: Any
) -> tuple[Any, Any, Any]:
    """Landmarks, descriptors and an initial map; each may be None, or traced.

    Args:
        pair: the spectra of X and Y.
        landmarks, descriptors, initial: as `jfsf.match_spectra`.

    Raises:
        ValueError: they do not fit the spectra, or these each other. Values are not
            looked at.
    """
    for name, spec in zip(("spec_x", "spec_y"), pair, strict=True):
        check_spectrum(spec, f"match_spectra: {name}")
    k_x, k_y = (len(spec.evals) for spec in pair)
    sizes = [len(spec.mass) for spec in pair]
    if k_x != k_y:
        raise ValueError(
            f"match_spectra: the spectra have {k_x} and {k_y} eigenpairs; cut both to "
            "as many (jfsf.spectral.truncate)"
        )
    if landmarks is not None:
        landmarks = jnp.asarray(landmarks)
        # No rows are none, of any type: numpy makes floats of an empty list.
        if landmarks.shape in ((0,), (0, 2)):
            landmarks = None
    if landmarks is not None:
        whole = jnp.issubdtype(landmarks.dtype, jnp.integer)
        if landmarks.ndim != 2 or landmarks.shape[1] != 2 or not whole:
            raise ValueError(
                f"match_spectra: landmarks are {landmarks.dtype} {landmarks.shape}; "
                "give (l, 2) integers, a vertex of X and its partner on Y in each row"
            )
    if descriptors is not None:
        if not isinstance(descriptors, tuple | list) or len(descriptors) != 2:
            raise ValueError(
                f"match_spectra: descriptors are {type(descriptors).__name__}; give "
                "(desc_x, desc_y)"
            )
        descriptors = tuple(map(jnp.asarray, descriptors))
        shapes = tuple(matrix.shape for matrix in descriptors)
        columns = {shape[1:] for shape in shapes}
        fit = [shape[:1] for shape in shapes] == [(n,) for n in sizes]
        if not fit or len(columns) > 1 or not all(len(shape) == 2 for shape in shapes):
            raise ValueError(
                f"match_spectra: descriptors are {shapes[0]} and {shapes[1]}, the "
                f"shapes have {sizes[0]} and {sizes[1]} vertices; give a row a vertex, "
                "and equally many columns"
            )
    if initial is not None:
        initial = jnp.asarray(getattr(initial, "T_xy", initial))
    return landmarks, descriptors, initial

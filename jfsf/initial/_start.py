"""What spectra are given, checked; candidates -> the starts of attempts.

Starts are those of the search, or for other proportions.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jfsf._exported import exported
from jfsf.array._jit import jit
from jfsf.initial._proportions import DESCRIPTOR_WEIGHT, nonisometric_candidates
from jfsf.initial._samples import SearchSamples
from jfsf.initial._search import candidates
from jfsf.initial._settings import SearchSettings
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


@exported
class Start(NamedTuple):
    """Where the refinement starts.

    C_yx: the functional map to begin with: functions on Y pulled back to X.
    orientation: its orientation score in [-1, 1]; nan for point clouds without a
        surface.
    gap: the energy of the search's second candidate over that of its first, minus 1;
        nan if the start is not the first candidate of the search.
    descriptor_weight: weight of the columns beside the eigenfunctions in the
        refinement.
    mirror_gap: how the mirror image compares in the search (`Candidates.mirror_gap`);
        nan if the start does not come from the search.
    """

    C_yx: Float[Array, "k_x k_y"]
    orientation: Float[Array, ""]
    gap: Float[Array, ""]
    descriptor_weight: Float[Array, ""]
    mirror_gap: Float[Array, ""]

    @property
    def sign(self) -> Float[Array, ""]:
        """1 for a map that keeps orientation, -1 for one that mirrors, 0 if unknown."""
        return jnp.sign(jnp.nan_to_num(self.orientation))


@jit(static_argnames="settings")
def search_starts(
    x: SearchSamples,
    y: SearchSamples,
    sign: Int[Array, ""] | int = 1,
    self_map: Bool[Array, ""] | bool = False,
    *,
    settings: SearchSettings = SearchSettings(),
) -> tuple[Start, Start]:
    """The first of `candidates` with its gap to the second, and all the others.

    Args:
        x, y: X and Y at samples, made with the same settings.
        sign: sign of the wanted orientation (`orientation_sign`).
        self_map: whether X and Y are one shape.
        settings: parameters of the search.

    Returns:
        The first candidate, and the others along a leading axis. The gap of each other
        one is its own energy minus that of the first: inf for a copy of a better one.
    """
    best = candidates(x, y, sign, self_map, settings=settings)
    gap = best.energy[1] / best.energy[0] - 1
    weight = jnp.full_like(gap, settings.descriptor_weight)
    first = Start(best.C_yx[0], best.orientation[0], gap, weight, best.mirror_gap)
    above = best.energy[1:] - best.energy[0]
    others = Start(
        best.C_yx[1:],
        best.orientation[1:],
        above,
        jnp.full_like(above, settings.descriptor_weight),
        jnp.broadcast_to(best.mirror_gap, above.shape),
    )
    return first, others


@jit(static_argnames="settings")
def nonisometric_starts(
    x: SearchSamples,
    y: SearchSamples,
    sign: Int[Array, ""] | int = 1,
    self_map: Bool[Array, ""] | bool = False,
    *,
    settings: SearchSettings = SearchSettings(),
) -> Start:
    """Starts for shapes of other proportions: `jfsf.initial.nonisometric_candidates`.

    Args:
        x, y, sign, self_map, settings: as `search_starts`.

    Returns:
        As many maps as `settings.nonisometric_candidates`, along the leading axis.
    """
    maps = nonisometric_candidates(x, y, sign, self_map, settings=settings)
    unknown = jnp.full_like(maps.energy, jnp.nan)
    # The score of a rough map may have the wrong sign. The refinement then asks for
    # the wanted one.
    wanted = sign * jnp.abs(maps.orientation)
    score = jnp.where(sign == 0, maps.orientation, wanted)
    weight = jnp.full_like(unknown, DESCRIPTOR_WEIGHT)
    return Start(maps.C_yx, score, unknown, weight, unknown)

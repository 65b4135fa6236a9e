"""Spectrum -> Features: all that the search and the refinement read of one shape."""

from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jfsf._exported import exported
from jfsf.array._jit import check_types, jit
from jfsf.spectral._descriptors import curvature, hks, standardise, wks
from jfsf.spectral._orientation import FUNCTIONS, at_vertices, brackets
from jfsf.spectral._sampling import restrict
from jfsf.types import Spectrum

LANDMARK_TIMES = 10  # heat kernel signatures a landmark


@dataclass(frozen=True)
class FeatureSettings:
    """How the features of a shape are made. Hashable, for static arguments.

    wks_energies: number of energies of the wave kernel signature.
    wks_step: every so many energies of the wave kernel signature one is kept, as
        neighbouring ones are nearly equal.
    keep_wks: whether the wave kernel signature is kept beside descriptors that are
        given.
    curvature_weight: weight of a standardised curvature column relative to a
        standardised descriptor column.
    """

    wks_energies: int = 100
    wks_step: int = 5
    keep_wks: bool = False
    curvature_weight: float = 1.5

    def __post_init__(self) -> None:
        """ValueError for a value of another type."""
        check_types(self)


@exported
class Features(NamedTuple):
    """A shape, and columns that tell its points apart beside the eigenfunctions.

    spec: the spectrum, whole or restricted to samples.
    descriptors: descriptors as they were given; column i corresponds to column i of the
        other shape. They rank maps.
    curvature: standardised columns of curvature; like descriptors, they rank maps.
    columns: what refinement appends to the eigenfunctions: standardised descriptors and
        weighted curvature. 0 for a self map, since a shape resembles itself most under
        the identity.
    brackets: oriented products of eigenfunctions (`brackets`), whose size does not
        depend on the number of vertices.
    """

    spec: Spectrum
    descriptors: Float[Array, "n d"]
    curvature: Float[Array, "n b"]
    columns: Float[Array, "n e"]
    brackets: Float[Array, "s s s"]

    @property
    def bracket_fields(self) -> Float[Array, "n s s"]:
        """The brackets at each vertex. They are not kept: nothing else is as large.

        Negate those of one shape to ask for a map that mirrors.
        """
        return at_vertices(self.spec, self.brackets)

    def at(self, samples: Int[Array, " s"]) -> "Features":
        """The features at these vertices alone; see `restrict`."""
        return Features(
            restrict(self.spec, samples),
            self.descriptors[samples],
            self.curvature[samples],
            self.columns[samples],
            self.brackets,
        )


@jit(static_argnames="settings")
def features(
    spec: Spectrum,
    descriptors: Float[Array, "n d"] | None = None,
    landmarks: Int[Array, " l"] | None = None,
    *,
    self_map: Bool[Array, ""] | bool = False,
    settings: FeatureSettings = FeatureSettings(),
) -> Features:
    """The features of one shape.

    Args:
        spec: faces wound outward, or none: then nothing is known of orientation.
        descriptors: one row for each vertex, in any unit and sign; the wave kernel
            signature when absent.
        landmarks: vertices, in range (not checked), in the order of the other shape's.
            Heat kernel signatures seen from them are appended to the descriptors.
        self_map: whether the shape will be matched with itself; may be traced.
        settings: see `FeatureSettings`.

    Raises:
        ValueError: descriptors without one row for each vertex.
    """
    if descriptors is not None and (
        descriptors.ndim != 2 or len(descriptors) != len(spec.mass)
    ):
        raise ValueError(
            f"features: descriptors are {descriptors.shape}, the shape has "
            f"{len(spec.mass)} vertices"
        )
    given = [] if descriptors is None else [descriptors.astype(spec.evecs.dtype)]
    if descriptors is None or settings.keep_wks:
        given.append(wks(spec, num=settings.wks_energies)[:, :: settings.wks_step])
    if landmarks is not None:
        # Heat from a landmark is positive, but for what the cut of the spectrum adds.
        seen = hks(spec, landmarks, num=LANDMARK_TIMES)
        given.append(jnp.maximum(seen, 0))
    all_descriptors = jnp.concatenate(given, 1) if len(given) > 1 else given[0]
    standard = standardise(curvature(spec), spec.mass)
    weighted = settings.curvature_weight * standard
    columns = jnp.concatenate([standardise(all_descriptors, spec.mass), weighted], 1)
    k = min(FUNCTIONS, len(spec.evals))
    return Features(
        spec,
        all_descriptors,
        standard,
        jnp.where(self_map, 0, columns),
        brackets(spec, k=k),
    )

"""The template on one shape of a collection: by its own map, and by all trusted ways.

The errors of maps by way of different shapes are partly independent, so their mean is
nearer to the truth than each: a collection gains what a pair alone cannot.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from jfsf.apps.collections._grow import PAIRS_A_SHAPE, matched
from jfsf.apps.registration import Registration, RegistrationSettings, register
from jfsf.matching import Settings, match
from jfsf.mesh import closest, surface_area
from jfsf.mesh._closest import surface_tree
from jfsf.types import ArrayLike, Maps, Match, Mesh

# Of distances from 0.005 to 1 those from 0.01 to 0.04 are equally good
# (experiments/fit/fit_agree.py).
WITHIN = 0.02


class OtherShape(NamedTuple):
    """Another shape of a collection, whose map to this one is trusted.

    mesh: of the other shape.
    template: where the vertices of the template lie on it.
    T: the vertex of this shape for each vertex of the other.
    """

    mesh: Mesh
    template: Float[ArrayLike, "n 3"]
    T: Int[ArrayLike, " m"]


def agreed_map(
    template: Float[ArrayLike, "n 3"],
    others: Sequence[OtherShape],
    mesh: Mesh,
    *,
    within: float = WITHIN,
) -> Int[np.ndarray, " n"]:
    """The vertex of a shape for each vertex of the template, agreed on by all paths.

    Args:
        template: where the template's vertices lie on the shape by its own map.
        others: for each other path, where the template's vertices lie on the shape:
            from the template to another shape, and on by the map of that pair.
        mesh: the shape.
        within: distance from the median of all paths, in sqrt(area) of the shape, from
            which on a path counts little in the mean: weights are those of Geman and
            McClure (1985), 1 / (1 + (d / within)^2)^2.

    Returns:
        The vertex nearest to the mean.
    """
    vertices = np.asarray(mesh.vertices, float)
    ways = np.stack([template, *(_carried(other, vertices) for other in others)])
    apart = np.linalg.norm(ways - np.median(ways, 0), axis=2)
    weight = 1 / (1 + (apart / (within * np.sqrt(surface_area(mesh)))) ** 2) ** 2
    mean = np.einsum("wn,wni->ni", weight / weight.sum(0), ways)
    return np.asarray(KDTree(vertices).query(mean)[1], np.int32)


def _carried(other: OtherShape, vertices: np.ndarray) -> np.ndarray:
    """Points of the template on the other shape, on this one: between its vertices."""
    found = closest(surface_tree(other.mesh), other.template)
    corners = np.asarray(other.T)[np.asarray(other.mesh.faces)[found.face]]
    return np.einsum("nc,nci->ni", found.barycentric, vertices[corners])


@dataclass(frozen=True)
class CollectionSettings:
    """How a collection is matched.

    pairs_a_shape: most pairs that are matched, for each shape on average.
    match: settings of the match of each pair.
    registration: settings of the registration of the template onto each shape.
    """

    pairs_a_shape: float = PAIRS_A_SHAPE
    match: Settings = Settings()
    registration: RegistrationSettings = RegistrationSettings()


class Member(NamedTuple):
    """A shape of a collection.

    maps: X is the template, Y the shape.
    match: where the maps are from; None for the template itself.
    registration: the template on the shape.
    """

    maps: Maps
    match: Match | None
    registration: Registration

    @property
    def confidence(self) -> float:
        """Of the maps; 1 for the template itself."""
        return 1.0 if self.match is None else float(self.match.certificate.confidence)


def member(
    template: Mesh,
    mesh: Mesh,
    T: Int[ArrayLike, " n"],
    *,
    settings: CollectionSettings = CollectionSettings(),
    cache: bool = True,
) -> Member:
    """The template on a shape, from a map that may be rough.

    Args:
        template: its topology is kept.
        mesh: the shape.
        T: the vertex of the shape for each vertex of the template.
        settings, cache: as `collection`.

    Raises:
        MeshError, ValueError: as `match`.
    """
    # What is tried beside the start was weighed when the pairs were matched.
    own = replace(settings.match, retry_below=0.0)
    T = np.asarray(T, np.int32)
    found = match(template, mesh, initial=T, settings=own, cache=cache)
    maps = matched(found).maps
    on_shape = register(template, mesh, maps.T_xy, settings=settings.registration)
    return Member(maps, found, on_shape)


def agreed_registration(
    template: Mesh,
    mesh: Mesh,
    own: Registration,
    others: Sequence[OtherShape],
    *,
    settings: CollectionSettings = CollectionSettings(),
) -> Registration:
    """The template on a shape, by all trusted ways that lead there.

    Args:
        template, mesh: as `member`.
        own: the template on the shape by its own map.
        others: of the shapes whose map to this one is trusted.
        settings: as `collection`.
    """
    T = agreed_map(own.vertices, others, mesh)
    return register(template, mesh, T, settings=settings.registration)


def itself(
    template: Mesh, *, settings: CollectionSettings = CollectionSettings()
) -> Member:
    """The template as a member of its own collection."""
    own: Any = np.arange(len(template.vertices), dtype=np.int32)
    on_itself = register(template, template, own, settings=settings.registration)
    return Member(Maps(own, own), None, on_itself)

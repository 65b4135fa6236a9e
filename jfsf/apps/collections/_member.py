"""The template on one shape of a collection: by its own map, and by all ways."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Int

from jfsf.apps.collections._agree import OtherShape, agreed_map
from jfsf.apps.collections._grow import PAIRS_A_SHAPE, matched
from jfsf.apps.registration import Registration, RegistrationSettings, register
from jfsf.matching import Settings, match
from jfsf.types import ArrayLike, Maps, Match, Mesh


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

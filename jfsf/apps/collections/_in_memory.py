"""The work of a collection, on meshes in memory."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from jfsf.apps.collections._agree import OtherShape
from jfsf.apps.collections._grow import Graph, Matched, matched
from jfsf.apps.collections._member import (
    CollectionSettings,
    Member,
    agreed_registration,
    itself,
    member,
)
from jfsf.apps.collections._pairs import Edge
from jfsf.initial._search import Orientation
from jfsf.matching import match
from jfsf.mesh._edit import mirror_image
from jfsf.types import Mesh


@dataclass
class InMemory:
    """Does the work of a collection on meshes (`Runner`): what fails, raises.

    meshes: of all shapes; those that are mirrored back are so after `place`.
    names: of the shapes.
    orientation: as `collection`.
    settings: of all steps.
    cache: as `collection`.
    say: called with the name of each step as it begins.
    members: of each shape on which the template was placed, by its number.
    """

    meshes: list[Mesh]
    names: Sequence[str]
    orientation: Orientation
    settings: CollectionSettings
    cache: bool
    say: Callable[[str], object]
    members: dict[int, Member] = field(default_factory=dict)

    def match(self, edges: list[Edge], turned: bool) -> list[Matched]:
        found, of = [], "the mirror image of " if turned else ""
        for number, (a, b) in enumerate(edges, 1):
            pair = f"{of}{self.names[a]}, {self.names[b]}"
            self.say(f"pair {number} of {len(edges)}: {pair}")
            x = self.meshes[a]
            own = match(
                mirror_image(x) if turned else x,
                self.meshes[b],
                orientation=self.orientation,
                settings=self.settings.match,
                cache=self.cache,
            )
            found.append(matched(own))
        return found

    def place(self, graph: Graph, ways) -> dict[int, str]:
        for i in graph.mirrored_back:
            self.meshes[i] = mirror_image(self.meshes[i])
        base = self.meshes[graph.paths.template]
        options = {"settings": self.settings, "cache": self.cache}
        for i, T in ways.items():
            if i == graph.paths.template:
                self.members[i] = itself(base, settings=self.settings)
            else:
                self.say(f"template onto {self.names[i]}")
                self.members[i] = member(base, self.meshes[i], T, **options)
        return {}

    def agree(self, graph: Graph, maps) -> dict[int, str]:
        base = self.meshes[graph.paths.template]
        # All by what `place` made, whichever comes first.
        placed = dict(self.members)
        for i, known in maps.items():
            if i == graph.paths.template:
                continue
            self.say(f"template onto {self.names[i]}, by all ways")
            others = [
                OtherShape(self.meshes[j], placed[j].registration.vertices, T)
                for j, T in known
            ]
            own, mesh = placed[i].registration, self.meshes[i]
            on_shape = agreed_registration(
                base, mesh, own, others, settings=self.settings
            )
            self.members[i] = placed[i]._replace(registration=on_shape)
        return {}

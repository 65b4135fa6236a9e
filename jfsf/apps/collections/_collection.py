"""Many meshes -> one topology: pairs, a template, and the template on every shape."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jfsf.apps.collections._cycles import Edge, sketch
from jfsf.apps.collections._engine import join_shapes, reason
from jfsf.apps.collections._grow import Graph, Matched, matched
from jfsf.apps.collections._member import (
    CollectionSettings,
    Member,
    OtherShape,
    agreed_registration,
    itself,
    member,
)
from jfsf.apps.collections._mirror import Mirror, check_mirror
from jfsf.apps.model import ShapeModel, fit_model
from jfsf.initial import orientation_sign
from jfsf.initial._search import Orientation
from jfsf.matching import basis, check_matchable, match
from jfsf.mesh import MeshError, closest
from jfsf.mesh._closest import surface_tree
from jfsf.mesh._edit import mirror_image
from jfsf.mesh._values import mesh_arrays
from jfsf.types import ArrayLike, Mesh


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


class Collection(NamedTuple):
    """Many shapes with one topology.

    names: a name for each shape.
    meshes: the mesh of each shape as it was given; a mirror image that was mirrored
        back is stored mirrored.
    graph: the pairs that were matched, and the probability of each map.
    members: for each shape, the template on it; None for a shape that was left out.
    """

    names: tuple[str, ...]
    meshes: tuple[Mesh, ...]
    graph: Graph
    members: tuple[Member | None, ...]

    @property
    def template(self) -> int:
        """The number of the shape whose topology all have."""
        return self.graph.paths.template

    @property
    def joined(self) -> list[int]:
        """Numbers of the shapes that were not left out."""
        return [i for i, one in enumerate(self.members) if one is not None]

    @property
    def registered(self) -> Float[ArrayLike, "j n 3"]:
        """The template on each of the joined shapes, in their own units."""
        members = [one for one in self.members if one is not None]
        return np.stack([one.registration.vertices for one in members])

    def map_between(self, x: int, y: int) -> Int[np.ndarray, " n_x"]:
        """The vertex of shape y for each vertex of shape x, by way of the template.

        From x to y and on to z is from x to z, up to the rounding to vertices: maps
        agree round all cycles as far as the shapes have vertices there.

        Raises:
            ValueError: a shape that was left out.
        """
        on_x, on_y = (self._member("map_between", i) for i in (x, y))
        return np.asarray(on_y.maps.T_xy)[np.asarray(on_x.maps.T_yx)]

    def points_between(self, x: int, y: int) -> Float[np.ndarray, "n_x 3"]:
        """The point of shape y, in its unit, for each vertex of shape x.

        By the registered template: the nearest point of it on x, and that point of it
        on y. No vertex is rounded to on the way, so this is nearer to the truth than
        `map_between`.

        Raises:
            ValueError: a shape that was left out.
        """
        on_x, on_y = (self._member("points_between", i) for i in (x, y))
        faces = np.asarray(self.meshes[self.template].faces)
        surface = surface_tree(Mesh(on_x.registration.vertices, faces))
        found = closest(surface, self.meshes[x].vertices)
        corners = np.asarray(on_y.registration.vertices)[faces[found.face]]
        return np.einsum("nc,nci->ni", found.barycentric, corners)

    def _member(self, caller: str, i: int) -> Member:
        found = self.members[i]
        if found is None:
            raise ValueError(
                f"{caller}: {self.names[i]} was left out: "
                f"{reason(self.graph, self.names, i)}"
            )
        return found

    def model(self, *, modes: int | None = None, scale: bool = False) -> ShapeModel:
        """The mean of the joined shapes and how they vary
        (`jfsf.apps.model.fit_model`).

        About the origin, wherever the shapes lie.

        Raises:
            ValueError: fewer than two shapes were joined.
        """
        faces = self.meshes[self.template].faces
        shapes = self.registered
        centred = shapes - shapes.mean(1, keepdims=True)
        return fit_model(centred, faces, modes=modes, scale=scale)


def collection(
    meshes: Sequence[Mesh],
    *,
    names: Sequence[str] | None = None,
    template: int | None = None,
    orientation: Orientation = "preserve",
    mirror: Mirror = "name",
    settings: CollectionSettings = CollectionSettings(),
    cache: bool = True,
    progress: Callable[[str], object] | None = None,
) -> Collection:
    """Give many shapes one topology, that of the most central one.

    A sparse graph of pairs is matched (`first_pairs`); maps that disagree round
    triangles are not trusted (`trust`), and more pairs are matched until trusted maps
    reach every shape or there are `pairs_a_shape`. The maps along the path from the
    template to a shape, composed, are the start of a map between the two. It is
    refined, and the template is deformed onto the shape by it (`jfsf.register`), and
    then once more by the mean of all trusted paths that lead there (`agreed_map`).

    Args:
        meshes: two or more, each as `match` takes it, any units and poses.
        names: a name for each shape; numbers if None.
        template: the number, from 0, of the shape that is deformed onto all others; the
            most central one if None.
        orientation, cache: as `match`.
        mirror: what to do with shapes that are mirror images of the template, such as
            left bones among right ones (`grow_with_mirrors`): "name" leaves them out,
            and `reason` says so; "auto" mirrors them back in x. Only if orientation is
            "preserve".
        settings: parameters of all steps.
        progress: called with the name of each step as it begins.

    Returns:
        The collection; a member that was left out is None, and `reason` says why.

    Raises:
        MeshError: a mesh that cannot be matched; the message begins with its name.
        ValueError: fewer than two meshes, names or a template that do not fit, or
            another word for `mirror` or `orientation`.
    """
    names = tuple(map(str, range(len(meshes)))) if names is None else tuple(names)
    _check(meshes, names, template)
    check_mirror(mirror)
    orientation_sign(orientation)
    for name, mesh in zip(names, meshes, strict=True):
        check_surface(mesh, name)
        check_matchable(mesh, name=name, settings=settings.match)
    say = progress or (lambda step: None)
    sketches = []
    for name, mesh in zip(names, meshes, strict=True):
        say(f"spectrum of {name}")
        spec = basis(mesh, name=name, settings=settings.match, cache=cache)
        sketches.append(sketch(spec))
    runner = InMemory(list(meshes), names, orientation, settings, cache, say)
    graph, _ = join_shapes(
        sketches,
        runner,
        template=template,
        orientation=orientation,
        mirror=mirror,
        pairs_a_shape=settings.pairs_a_shape,
    )
    members = tuple(runner.members.get(i) for i in range(len(names)))
    return Collection(names, tuple(runner.meshes), graph, members)


def check_surface(mesh: Mesh, name: str) -> None:
    """MeshError for a point cloud, onto which no template can be deformed."""
    if len(mesh_arrays(mesh, name)[1]) == 0:
        raise MeshError(
            "has no faces, and a collection registers surfaces",
            "triangulate it (jfsf.mesh.reconstruct)",
            name,
        )


def _check(meshes, names, template) -> None:
    s = len(meshes)
    if s < 2:
        raise ValueError(f"collection: has {s} shapes; give two or more")
    if len(names) != s:
        raise ValueError(f"collection: {len(names)} names for {s} shapes")
    if len(set(names)) < s:
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"collection: two shapes are named {twice!r}; rename one")
    if template is not None and not 0 <= template < s:
        raise ValueError(
            f"collection: template is {template}; it is the number of a shape, from 0 "
            f"to {s - 1}"
        )

"""Many shapes at once: which pairs are matched, and maps that agree round all cycles.

Read in this order:

- `_sketch`: what is kept of each shape
- `_pairs`: a sparse graph of pairs, from the spectra alone
- `_cycles`: which maps are right, by the maps round triangles
- `_paths`: the template, and the way from it to each shape
- `_grow`: pairs are matched until trusted maps reach every shape
- `_synchronise`: functional maps of all shapes to the template, at once
- `_collection`: many meshes to one topology
"""

from jfsf.joint._collection import (
    Collection,
    CollectionSettings,
    Member,
    check_surface,
    collection,
    itself,
    member,
    reason,
)
from jfsf.joint._cycles import Triangle, triangles, trust
from jfsf.joint._grow import Graph, Matched, PairSettings, grow, matched
from jfsf.joint._pairs import first_pairs, more_pairs, unlikeness
from jfsf.joint._paths import Paths, best_paths, map_along
from jfsf.joint._sketch import Sketch, sketch
from jfsf.joint._synchronise import synchronise

__all__ = [
    "Collection",
    "CollectionSettings",
    "Member",
    "Graph",
    "Matched",
    "PairSettings",
    "Paths",
    "Sketch",
    "Triangle",
    "best_paths",
    "check_surface",
    "collection",
    "first_pairs",
    "grow",
    "itself",
    "map_along",
    "matched",
    "member",
    "more_pairs",
    "reason",
    "sketch",
    "synchronise",
    "triangles",
    "trust",
    "unlikeness",
]

"""Many shapes at once: which pairs are matched, and maps by way of one.

Read in this order:

- `_sketch`: what is kept of each shape
- `_pairs`: a sparse graph of pairs, from the spectra alone
- `_cycles`: which maps are right, by the maps round triangles
- `_paths`: the template, and the way from it to each shape
- `_grow`: pairs are matched until sure maps reach every shape
- `_mirror`: which shapes are mirror images of the others
- `_agree`: where the template lies on a shape, by all ways that lead there
- `_synchronise`: functional maps of all shapes to the template, at once
- `_reasons`: why a shape was left out
- `_member`: the template on one shape
- `_collection`: many meshes to one topology
"""

from jfsf.joint._agree import Beside, agreed_map
from jfsf.joint._collection import Collection, check_surface, collection
from jfsf.joint._cycles import Triangle, triangles, trust
from jfsf.joint._grow import (
    Graph,
    Matched,
    MirrorTest,
    PairSettings,
    grow,
    matched,
)
from jfsf.joint._member import (
    CollectionSettings,
    Member,
    agreed_member,
    itself,
    member,
)
from jfsf.joint._mirror import Mirror, grow_with_mirrors, mirror_images, suspects
from jfsf.joint._pairs import first_pairs, more_pairs, unlikeness
from jfsf.joint._paths import Paths, best_paths, map_along
from jfsf.joint._reasons import mirrored, reason
from jfsf.joint._sketch import Sketch, sketch
from jfsf.joint._synchronise import synchronise

__all__ = [
    "Beside",
    "Collection",
    "CollectionSettings",
    "Member",
    "Graph",
    "Matched",
    "Mirror",
    "MirrorTest",
    "PairSettings",
    "Paths",
    "Sketch",
    "Triangle",
    "agreed_map",
    "agreed_member",
    "best_paths",
    "check_surface",
    "collection",
    "first_pairs",
    "grow",
    "grow_with_mirrors",
    "itself",
    "map_along",
    "matched",
    "member",
    "mirror_images",
    "mirrored",
    "more_pairs",
    "reason",
    "sketch",
    "suspects",
    "synchronise",
    "triangles",
    "trust",
    "unlikeness",
]

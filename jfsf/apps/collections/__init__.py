"""Many shapes at once: which pairs are matched, and maps by way of one.

Read in this order:

- `_cycles`: a sparse graph of pairs, and which maps are right, by those round triangles
- `_grow`: pairs are matched until sure maps reach every shape, from the template
- `_sides`: which shapes are on the side of the template, by the votes of all pairs
- `_mirror`: which shapes are mirror images of the others
- `_member`: the template on one shape, by its own map and by all ways that lead there
- `_engine`: the steps, for any runner that does the work; why a shape was left out
- `_collection`: many meshes in memory to one topology
"""

from typing import TYPE_CHECKING

from jfsf._moved import names_of
from jfsf.apps.collections._collection import Collection, collection
from jfsf.apps.collections._cycles import trust, unlikeness
from jfsf.apps.collections._engine import reason
from jfsf.apps.collections._grow import grow
from jfsf.apps.collections._member import CollectionSettings, agreed_map

__all__ = [
    "Collection",
    "CollectionSettings",
    "agreed_map",
    "collection",
    "grow",
    "reason",
    "trust",
    "unlikeness",
]

if not TYPE_CHECKING:
    __getattr__ = names_of(__name__)

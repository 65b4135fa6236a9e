"""Many shapes at once: which pairs are matched, and maps by way of one.

Read in this order:

- `_sketch`: what is kept of each shape
- `_pairs`: a sparse graph of pairs, from the spectra alone
- `_cycles`: which maps are right, by the maps round triangles
- `_paths`: the template, and the way from it to each shape
- `_grow`: pairs are matched until sure maps reach every shape
- `_mirror`: which shapes are mirror images of the others
- `_agree`: where the template lies on a shape, by all ways that lead there
- `_reasons`: why a shape was left out
- `_member`: the template on one shape
- `_engine`: the steps, for any runner that does the work
- `_in_memory`: a runner on meshes in memory
- `_collection`: many meshes to one topology
"""

from typing import TYPE_CHECKING

from jfsf._moved import names_of
from jfsf.apps.collections._agree import agreed_map
from jfsf.apps.collections._collection import Collection, collection
from jfsf.apps.collections._cycles import trust
from jfsf.apps.collections._grow import grow
from jfsf.apps.collections._member import CollectionSettings
from jfsf.apps.collections._pairs import unlikeness
from jfsf.apps.collections._reasons import reason

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

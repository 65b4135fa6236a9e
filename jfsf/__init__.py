"""JAX Fast Sinkhorn Filters: maps between non-rigid 3D shapes.

New here? Begin with `jfsf.guide.start`; `jfsf.guide` lists all guides.

`match` goes the whole way from two meshes, and `Settings` changes any stage of it. The
folders are its parts, in the order in which data goes through them. A module imports
only from those above its own:

- `types`: the records that travel between functions
- `array`: precise products, top-k, both sides in one program, padding
- `solvers`: fixed points and least squares to a tolerance
- `storage`: files written whole, the disk cache, compiled programs
- `mesh`: files to meshes; check, repair, measure
- `neighbours`: nearest neighbours, exhaustive or among tiles
- `spectral`: spectra, descriptors, functional maps, orientation, samples
- `convert`: aligned embeddings to point-to-point maps
- `refine`: ICP, ZoomOut, and deformation as rigid as possible
- `initial`: fits to descriptors, and the search for the initial map
- `evaluate`: geodesics, metrics, the certificate
- `parts`: the region that two shapes share, where one is a part of the other
- `settings`: every tuned number, and every stage that can be replaced
- `pipeline`: spectra to maps, stage by stage
- `arguments`: checks of what `match` is given
- `sizes`: few sizes to pad to, so few programs
- `matching`: meshes to maps
- `mapfiles`: maps, ground truth and matches on disk
- `interop`: to and from other packages: pyFM, MATLAB, torch, trimesh, meshio, ott-jax
- `batch`: many pairs, over devices, hosts and clusters
- `baselines`: the paper's rivals
- `data`: embedded shapes with ground truth
- `plot`: pictures by colour transfer, and charts
- `export`: meshes in the colours of a map, for other programs
- `report`: pages to look at a map in a browser, and the confidence in words
- `testing`: strategies and laws for property tests
- `cli`: the command line
- `guide`: the guides of the manual, a page each
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jfsf.initial import SearchSettings
    from jfsf.matching import basis, check_matchable, match, symmetry
    from jfsf.mesh import MeshError, check, read
    from jfsf.neighbours import NeighbourSettings
    from jfsf.pipeline import match_spectra
    from jfsf.refine import ArapSettings, ZoomOutSettings
    from jfsf.settings import Settings
    from jfsf.spectral import FeatureSettings, spectrum
    from jfsf.types import Certificate, Maps, Match, Mesh, Spectrum

__all__ = [
    "ArapSettings",
    "Certificate",
    "FeatureSettings",
    "Maps",
    "Match",
    "Mesh",
    "MeshError",
    "NeighbourSettings",
    "SearchSettings",
    "Settings",
    "Spectrum",
    "ZoomOutSettings",
    "basis",
    "check",
    "check_matchable",
    "match",
    "match_spectra",
    "read",
    "spectrum",
    "symmetry",
]
__version__ = "0.2.0"

# All is imported on first use. So `import jfsf` takes no time, and the command line can
# see to interrupts before it imports numpy and jax (`jfsf.__main__`).
_HOMES = {
    "initial": ("SearchSettings",),
    "matching": ("basis", "check_matchable", "match", "symmetry"),
    "mesh": ("MeshError", "check", "read"),
    "neighbours": ("NeighbourSettings",),
    "pipeline": ("match_spectra",),
    "refine": ("ArapSettings", "ZoomOutSettings"),
    "settings": ("Settings",),
    "spectral": ("FeatureSettings", "spectrum"),
    "types": ("Certificate", "Maps", "Match", "Mesh", "Spectrum"),
}
_ROOMS = (
    *("array", "solvers", "storage", "convert", "evaluate", "parts", "arguments"),
    *("sizes", "mapfiles", "interop", "batch", "baselines", "data", "plot", "export"),
    *("report", "testing", "cli", "guide"),
    *_HOMES,
)


def __getattr__(name: str) -> Any:
    if name in _ROOMS:
        return import_module(f"jfsf.{name}")
    for room, names in _HOMES.items():
        if name in names:
            value = getattr(import_module(f"jfsf.{room}"), name)
            return globals().setdefault(name, value)
    raise AttributeError(f"module 'jfsf' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, *_ROOMS})

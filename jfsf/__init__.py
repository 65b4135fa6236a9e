"""JAX Fast Sinkhorn Filters: maps between non-rigid 3D shapes.

New here? Begin with `jfsf.guide.start`; `jfsf.guide` lists all guides.

`match` goes the whole way from two meshes, and `Settings` changes any stage of it. The
folders are its parts, in the order in which data goes through them. A module imports
only from those above its own:

- `types`: the records that travel between functions
- `array`: precise products, top-k, both sides in one program
- `solvers`: fixed points and least squares to a tolerance
- `storage`: files written whole, the disk cache
- `runtime`: few padded sizes, compiled programs, and how they are run
- `mesh`: files to meshes; check, repair, measure
- `geometry`: geodesics, normals and cotangents of a surface
- `neighbours`: nearest neighbours, exhaustive or among tiles
- `spectral`: spectra, descriptors, functional maps, orientation, samples
- `convert`: aligned embeddings to point-to-point maps
- `evaluate`: metrics of a map, against ground truth or by its own properties
- `refine`: ICP, ZoomOut, and deformation as rigid as possible
- `initial`: fits to descriptors, and the search for the initial map
- `parts`: the region that two shapes share, where one is a part of the other
- `stages`: the stages of an attempt that can be replaced, and their defaults
- `settings`: the tuned numbers of all stages, and those that can be replaced
- `evidence`: how likely a map is right, without ground truth: the certificate
- `attempt`: two shapes and a start to a match, pure: `match_spectra`
- `arguments`: what `match` is given, checked and padded
- `coarse`: a pair at few vertices, for further starts and for bending large shapes
- `policy`: which starts are attempted, for one pair or many, and when it ends
- `matching`: meshes to maps
- `registration`: a template mesh deformed onto a scan
- `mapfiles`: maps, ground truth and matches on disk
- `landmarks`: landmark files of other programs: read, written, paired, carried
- `interop`: to and from other packages: pyFM, MATLAB, torch, trimesh, meshio, ott-jax
- `batch`: many pairs, over devices, hosts and clusters
- `baselines`: the paper's rivals
- `data`: embedded shapes with ground truth
- `plot`: pictures by colour transfer, and charts
- `export`: meshes in the colours of a map, for other programs
- `transfer`: values, labels, landmarks and textures carried along a map
- `model`: statistical shape models of meshes in correspondence
- `joint`: many shapes at once: maps that agree, and one topology for all
- `pieces`: shapes of several connected pieces, matched piece to piece
- `report`: pages to look at a map in a browser, and the confidence in words
- `testing`: strategies and laws for property tests
- `cli`: the command line
- `guide`: the guides of the manual, a page each
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jfsf.attempt import match_spectra
    from jfsf.initial import SearchSettings
    from jfsf.joint import Collection, CollectionSettings, collection
    from jfsf.matching import alternatives, basis, check_matchable, match, symmetry
    from jfsf.mesh import MeshError, check, read
    from jfsf.neighbours import NeighbourSettings
    from jfsf.parts import PartSettings
    from jfsf.pieces import MatchedComponents, match_components
    from jfsf.refine import ArapSettings, ZoomOutSettings
    from jfsf.registration import Registration, RegistrationSettings, register
    from jfsf.settings import EvidenceSettings, Settings
    from jfsf.spectral import FeatureSettings, spectrum
    from jfsf.types import Certificate, Maps, Match, Mesh, Spectrum

__all__ = [
    "ArapSettings",
    "Certificate",
    "Collection",
    "CollectionSettings",
    "EvidenceSettings",
    "FeatureSettings",
    "Maps",
    "Match",
    "MatchedComponents",
    "Mesh",
    "MeshError",
    "NeighbourSettings",
    "PartSettings",
    "Registration",
    "RegistrationSettings",
    "SearchSettings",
    "Settings",
    "Spectrum",
    "ZoomOutSettings",
    "alternatives",
    "basis",
    "check",
    "check_matchable",
    "collection",
    "match",
    "match_components",
    "match_spectra",
    "read",
    "register",
    "spectrum",
    "symmetry",
]
__version__ = "0.2.0"

# All is imported on first use. So `import jfsf` takes no time, and the command line can
# see to interrupts before it imports numpy and jax (`jfsf.__main__`).
_HOMES = {
    "attempt": ("match_spectra",),
    "initial": ("SearchSettings",),
    "joint": ("Collection", "CollectionSettings", "collection"),
    "matching": ("alternatives", "basis", "check_matchable", "match", "symmetry"),
    "mesh": ("MeshError", "check", "read"),
    "neighbours": ("NeighbourSettings",),
    "refine": ("ArapSettings", "ZoomOutSettings"),
    "registration": ("Registration", "RegistrationSettings", "register"),
    "parts": ("PartSettings",),
    "pieces": ("MatchedComponents", "match_components"),
    "settings": ("EvidenceSettings", "Settings"),
    "spectral": ("FeatureSettings", "spectrum"),
    "types": ("Certificate", "Maps", "Match", "Mesh", "Spectrum"),
}
_ROOMS = (
    *("array", "solvers", "storage", "runtime", "geometry", "convert", "evaluate"),
    *("evidence", "stages", "arguments", "coarse", "policy", "mapfiles"),
    *(
        "landmarks",
        "interop",
        "batch",
        "baselines",
        "data",
        "plot",
        "export",
        "transfer",
    ),
    *("model", "report", "testing"),
    *("cli", "guide"),
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

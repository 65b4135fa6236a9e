"""JAX Fast Sinkhorn Filters: maps between non-rigid 3D shapes.

New here? Begin with `jfsf/apps/guide/start.md`; `jfsf.apps.guide` lists all guides.

`match` computes maps from two meshes, and `Settings` changes any stage of it. The
folders are the parts of the method, in the order in which data passes through them. A
file imports only from those above its own, and no other from `apps`:

- `_moved`: names of before version 0.3.0, and what to use instead
- `_figures`: what each figure of a certificate means
- `_exported`: records that programs of `jax.export` take and return
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
- `learned`: where on a person a vertex lies, by a small trained network
- `matching`: two meshes to their maps: settings, attempts, evidence; parts
- `batch`: many pairs, over devices, hosts and clusters
- `data`: embedded shapes with ground truth
- `testing`: strategies and laws for property tests
- `apps`: what people do with maps: files, pictures, transfer, models, the command line
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from jfsf._moved import error_of, install

if TYPE_CHECKING:
    from jfsf import apps as apps
    from jfsf import array as array
    from jfsf import batch as batch
    from jfsf import convert as convert
    from jfsf import data as data
    from jfsf import evaluate as evaluate
    from jfsf import geometry as geometry
    from jfsf import initial as initial
    from jfsf import learned as learned
    from jfsf import matching as matching
    from jfsf import mesh as mesh
    from jfsf import neighbours as neighbours
    from jfsf import refine as refine
    from jfsf import runtime as runtime
    from jfsf import solvers as solvers
    from jfsf import spectral as spectral
    from jfsf import storage as storage
    from jfsf import testing as testing
    from jfsf import types as types
    from jfsf.apps import model as model
    from jfsf.apps.collections import collection
    from jfsf.apps.pieces import match_components
    from jfsf.apps.registration import Registration, RegistrationSettings, register
    from jfsf.initial import SearchSettings
    from jfsf.matching import (
        Settings,
        alternatives,
        basis,
        check_matchable,
        match,
        match_spectra,
        symmetry,
    )
    from jfsf.matching.parts import PartSettings
    from jfsf.mesh import MeshError, check, read
    from jfsf.neighbours import NeighbourSettings
    from jfsf.spectral import FeatureSettings, spectrum
    from jfsf.types import Certificate, Maps, Match, Mesh, Spectrum

__all__ = [
    "Certificate",
    "FeatureSettings",
    "Maps",
    "Match",
    "Mesh",
    "MeshError",
    "NeighbourSettings",
    "PartSettings",
    "Registration",
    "RegistrationSettings",
    "SearchSettings",
    "Settings",
    "Spectrum",
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
__version__ = "0.3.0"

# All is imported on first use. So `import jfsf` takes no time, and the command line can
# see to interrupts before it imports numpy and jax (`jfsf.__main__`).
_HOMES = {
    "apps.collections": ("collection",),
    "apps.pieces": ("match_components",),
    "apps.registration": ("Registration", "RegistrationSettings", "register"),
    "initial": ("SearchSettings",),
    "matching": (
        "Settings",
        "alternatives",
        "basis",
        "check_matchable",
        "match",
        "match_spectra",
        "symmetry",
    ),
    "matching.parts": ("PartSettings",),
    "mesh": ("MeshError", "check", "read"),
    "neighbours": ("NeighbourSettings",),
    "spectral": ("FeatureSettings", "spectrum"),
    "types": ("Certificate", "Maps", "Match", "Mesh", "Spectrum"),
}
_HOME = {name: f"jfsf.{room}" for room, names in _HOMES.items() for name in names}
_ROOMS = (
    "types array solvers storage runtime mesh geometry neighbours spectral convert "
    "evaluate refine initial learned matching batch data testing apps"
).split()


install()


def __getattr__(name: str) -> Any:
    if name in _ROOMS:
        return import_module(f"jfsf.{name}")
    if name == "model":
        return import_module("jfsf.apps.model")
    if name in _HOME:
        return globals().setdefault(name, getattr(import_module(_HOME[name]), name))
    if said := error_of(name):
        raise ImportError(said)
    raise AttributeError(f"module 'jfsf' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, *_ROOMS, "model"})

"""JAX Fast Sinkhorn Filters: maps between non-rigid 3D shapes.

`match` goes the whole way from two meshes; the modules are its parts, pure and jitted.
"""

from jfsf.match import match, symmetry
from jfsf.mesh import MeshError, check, read
from jfsf.pipeline import match_spectra
from jfsf.spectrum import spectrum
from jfsf.types import Certificate, Maps, Match, Mesh, Spectrum

__all__ = [
    "Certificate",
    "Maps",
    "Match",
    "Mesh",
    "MeshError",
    "Spectrum",
    "check",
    "match",
    "match_spectra",
    "read",
    "spectrum",
    "symmetry",
]
__version__ = "0.1.0"

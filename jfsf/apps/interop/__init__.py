"""To and from other packages: pyFM, MATLAB, torch, numpy, meshio, trimesh, ott-jax.

Names say which way: `to_pyfm` makes pyFM's objects, `from_pyfm` makes ours. Arguments
have the name that each side gives them, and maps come with the shapes that they run
between, so that a map in the wrong direction is an error where sizes differ.

| here | pyFM | MATLAB |
|---|---|---|
| X, Y | 2, 1 | 1, 2 |
| `T_xy`, 0-based | `p2p_21`, 0-based | `T12`, 1-based |
| `C_yx` (k_x, k_y) | `FM_12` (k_2, k_1) | `C21` (k_1, k_2) |

The same matrix only where bases are the same. Ours are those of a shape of area 1, and
the constant function is 1. A shape of area a has eigenvalues 1 / a times and
eigenvectors 1 / sqrt(a) times as large, and the sign of its constant is arbitrary;
`to_pyfm`, `to_matlab` and their inverses change a functional map accordingly.

The packages are imported when they are needed. The extra `interop` installs all but
torch, which people install to fit their machine.

Read in this order:

- `_packages`: import a package, or say how to install it
- `_bases`: eigenpairs of any area to a `Spectrum`, and functional maps with them
- `_pyfm`: pyFM's meshes and maps
- `_structs`: MATLAB's variables to the fields of a shape
- `_matlab`: the structs of the MATLAB codes for functional maps, in `.mat` files
- `_tensors`: records to torch tensors, numpy and jax arrays, without a copy
- `_trimesh`: trimesh's meshes
- `_meshio`: meshio's meshes
- `_ott`: the sparse kernel as ott-jax's geometry, and its potentials
"""

from jfsf.apps.interop._bases import Correspondence
from jfsf.apps.interop._matlab import (
    MatlabMaps,
    MatlabShape,
    from_matlab,
    read_matlab,
    to_matlab,
    write_matlab,
)
from jfsf.apps.interop._meshio import from_meshio, to_meshio
from jfsf.apps.interop._ott import Potentials, from_ott, potentials_to_ott, to_ott
from jfsf.apps.interop._pyfm import (
    PyfmMaps,
    from_pyfm,
    mesh_from_pyfm,
    mesh_to_pyfm,
    spectrum_from_pyfm,
    spectrum_to_pyfm,
    to_pyfm,
)
from jfsf.apps.interop._tensors import to_jax, to_numpy, to_torch
from jfsf.apps.interop._trimesh import from_trimesh, to_trimesh

__all__ = [
    "Correspondence",
    "MatlabMaps",
    "MatlabShape",
    "Potentials",
    "PyfmMaps",
    "from_matlab",
    "from_meshio",
    "from_ott",
    "from_pyfm",
    "from_trimesh",
    "mesh_from_pyfm",
    "mesh_to_pyfm",
    "potentials_to_ott",
    "read_matlab",
    "spectrum_from_pyfm",
    "spectrum_to_pyfm",
    "to_jax",
    "to_matlab",
    "to_meshio",
    "to_numpy",
    "to_ott",
    "to_pyfm",
    "to_torch",
    "to_trimesh",
    "write_matlab",
]

"""To and from other codes for functional maps: pyFM and those in MATLAB.

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

pyFM is imported when it is needed; the extra `interop` installs it. The guide
`jfsf/apps/guide/moving.md` shows the lines for trimesh, meshio, torch and ott-jax.

Read in this order:

- `_bases`: eigenpairs of any area to a `Spectrum`, and functional maps with them
- `_pyfm`: pyFM's meshes and maps
- `_matlab`: the structs of the MATLAB codes for functional maps, in `.mat` files
"""

from jfsf.apps.interop._matlab import (
    MatlabShape,
    from_matlab,
    read_matlab,
    to_matlab,
    write_matlab,
)
from jfsf.apps.interop._pyfm import (
    from_pyfm,
    spectrum_from_pyfm,
    spectrum_to_pyfm,
    to_pyfm,
)

__all__ = [
    "MatlabShape",
    "from_matlab",
    "from_pyfm",
    "read_matlab",
    "spectrum_from_pyfm",
    "spectrum_to_pyfm",
    "to_matlab",
    "to_pyfm",
    "write_matlab",
]

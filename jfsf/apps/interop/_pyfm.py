"""pyFM (the package `pyfmaps`): its meshes, point maps and functional maps.

pyFM numbers shapes, and its names run the other way: p2p_21 takes each vertex of shape
2 to one of shape 1, and FM_12 takes functions on 1 to functions on 2. So X is 2 and Y
is 1. To go on in pyFM with a map of ours:

```python
from pyFM.functional import FunctionalMapping

shape1, shape2 = spectrum_to_pyfm(spec_y), spectrum_to_pyfm(spec_x)
model = FunctionalMapping(shape1, shape2)
model.FM_12 = to_pyfm(mesh1=shape1, mesh2=shape2, C_yx=C_yx).FM_12
```
"""

from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from jfsf.apps.interop._bases import (
    Bases,
    Correspondence,
    at_unit_area,
    factors_of,
    zero_based_map,
)
from jfsf.spectral._laplacian import operators
from jfsf.types import ArrayLike, Mesh, Spectrum

# pyFM has no types of its own.
AnyTriMesh = Any


class PyfmMaps(NamedTuple):
    """A map in pyFM's terms; None for what was not given.

    p2p_21: (n_2,) int32, the vertex of shape 1 for each vertex of shape 2.
    FM_12: (k_2, k_1), functions on 1 to functions on 2, in the shapes' eigenvectors.
    """

    p2p_21: Any
    FM_12: Any


def to_pyfm(
    *,
    mesh1: AnyTriMesh,
    mesh2: AnyTriMesh,
    T_xy: ArrayLike | None = None,
    C_yx: ArrayLike | None = None,
) -> PyfmMaps:
    """A map from X to Y in pyFM's terms, with X = 2 and Y = 1.

    Args:
        mesh1: Y as pyFM's TriMesh, of any area; with eigenvectors if C_yx is given.
        mesh2: X as pyFM's TriMesh, of any area; with eigenvectors if C_yx is given.
        T_xy: (n_x,), the vertex of Y for each vertex of X.
        C_yx: (k_x, k_y), in the bases of `spectrum_from_pyfm` of the meshes.

    Raises:
        ValueError: a map does not fit the meshes, or they lack eigenvectors.
    """
    p2p_21 = FM_12 = None
    sizes = _sizes("to_pyfm", mesh2, mesh1)
    if T_xy is not None:
        p2p_21 = zero_based_map("to_pyfm: T_xy", T_xy, *sizes)
    if C_yx is not None:
        FM_12 = _bases("to_pyfm", mesh1, mesh2).to_other(C_yx)
    return PyfmMaps(p2p_21, FM_12)


def from_pyfm(
    *,
    mesh1: AnyTriMesh,
    mesh2: AnyTriMesh,
    p2p_21: ArrayLike | None = None,
    FM_12: ArrayLike | None = None,
) -> Correspondence:
    """Our map from X to Y of pyFM's from 2 to 1, with X = 2 and Y = 1.

    Args:
        mesh1, mesh2: as in `to_pyfm`.
        p2p_21: (n_2,), the vertex of shape 1 for each vertex of shape 2.
        FM_12: (k_2, k_1), in the meshes' own eigenvectors.

    Raises:
        ValueError: as `to_pyfm`.
    """
    T_xy = C_yx = None
    sizes = _sizes("from_pyfm", mesh2, mesh1)
    if p2p_21 is not None:
        T_xy = zero_based_map("from_pyfm: p2p_21", p2p_21, *sizes)
    if FM_12 is not None:
        C_yx = _bases("from_pyfm", mesh1, mesh2).from_other(FM_12)
    return Correspondence(T_xy, C_yx)


def spectrum_to_pyfm(spec: Spectrum) -> AnyTriMesh:
    """pyFM's TriMesh of area 1 with these eigenpairs, areas and positions.

    C_yx and FM_12 are then the same matrix. The stiffness is that of
    `spectral._laplacian.operators`, computed again from the positions.

    Raises:
        ImportError: pyfmaps is missing; the message says how to install it.
        ValueError: a padded spectrum.
    """
    try:
        from pyFM.mesh import TriMesh
    except ImportError as missing:
        raise ImportError(
            f"spectrum_to_pyfm needs pyfmaps ({missing}): pip install 'jfsf[interop]'"
        ) from missing
    evals, evecs, mass, faces, vertices = (np.asarray(a) for a in spec)
    if not (mass > 0).all():
        raise ValueError(
            f"spectrum_to_pyfm: {(mass <= 0).sum()} of {len(mass)} vertices are "
            "padding; cut them off"
        )
    vertices, mass = vertices.astype(np.float64), mass.astype(np.float64)
    mesh = TriMesh(vertices, faces if len(faces) else None)
    mesh.stiffness = operators(Mesh(vertices, faces))[0]
    mesh.mass = sp.dia_matrix((mass[None], [0]), (len(mass), len(mass)))
    mesh.eigenvalues, mesh.eigenvectors = evals, evecs
    return mesh


def spectrum_from_pyfm(mesh: AnyTriMesh) -> Spectrum:
    """The eigenpairs of pyFM's TriMesh, scaled to area 1; numpy arrays.

    The faces stay as they are wound; `match` wants them outward (`jfsf.mesh.orient`).

    Raises:
        ValueError: the mesh was not processed, its mass matrix is not diagonal, or it
            is in several pieces.
    """
    name = "spectrum_from_pyfm"
    mass = _lumped(name, mesh)
    faces = np.zeros((0, 3), np.int32) if mesh.faces is None else mesh.faces
    copy = Mesh(np.array(mesh.vertices, np.float64), np.array(faces, np.int32))
    return at_unit_area(name, copy, mesh.eigenvalues, mesh.eigenvectors, mass).spectrum


def _sizes(name, *meshes):
    for mesh in meshes:
        if not hasattr(mesh, "n_vertices"):
            raise ValueError(
                f"{name}: a mesh is {type(mesh).__name__}, expected pyFM's TriMesh; "
                "see spectrum_to_pyfm"
            )
    return [mesh.n_vertices for mesh in meshes]


def _bases(name, mesh1, mesh2):
    return Bases(
        *(factors_of(m.eigenvectors, _lumped(name, m).sum()) for m in (mesh2, mesh1))
    )


def _lumped(name, mesh):
    if mesh.eigenvectors is None or mesh.mass is None:
        raise ValueError(f"{name}: the mesh has no eigenvectors; call mesh.process(k)")
    mass, off = mesh.mass.diagonal(), sp.csr_matrix(mesh.mass)
    if off.count_nonzero() > np.count_nonzero(mass):
        raise ValueError(
            f"{name}: the mass matrix is not diagonal; compute the operators with "
            "lumped areas"
        )
    return mass

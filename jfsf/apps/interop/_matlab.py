"""The structs of the MATLAB codes for functional maps, in `.mat` files, and their maps.

A shape S has S.surface.X, .Y, .Z (n, 1) and .TRIV (m, 3), counted from 1, and once its
operators are computed S.W (stiffness), S.A (areas on the diagonal), S.evals, S.evecs,
S.area and S.sqrt_area, all in the shape's own unit. Their T12 takes each vertex of
shape 1 to one of shape 2, and C21 takes functions on 2 to functions on 1: X is 1 and Y
is 2. A T12 in a file of its own is for `jfsf.apps.mapfiles.read_map` and `write_map`.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from jfsf.apps.interop._bases import Bases, Correspondence, at_unit_area, zero_based_map
from jfsf.apps.mapfiles import MapFileError, read_mat, write_mat
from jfsf.mesh._values import check_values, checked_mesh
from jfsf.spectral._laplacian import operators
from jfsf.types import ArrayLike, Mesh, Spectrum

Fields = dict[str, Any]  # of a struct, by name
MOST_BYTES = 1 << 32  # of a variable: MATLAB writes no larger ones with -v7


def shape_fields(path: Path, variables: Fields, key: str | None) -> tuple[str, Fields]:
    """What messages call the shape of a file, and its fields by name.

    Args:
        path: the file.
        variables: what is in it.
        key: the struct to take; None takes the variables themselves, or the only struct
            that holds a surface.

    Raises:
        MapFileError: there is no such struct, or there are several.
    """
    structs = {name: s for name, s in variables.items() if isinstance(s, dict)}
    shapes = {n: s for n, s in structs.items() if {"surface", "TRIV"} & {*s}}
    if key is None:
        if "TRIV" in variables or "surface" in shapes:
            return str(path), variables
        if len(shapes) == 1:
            ((name, fields),) = shapes.items()
            return f"{path}[{name}]", fields
    elif key in shapes:
        return f"{path}[{key}]", shapes[key]
    wanted = "one surface" if key is None else f"a shape {key!r}"
    several = f"; pass one of {', '.join(sorted(shapes))} as `key`" if shapes else ""
    names = ", ".join(sorted(variables)) or "no variable"
    raise MapFileError(f"{path}: does not hold {wanted}, but {names}{several}")


def matrix(where: str, fields: Fields, name: str) -> np.ndarray:
    """A field as a matrix, float64.

    Raises:
        MapFileError: there is none, or it is no full matrix of real numbers.
    """
    value = _field(where, fields, name)
    if sp.issparse(value):
        raise MapFileError(f"{where}: {name} is sparse; save full({name})")
    return np.array(value, np.float64, order="C")


def diagonal(where: str, fields: Fields, name: str) -> np.ndarray:
    """A field that is a vector or a diagonal matrix, as a vector, float64.

    Raises:
        MapFileError: there is none, it does not hold real numbers, or it has some
            beside its diagonal.
    """
    value = _field(where, fields, name)
    if not sp.issparse(value) and 1 in value.shape:
        return matrix(where, fields, name).ravel()
    entries = value.diagonal()
    square = value.shape[0] == value.shape[1]
    if not square or abs(value - sp.diags_array(entries)).max() > 0:
        raise MapFileError(
            f"{where}: {name} {value.shape} is not diagonal; save a diagonal matrix "
            "or a full vector (lumped areas)"
        )
    return entries.astype(np.float64)


def _field(where, fields, name) -> Any:
    """A field that is a matrix of numbers, full or sparse."""
    if name not in fields:
        names = ", ".join(sorted(fields))
        raise MapFileError(f"{where}: lacks {name}; it holds {names}")
    value = fields[name]
    kind = getattr(getattr(value, "dtype", None), "kind", "O")
    if kind not in "fiu" or value.ndim != 2:
        raise MapFileError(f"{where}: {name} is no matrix of real numbers")
    return value


class MatlabShape(NamedTuple):
    """A shape of a MATLAB code.

    mesh: the mesh, in the file's unit; faces count vertices from 0.
    spectrum: the eigenpairs of the shape scaled to area 1; None if the file has none.
    factors: (k,), column j of the file's evecs is factors[j] times column j of
        `spectrum.evecs`; None if the file has no eigenpairs.
    """

    mesh: Mesh
    spectrum: Spectrum | None
    factors: Float[np.ndarray, " k"] | None


class MatlabMaps(NamedTuple):
    """A map in the terms of the MATLAB codes; None for what was not given.

    T12: (n_1, 1) float64, the vertex of shape 2 for each vertex of shape 1, from 1.
    C21: (k_1, k_2), functions on 2 to functions on 1, in the shapes' own evecs.
    """

    T12: Any
    C21: Any


def read_matlab(path: str | Path, *, key: str | None = None) -> MatlabShape:
    """Read a shape from a `.mat` file, saved with -v7 or older.

    Args:
        path: the file holds `surface`, `evecs` and so on as variables, or in a struct.
            TRIV with X, Y and Z, or with VERT (n, 3), may stand in the struct itself.
        key: the struct's name; None takes the variables, or the only such struct.

    Returns:
        numpy arrays. evals and A, which must be there if evecs is, may be diagonal
        matrices or vectors. W, area and sqrt_area are not read: they follow.

    Raises:
        MapFileError: no such file, damaged, without such a struct, or of other fields.
        ValueError: values that are no mesh (`MeshError`), or no eigenpairs of it.
    """
    path = Path(path)
    variables = {name: read() for name, read in read_mat(path, MOST_BYTES).items()}
    where, fields = shape_fields(path, variables, key)
    surface = fields.get("surface")
    surface = surface if isinstance(surface, dict) and surface else fields
    if "VERT" in surface:
        vertices = matrix(where, surface, "VERT")
    else:
        axes = [matrix(where, surface, axis).ravel() for axis in "XYZ"]
        if len({len(axis) for axis in axes}) > 1:
            sizes = ", ".join(str(len(axis)) for axis in axes)
            raise MapFileError(f"{where}: X, Y, Z have {sizes} entries; save it again")
        vertices = np.stack(axes, 1)
    faces = matrix(where, surface, "TRIV")
    whole = (faces == np.floor(faces)) & (faces <= len(vertices))
    if faces.min(initial=1) < 1 or not whole.all():
        raise MapFileError(
            f"{where}: TRIV runs from {faces.min():g} to {faces.max():g}; it must hold "
            f"whole numbers from 1 to {len(vertices)}, the number of vertices"
        )
    faces = faces.astype(np.int32) - np.int32(1)
    mesh = Mesh(vertices, faces if faces.size else faces.reshape(0, 3))
    check_values(*mesh, where)

    if "evecs" not in fields:
        return MatlabShape(mesh, None, None)
    evals, mass = (diagonal(where, fields, name) for name in ("evals", "A"))
    evecs = matrix(where, fields, "evecs")
    return MatlabShape(mesh, *at_unit_area(where, mesh, evals, evecs, mass))


def write_matlab(
    path: str | Path,
    mesh: Mesh,
    spectrum: Spectrum | None = None,
    *,
    key: str | None = None,
) -> None:
    """Write a shape as a `.mat` file; it appears complete or not at all.

    `S1 = load(path)` in MATLAB gives the struct. It holds surface (X, Y, Z, VERT and
    TRIV), nv and nf, and with a spectrum W, A, evals, evecs, area and sqrt_area, in the
    unit of the mesh.

    Args:
        path: ends in `.mat`.
        mesh: in any unit of length.
        spectrum: eigenpairs of this mesh, in its order of vertices. Of a noisy mesh
            `jfsf.basis` gives that of `jfsf.mesh.denoised(mesh)`, which is to be passed
            then.
        key: the name of a struct to put all of this in; None writes variables.

    Raises:
        MapFileError: another suffix, or a folder that cannot be written.
        MeshError: no mesh.
        ValueError: the spectrum is another mesh's, or padded.
    """
    path = Path(path)
    if path.suffix.lower() != ".mat":
        raise MapFileError(f"{path}: is written as .mat; give it that suffix")
    vertices, faces = checked_mesh(mesh, "write_matlab")
    vertices = vertices.astype(np.float64)
    x, y, z = vertices.T[:, :, None]
    # MATLAB computes with doubles only.
    triangles = faces + 1.0
    surface = {"X": x, "Y": y, "Z": z, "VERT": vertices, "TRIV": triangles}
    fields = {"surface": surface, "nv": float(len(x)), "nf": float(len(faces))}
    if spectrum is not None:
        fields |= _in_own_unit(Mesh(vertices, faces), spectrum)
    write_mat(path, fields if key is None else {key: fields})


def to_matlab(
    *,
    shape_x: MatlabShape,
    shape_y: MatlabShape,
    T_xy: ArrayLike | None = None,
    C_yx: ArrayLike | None = None,
) -> MatlabMaps:
    """A map from X to Y in MATLAB's terms, with X = 1 and Y = 2.

    Args:
        shape_x, shape_y: as `read_matlab` gives them.
        T_xy: (n_x,), the vertex of Y for each vertex of X, from 0.
        C_yx: (k_x, k_y), in the bases of the shapes' spectra.

    Raises:
        ValueError: a map does not fit the shapes, or they have no eigenvectors.
    """
    T12 = C21 = None
    if T_xy is not None:
        sizes = len(shape_x.mesh.vertices), len(shape_y.mesh.vertices)
        T12 = zero_based_map("to_matlab: T_xy", T_xy, *sizes)[:, None] + 1.0
    if C_yx is not None:
        C21 = _bases("to_matlab", shape_x, shape_y).to_other(C_yx)
    return MatlabMaps(T12, C21)


def from_matlab(
    *,
    shape_x: MatlabShape,
    shape_y: MatlabShape,
    T12: ArrayLike | None = None,
    C21: ArrayLike | None = None,
) -> Correspondence:
    """Our map from X to Y of MATLAB's from 1 to 2, with X = 1 and Y = 2.

    Args:
        shape_x, shape_y: as `read_matlab` gives them.
        T12: (n_1,), (n_1, 1) or (1, n_1), the vertex of shape 2 for each of 1, from 1.
        C21: (k_1, k_2), in the shapes' own evecs.

    Raises:
        ValueError: as `to_matlab`.
    """
    T_xy = C_yx = None
    if T12 is not None:
        sizes = len(shape_x.mesh.vertices), len(shape_y.mesh.vertices)
        T_xy = zero_based_map("from_matlab: T12", T12, *sizes, base=1)
    if C21 is not None:
        C_yx = _bases("from_matlab", shape_x, shape_y).from_other(C21)
    return Correspondence(T_xy, C_yx)


def _bases(name, shape_x, shape_y):
    if shape_x.factors is None or shape_y.factors is None:
        raise ValueError(f"{name}: a shape has no eigenvectors; save evecs with it")
    return Bases(shape_x.factors, shape_y.factors)


def _in_own_unit(mesh, spectrum):
    evals, evecs, mass, _, unit_points = (np.asarray(a, float) for a in spectrum)
    n = len(mesh.vertices)
    if len(evecs) != n or not (mass > 0).all():
        raise ValueError(
            f"write_matlab: the mesh has {n} vertices, the spectrum has {len(evecs)}, "
            f"{(mass <= 0).sum()} of them padding; pass the spectrum of this mesh"
        )
    # The area that the spectrum was scaled from is not in it, but the unit is.
    points, unit = (p - p.mean(0) for p in (mesh.vertices, unit_points))
    length = np.linalg.norm(points) / np.linalg.norm(unit)
    if np.abs(points - length * unit).max() > 1e-4 * np.abs(points).max():
        raise ValueError(
            "write_matlab: the spectrum's vertices are not those of the mesh; pass the "
            "spectrum of this mesh, in its order. Of a noisy mesh `jfsf.basis` is that "
            "of jfsf.mesh.denoised(mesh): pass this as the mesh"
        )
    area = length**2
    return {
        "W": sp.csc_matrix(operators(mesh)[0]),
        "A": sp.csc_matrix(sp.diags(area * mass)),
        "evals": (evals / area)[:, None],
        "evecs": evecs / length,
        "area": area,
        "sqrt_area": length,
    }

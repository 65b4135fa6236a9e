"""Files that other libraries read -> Mesh: VTK (.vtk, .vtp) and GIFTI (.gii).

They come from medical imaging and ParaView, in many versions and encodings. The
libraries are not installed with this package: see `LIBRARIES`.
"""

import re
from importlib.util import find_spec
from typing import Any

import numpy as np

from jfsf.mesh._polygons import triangulate
from jfsf.mesh._values import MeshError
from jfsf.types import ArrayLike, Mesh

# The module that reads a format, and the extra of this package that installs it.
LIBRARIES = {
    ".vtk": ("vtkmodules", "vtk"),
    ".vtp": ("vtkmodules", "vtk"),
    ".gii": ("nibabel", "gifti"),
}
# Of VTK: cells that are surfaces, and those that are less and are left out.
_STRIP, _PIXEL = 6, 8
_SURFACES = {5: "triangle", 6: "strip", 7: "polygon", 8: "pixel", 9: "quad"}
_LESS = (0, 1, 2, 3, 4)


def parse_vtk(data: bytes, suffix: str) -> Mesh:
    """Read the surface of a VTK file: polygons and triangle strips of a PolyData.

    Of an unstructured grid in a .vtk file its triangles, quads, polygons, pixels and
    strips. Points and lines are left out; without polygons it is a cloud.

    Args:
        data: contents of the file.
        suffix: ".vtk" or ".vtp".

    Raises:
        MeshError: VTK is not installed or refuses the file, or it holds volumes or
            something else than a surface.
    """
    _need(suffix)
    found = _vtk_output(data, suffix)
    if (kind := found.GetClassName()) == "vtkPolyData":
        sizes, corners = _cells(found.GetPolys())
        strips = _cells(found.GetStrips())
        kinds = np.repeat([7, _STRIP], [len(sizes), len(strips[0])])
        sizes = np.concatenate([sizes, strips[0]])
        corners = np.concatenate([corners, strips[1]])
    elif kind == "vtkUnstructuredGrid":
        sizes, corners = _cells(found.GetCells())
        kinds = _array(found.GetCellTypesArray(), np.int64) if len(sizes) else sizes
    else:
        raise MeshError(
            f"it holds a {kind.removeprefix('vtk')}",
            "export a surface (PolyData), in ParaView with Extract Surface",
        )
    points = np.zeros((0, 3))
    if found.GetNumberOfPoints():
        points = _array(found.GetPoints().GetData(), np.float64)
    return Mesh(points, _triangles(points, kinds, sizes, corners))


def _vtk_output(data: bytes, suffix: str) -> Any:
    """The data set of a VTK file, or MeshError with what VTK says of it."""
    from vtkmodules.vtkCommonCore import (
        vtkLogger,
        vtkOutputWindow,
        vtkStringOutputWindow,
    )

    if suffix == ".vtk":
        from vtkmodules.vtkIOLegacy import vtkDataSetReader as Reader
    else:
        from vtkmodules.vtkIOXML import vtkXMLPolyDataReader as Reader
    # VTK raises no exceptions: it writes to its window, and by its log to the terminal.
    window, usual = vtkStringOutputWindow(), vtkOutputWindow.GetInstance()
    verbosity = vtkLogger.GetCurrentVerbosityCutoff()
    vtkOutputWindow.SetInstance(window)
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        reader = Reader()
        reader.ReadFromInputStringOn()
        reader.SetInputArray(_held(data))
        reader.Update()
        found = reader.GetOutput()
        said = " ".join((window.GetOutput() or "").split())
    finally:
        vtkLogger.SetStderrVerbosity(verbosity)
        vtkOutputWindow.SetInstance(usual)
    if said or found is None:
        # The first of its messages, without the place in VTK's own code.
        said = re.split(r" ERROR:| Warning:", said.split("): ", 1)[-1])[0]
        said = said.removesuffix("for file:").strip(" !.") or "no data set"
        raise MeshError(f"VTK cannot read it ({said[:120]})", "export it again")
    return found


def _held(data: bytes) -> Any:
    """Bytes as an array of VTK; a string would end at the first byte 0."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkCharArray

    held = vtkCharArray()
    held.SetNumberOfValues(len(data))
    vtk_to_numpy(held)[:] = np.frombuffer(data, np.int8)
    return held


def _array(values: Any, dtype: Any) -> Any:
    """A copy of an array of VTK."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    return np.array(vtk_to_numpy(values), dtype)


def _cells(cells: Any) -> tuple[ArrayLike, ArrayLike]:
    """The sizes of cells, and their vertices, one cell after the other."""
    if cells is None or not cells.GetNumberOfCells():
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    corners = _array(cells.GetConnectivityArray(), np.int64)
    offsets = _array(cells.GetOffsetsArray(), np.int64)
    if offsets[0] or offsets[-1] != len(corners) or (np.diff(offsets) < 0).any():
        raise MeshError("its cells do not fit their numbers", "export it again")
    return np.diff(offsets), corners


def _triangles(points, kinds, sizes, corners):
    """Of surface cells, in their order."""
    others = set(np.unique(kinds).tolist()) - {*_SURFACES, *_LESS}
    if others:
        numbers = ", ".join(map(str, sorted(others)))
        raise MeshError(
            f"it holds cells that are no flat polygons (VTK's types {numbers}), as "
            "volumes do",
            "extract the surface, in ParaView with Extract Surface",
        )
    kept = np.isin(kinds, list(_SURFACES))
    corners = corners[np.repeat(kept, sizes)]
    kinds, sizes = kinds[kept], sizes[kept]
    starts = np.cumsum(sizes) - sizes
    for start in starts[kinds == _PIXEL].tolist():
        corners[start + 2 : start + 4] = corners[start + 2 : start + 4][::-1]
    if not (kinds == _STRIP).any():
        return triangulate(sizes, corners, points)
    faces = []
    for kind, start, size in zip(kinds, starts, sizes, strict=True):
        own = corners[start : start + size]
        if kind == _STRIP:
            rows = np.stack([own[:-2], own[1:-1], own[2:]], axis=1)
            rows[1::2] = rows[1::2, ::-1]  # every other one is wound the other way
        else:
            rows = triangulate([size], own, points)
        faces.append(rows)
    return np.concatenate([np.zeros((0, 3), np.int64), *faces])


def parse_gifti(data: bytes) -> Mesh:
    """Read the points and triangles of a GIFTI surface, without its transforms.

    Raises:
        MeshError: nibabel is not installed, or the file has no points, as one of values
            on a surface.
    """
    _need(".gii")
    from nibabel.gifti.gifti import GiftiImage

    image = GiftiImage.from_bytes(data)
    points, faces = (
        [np.asarray(array.data) for array in image.get_arrays_from_intent(intent)]
        for intent in ("NIFTI_INTENT_POINTSET", "NIFTI_INTENT_TRIANGLE")
    )
    if len(points) != 1 or len(faces) > 1:
        raise MeshError(
            f"it has {len(points)} arrays of points and {len(faces)} of triangles",
            "give the file of one surface, such as .surf.gii",
        )
    (vertices,), found = points, faces[0] if faces else np.zeros((0, 3), np.int64)
    if vertices.ndim != 2 or vertices.shape[1] != 3 or found.shape[1:] != (3,):
        raise MeshError(
            f"its points are {vertices.shape} and its triangles {found.shape}, not "
            "(n, 3)",
            "export it again",
        )
    triangles = triangulate([3] * len(found), found.ravel())
    return Mesh(vertices.astype(np.float64), triangles)


def _need(suffix: str) -> None:
    module, extra = LIBRARIES[suffix]
    if find_spec(module) is None:
        raise MeshError(
            f"reading {suffix} takes a library that is not installed: pip install "
            f"'jfsf[{extra}]', or convert it to .ply"
        )

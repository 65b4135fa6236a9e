"""The data set of a VTK file, read by the library VTK, as arrays: a process of its own.

VTK ends the process that it runs in on some damaged files, and writes its errors to the
terminal. So `jfsf.mesh._others` runs this file as a script: the file's contents on
stdin, the name of the reader as its argument, and the arrays as .npz on stdout. It
imports nothing of this package.
"""

import io
import sys
from typing import Any

import numpy as np

# Memory of the process: a damaged count would ask for any.
BYTES, BYTES_FOR_EACH = 1 << 30, 50


def arrays_of(data: bytes, suffix: str) -> dict[str, Any]:
    """The points (n, 3) and the cells of a data set.

    Args:
        data: contents of the file.
        suffix: ".vtk" or ".vtp".

    Returns:
        kind: the class of the data set; points; and of each kind of cells that it has
        (polys, strips, cells) the vertices in one array, and the number of those before
        each cell, and at the end all, as `..._offsets`. types: VTK's number of the type
        of each cell, for grids. said: what VTK said, "" if nothing.
    """
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonCore import (
        vtkCharArray,
        vtkOutputWindow,
        vtkStringOutputWindow,
    )

    window = vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(window)
    if suffix == ".vtk":
        from vtkmodules.vtkIOLegacy import vtkDataSetReader as Reader
    else:
        from vtkmodules.vtkIOXML import vtkXMLPolyDataReader as Reader
    held = vtkCharArray()
    held.SetNumberOfValues(len(data))
    vtk_to_numpy(held)[:] = np.frombuffer(data, np.int8)
    reader = Reader()
    reader.ReadFromInputStringOn()
    reader.SetInputArray(held)
    reader.Update()
    said = window.GetOutput() or ""
    found = reader.GetOutput()
    if said or found is None:
        return {"kind": "", "said": said or "no data set"}
    arrays: dict[str, Any] = {"kind": found.GetClassName(), "said": ""}
    if arrays["kind"] not in ("vtkPolyData", "vtkUnstructuredGrid"):
        return arrays
    points = found.GetPoints()
    if points is not None and points.GetNumberOfPoints():
        arrays["points"] = vtk_to_numpy(points.GetData())
    if arrays["kind"] == "vtkPolyData":
        groups = {"polys": found.GetPolys(), "strips": found.GetStrips()}
    else:
        groups = {"cells": found.GetCells()}
        if found.GetNumberOfCells():
            arrays["types"] = vtk_to_numpy(found.GetCellTypesArray())
    for name, group in groups.items():
        if group is not None and group.GetNumberOfCells():
            arrays[name] = vtk_to_numpy(group.GetConnectivityArray())
            arrays[f"{name}_offsets"] = vtk_to_numpy(group.GetOffsetsArray())
    return arrays


def main() -> None:
    """stdin -> stdout."""
    data = sys.stdin.buffer.read()
    _limit(BYTES + BYTES_FOR_EACH * len(data))
    arrays = arrays_of(data, sys.argv[1])
    np.savez(held := io.BytesIO(), **arrays)
    sys.stdout.buffer.write(held.getvalue())


def _limit(size: int) -> None:
    try:
        import resource
    except ImportError:  # not on Windows
        return
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    if hard != resource.RLIM_INFINITY:
        size = min(size, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (size, size))


if __name__ == "__main__":
    main()

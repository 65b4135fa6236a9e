"""Formats for situations.py, as the programs write them that the files come from.

Written by hand, not by the package: these are to be other people's files.
"""

import bz2
import gzip
import json
import lzma
from pathlib import Path

import numpy as np
from situation_files import NAMES, Contents, darts, landmark_vertices

from jfsf.types import Mesh

PACKERS = {".gz": gzip.compress, ".bz2": bz2.compress, ".xz": lzma.compress}


def write_darts(path: Path, own: Mesh) -> None:
    """`darts` as OFF, OBJ or PLY, each polygon with vertices of its own joined."""
    polygons = darts(own)
    number: dict[tuple, int] = {}
    rows = [[number.setdefault(tuple(p), len(number)) for p in q] for q in polygons]
    points = [" ".join(map(repr, p)) for p in number]
    if path.suffix == ".obj":
        lines = [f"v {p}" for p in points]
        lines += [f"f {' '.join(str(i + 1) for i in row)}" for row in rows]
    else:
        lines = ["OFF", f"{len(points)} {len(rows)} 0"]
        if path.suffix == ".ply":
            lines = _ply_header(len(points), len(rows))
        lines += [*points, *(f"{len(r)} {' '.join(map(str, r))}" for r in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write(path: Path, mesh: Mesh, *, kind: str = "f8") -> None:
    """A mesh in the format of the suffix; all values as they are, or as floats of kind.

    Packed if the suffix says so.
    """
    points = mesh.vertices.astype(kind)
    suffixes = path.suffixes
    pack = PACKERS.get(suffixes[-1], lambda text: text)
    if suffixes[0] == ".npy":
        np.save(path, points)
        return
    writers = {".off": off, ".xyz": xyz, ".ply": ply, ".obj": obj, ".vtk": vtk}
    writers |= {".vtp": vtp, ".gii": gii}
    text = writers[suffixes[0]](points.tolist(), mesh.faces.tolist())
    path.write_bytes(pack(text.encode()))


def _lines(rows) -> str:
    return "".join(" ".join(map(repr, row)) + "\n" for row in rows)


def off(points, faces, colours=None) -> str:
    """OFF, or COFF with colours of 0 to 255."""
    head = f"OFF\n{len(points)} {len(faces)} 0\n"
    if colours is not None:
        head = "C" + head
        points = [p + [*c, 255] for p, c in zip(points, colours, strict=True)]
    return head + _lines(points) + _lines([3, *face] for face in faces)


def xyz(points, faces) -> str:
    """Text, a point a line; there are no faces."""
    return _lines(points)


def obj(points, faces, uv=()) -> str:
    """OBJ, with a texture coordinate for each vertex or without."""
    corner = "{0}/{0}" if uv else "{0}"
    return (
        "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in points)
        + "".join(f"vt {u!r} {v!r}\n" for u, v in uv)
        + _lines_of_faces(faces, corner)
    )


def _lines_of_faces(faces, corner: str) -> str:
    rows = [" ".join(corner.format(i + 1) for i in face) for face in faces]
    return "".join(f"f {row}\n" for row in rows)


def _ply_header(vertices: int, faces: int, colours: bool = False) -> list[str]:
    channels = [f"property uchar {name}" for name in ("red", "green", "blue")]
    return [
        *("ply", "format ascii 1.0", f"element vertex {vertices}"),
        *(f"property double {axis}" for axis in "xyz"),
        *(channels if colours else []),
        f"element face {faces}",
        *("property list uchar int vertex_indices", "end_header"),
    ]


def ply(points, faces, vertex_end="", face_end="", colours=None) -> str:
    """ASCII PLY; each line may end in values that the header does not name."""
    if colours is not None:
        points = [p + list(c) for p, c in zip(points, colours, strict=True)]
    head = _ply_header(len(points), len(faces), colours is not None)
    rows = _lines(points).replace("\n", vertex_end + "\n")
    corners = _lines([3, *face] for face in faces).replace("\n", face_end + "\n")
    return "\n".join(head) + "\n" + rows + corners


def vtk(points, faces) -> str:
    """Legacy VTK, as 3D Slicer saves a model."""
    head = "# vtk DataFile Version 3.0\nmodel\nASCII\nDATASET POLYDATA\n"
    polygons = f"POLYGONS {len(faces)} {4 * len(faces)}\n"
    corners = _lines([3, *face] for face in faces)
    return f"{head}POINTS {len(points)} double\n{_lines(points)}{polygons}{corners}"


def vtp(points, faces) -> str:
    """VTK's XML, as ParaView saves it as text."""
    array = '<DataArray type="{}" Name="{}" NumberOfComponents="{}" format="ascii">'
    ends = " ".join(str(3 * (i + 1)) for i in range(len(faces)))
    return (
        '<VTKFile type="PolyData" version="0.1" byte_order="LittleEndian"><PolyData>'
        f'<Piece NumberOfPoints="{len(points)}" NumberOfPolys="{len(faces)}"><Points>'
        f"{array.format('Float64', 'Points', 3)}{_lines(points)}</DataArray></Points>"
        f"<Polys>{array.format('Int32', 'connectivity', 1)}{_lines(faces)}</DataArray>"
        f"{array.format('Int32', 'offsets', 1)}{ends}</DataArray></Polys></Piece>"
        "</PolyData></VTKFile>"
    )


def gii(points, faces) -> str:
    """GIFTI, as FreeSurfer's mris_convert writes a cortex as text."""
    arrays = ""
    for intent, kind, rows in (
        ("POINTSET", "FLOAT32", points),
        ("TRIANGLE", "INT32", faces),
    ):
        arrays += (
            f'<DataArray Intent="NIFTI_INTENT_{intent}" DataType="NIFTI_TYPE_{kind}" '
            f'ArrayIndexingOrder="RowMajorOrder" Dimensionality="2" '
            f'Dim0="{len(rows)}" Dim1="3" Encoding="ASCII" Endian="LittleEndian" '
            f'ExternalFileName="" ExternalFileOffset=""><Data>{_lines(rows)}</Data>'
            "</DataArray>"
        )
    head = '<?xml version="1.0" encoding="UTF-8"?>\n'
    return f'{head}<GIFTI Version="1.0" NumberOfDataArrays="2">{arrays}</GIFTI>'


def write_landmarks(path: Path, own: Contents) -> None:
    """The body's landmarks as 3D Slicer, MeshLab or a spreadsheet saves them."""
    points = own.body.mesh.vertices[landmark_vertices(own)]
    named = list(zip(NAMES, points.tolist(), strict=True))
    if path.name.endswith(".mrk.json"):
        controls = [
            {"id": str(i), "label": name, "position": p, "positionStatus": "defined"}
            for i, (name, p) in enumerate(named)
        ]
        markup = {"type": "Fiducial", "coordinateSystem": "LPS"}
        text = json.dumps({"markups": [markup | {"controlPoints": controls}]})
    elif path.suffix == ".fcsv":
        columns = "id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID"
        head = "# Markups fiducial file version = 4.10\n# CoordinateSystem = 0\n"
        # RAS has x and y the other way.
        rows = [
            f"node_{i},{-x!r},{-y!r},{z!r},0,0,0,1,1,1,0,{name},,\n"
            for i, (name, (x, y, z)) in enumerate(named)
        ]
        text = f"{head}# columns = {columns}\n" + "".join(rows)
    elif path.suffix == ".pp":
        rows = [
            f' <point active="1" name="{name}" x="{x!r}" y="{y!r}" z="{z!r}"/>\n'
            for name, (x, y, z) in named
        ]
        text = (
            f"<!DOCTYPE PickedPoints>\n<PickedPoints>\n{''.join(rows)}</PickedPoints>"
        )
    else:
        # Backwards: they are paired by name.
        rows = [f"{name};{x!r};{y!r};{z!r}\n" for name, (x, y, z) in named[::-1]]
        text = "name;x;y;z\n" + "".join(rows)
    path.write_text(text, encoding="utf-8")

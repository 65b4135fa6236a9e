"""path -> Mesh: read a mesh file of any known format, compressed or not."""

import os
import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jfsf.mesh._formats import parse_npy, parse_obj, parse_off, parse_stl, parse_xyz
from jfsf.mesh._gltf import parse_gltf
from jfsf.mesh._others import LIBRARIES, parse_gifti, parse_vtk
from jfsf.mesh._ply import parse_ply
from jfsf.mesh._values import MeshError, check_values
from jfsf.storage._text import in_utf8, instead_of_data
from jfsf.types import Mesh

_PARSERS = {
    ".off": parse_off,
    ".obj": parse_obj,
    ".stl": parse_stl,
    ".xyz": parse_xyz,
    ".npy": parse_npy,
    ".gii": parse_gifti,
}
_SCENES = (".glb", ".gltf")
# Formats of text, some of them binary too; XML says its encoding itself.
_TEXTS = (".off", ".obj", ".ply", ".stl", ".xyz", ".vtk", ".gltf")
CLOUDS = (".xyz", ".npy")  # formats without faces
# Of files that can be read, without and with compression.
SUFFIXES = (".off", ".obj", ".ply", ".stl", *_SCENES, *LIBRARIES, *CLOUDS)
COMPRESSED = (".gz", ".bz2", ".xz")


class Reading(NamedTuple):
    """What `read_noted` finds.

    mesh: the mesh of the file.
    notes: a sentence for each thing that the format does not allow and that was
        skipped.
    """

    mesh: Mesh
    notes: tuple[str, ...]


def read(path: str | os.PathLike[str], *, finite: bool = True) -> Mesh:
    """Read a mesh file or a point cloud; vertex i stays vertex i.

    OFF, OBJ, PLY, STL, GLB and glTF; VTK (.vtk, .vtp) and GIFTI (.gii) with the
    libraries of `jfsf[vtk]` and `jfsf[gifti]`; text with a point a line (.xyz) and
    arrays of numpy (.npy); and all of them compressed (.gz, .bz2, .xz), as scan.ply.gz.
    Polygons become triangles in their place, see `triangulate`; colours, normals and
    the like are dropped. STL has no vertex numbers, so exactly equal points become one
    vertex there. Each note of `read_noted` becomes a UserWarning. Text is UTF-8, or
    UTF-16 with a byte order mark.

    Args:
        path: the suffix says the format. A file without faces is a point cloud.
        finite: False lets vertices pass whose coordinates are not finite: see `repair`.

    Returns:
        The mesh, as the file winds it: see `orient`, and `validate` before matching.

    Raises:
        MeshError: no such file; an unknown format; a broken or truncated file, or a
            stand-in (a pointer of Git LFS, a web page); a library that is not
            installed; a face with fewer than three vertices or with one out of range;
            no vertices, or some that are not finite.
    """
    found = read_noted(path, finite=finite)
    for note in found.notes:
        warnings.warn(f"{path}: {note}", UserWarning, stacklevel=2)
    return found.mesh


def read_noted(path: str | os.PathLike[str], *, finite: bool = True) -> Reading:
    """Read a mesh as `read` does, with notes on what was skipped instead of warnings.

    Args:
        path: the file; its suffix gives the format.
        finite: False lets vertices pass whose coordinates are not finite.

    Raises:
        MeshError: as `read`.
    """
    path = Path(path)
    suffix, _ = _format(path)
    if not path.is_file():
        what = "is a folder" if path.is_dir() else "does not exist"
        raise MeshError(what, "pass the path of a mesh file", str(path))
    if suffix not in SUFFIXES:
        known = ", ".join(SUFFIXES)
        packings = ", ".join(COMPRESSED)
        raise MeshError(
            f"has format {suffix!r}",
            f"convert it to one of {known} (also with {packings})",
            str(path),
        )
    try:
        data = contents(path)
        if not data.strip():
            raise MeshError(f"its {len(data)} bytes are empty", "export the mesh again")
        # numpy warns of nan and overflow where `check_values` says which vertex it is.
        with np.errstate(all="ignore"), warnings.catch_warnings():
            # Libraries warn of what is damaged, and then it is refused or sound.
            warnings.simplefilter("ignore")
            mesh, notes = _parsed(data, suffix, path)
    except MeshError as error:
        raise error.named(str(path)) from error
    except Exception as error:
        # Broken numbers, and whatever other libraries meet in a broken file.
        raise MeshError(
            f"not a readable {suffix[1:].upper()} file ({error})",
            "export the mesh again",
            str(path),
        ) from error
    check_values(*mesh, str(path), finite=finite)
    return Reading(Mesh(mesh.vertices, mesh.faces.astype(np.int32)), notes)


def contents(path: Path) -> bytes:
    """The bytes of a mesh file, without its compression; text in UTF-8 without a mark.

    Raises:
        OSError: it cannot be read.
        MeshError: it cannot be decompressed, or another thing stands in its place.
    """
    data, (suffix, packed) = path.read_bytes(), _format(path)
    _check_is_data(data)
    if packed and data.strip():
        data = _unpacked(data, packed)
        _check_is_data(data)
    return in_utf8(data) if suffix in _TEXTS else data


def format_of(path: str | os.PathLike[str]) -> str:
    """The suffix of a mesh file that `read` knows, without that of a compression.

    Returns:
        One of `SUFFIXES`, or "" for any other file.
    """
    suffix = _format(Path(path))[0]
    return suffix if suffix in SUFFIXES else ""


def stem_of(path: str | os.PathLike[str]) -> str:
    """The name of a mesh file without its suffix and that of a compression."""
    path = Path(path)
    return Path(path.stem).stem if format_of(path) and _format(path)[1] else path.stem


def _format(path: Path) -> tuple[str, str]:
    """The suffixes of the format and of the compression, "" without any."""
    last = path.suffix.lower()
    if last in COMPRESSED:
        return Path(path.stem).suffix.lower(), last
    return last, ""


def _check_is_data(data: bytes) -> None:
    if found := instead_of_data(data):
        raise MeshError(*found)


def _unpacked(data: bytes, packed: str) -> bytes:
    try:
        # A Python may be built without some of them.
        if packed == ".gz":
            from gzip import decompress
        elif packed == ".bz2":
            from bz2 import decompress
        else:
            from lzma import decompress
        found = decompress(data)
    except Exception as error:
        why = str(error) or type(error).__name__
        raise MeshError(f"it cannot be decompressed ({why})", "pack it again") from None
    if not found.strip():
        raise MeshError("what is packed in it is empty", "pack the mesh again")
    return found


def _parsed(data: bytes, suffix: str, path: Path) -> tuple[Mesh, tuple[str, ...]]:
    if suffix == ".ply":
        return parse_ply(data)
    if suffix in _SCENES:
        return parse_gltf(data, path.parent, suffix), ()
    if suffix in (".vtk", ".vtp"):
        return parse_vtk(data, suffix), ()
    return _PARSERS[suffix](data), ()

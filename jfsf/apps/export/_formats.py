"""A painted mesh -> PLY, OBJ with its material and texture, or GLB (binary glTF 2.0).

trimesh writes GLB too, but its vertex colours are sRGB where glTF wants them linear,
and it needs Pillow for a texture.
"""

import io
import json
import re
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from jfsf.mesh._geometry import vertex_normals
from jfsf.mesh._values import checked_mesh
from jfsf.storage._atomic import utf8
from jfsf.types import ArrayLike, Mesh

NAME = re.compile("[a-z][a-z_]*")
# Those of a vertex that mean something else.
TAKEN = set("x y z nx ny nz xyz red green blue alpha rgb".split())
_FLOAT, _UINT = 5126, 5125  # component types of glTF
_VERTICES, _INDICES = 34962, 34963  # what a part of the buffer is for
_POINTS, _TRIANGLES = 0, 4
_SQUARE = 128  # pixels of a square of the checker
_LIGHT, _DARK = 255, 140  # of the checker: grey, which tints colours


class Painted(NamedTuple):
    """A mesh with what there is a vertex, checked.

    vertices: (n, 3) float64.
    faces: (m, 3) int32.
    colours: (n, 3) sRGB in [0, 1], or None.
    uv: (n, 2), u to the right and v up, the texture repeats at whole numbers; or None.
    values: (n,) each, by name, such as the confidence.
    """

    vertices: np.ndarray
    faces: np.ndarray
    colours: np.ndarray | None
    uv: np.ndarray | None
    values: Mapping[str, np.ndarray]


def painted(
    mesh: Mesh,
    colours: ArrayLike | None,
    uv: ArrayLike | None,
    values: Mapping[str, ArrayLike] | None,
) -> Painted:
    """Check a mesh and what is painted on it.

    Raises:
        ValueError: these are not one row for each vertex, or not finite, or colours are
            outside [0, 1]; texture coordinates without faces; a value of another name
            than `NAME`, or of a `TAKEN` one.
        MeshError: no mesh.
    """
    vertices, faces = checked_mesh(mesh, "export_mesh")
    n = len(vertices)
    if colours is not None:
        colours = _rows("colours", colours, (n, 3))
        if colours.min() < 0 or colours.max() > 1:
            raise ValueError(
                f"export_mesh: colours run from {colours.min():g} to "
                f"{colours.max():g}; pass sRGB in [0, 1]"
            )
    if uv is not None:
        uv = _rows("uv", uv, (n, 2))
        if not len(faces):
            raise ValueError("export_mesh: a point cloud has no texture; leave out uv")
    values = dict(values or {})
    for name in values:
        if not NAME.fullmatch(name) or name in TAKEN:
            raise ValueError(
                f"export_mesh: a value is named {name!r}; take another name, of the "
                "letters a to z and _"
            )
    rows = {name: _rows(name, row, (n,)) for name, row in values.items()}
    faces = faces.astype(np.int32)
    return Painted(vertices.astype(np.float64), faces, colours, uv, rows)


def _rows(name, values, shape):
    values = np.asarray(values, float)
    if values.shape != shape:
        said = f"export_mesh: {name} has shape {values.shape}; pass one row a vertex"
        raise ValueError(f"{said}: {shape}")
    if not np.isfinite(values).all():
        at = int(np.argmin(np.isfinite(values).reshape(len(values), -1).all(1)))
        raise ValueError(
            f"export_mesh: {name} at vertex {at}: {values[at]}; pass finite numbers"
        )
    return values


def ply_bytes(shape: Painted) -> bytes:
    """Binary PLY: doubles, so that positions stay to the last bit.

    Colours are one byte a channel, sRGB; there is no texture.

    Other values are properties of their names. Programs know `confidence`, as scanners
    write it, and `quality`.
    """
    n, m = len(shape.vertices), len(shape.faces)
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {n}"]
    header += [f"property double {axis}" for axis in "xyz"]
    fields: list[tuple] = [("xyz", "<f8", 3)]
    if shape.colours is not None:
        header += [f"property uchar {name}" for name in ("red", "green", "blue")]
        fields.append(("rgb", "u1", 3))
    for name in shape.values:
        header.append(f"property float {name}")
        fields.append((name, "<f4"))
    header += [f"element face {m}", "property list uchar int vertex_indices"]
    points = np.zeros(n, fields)
    points["xyz"] = shape.vertices
    if shape.colours is not None:
        points["rgb"] = np.rint(255 * shape.colours)
    for name, values in shape.values.items():
        points[name] = values
    faces = np.zeros(m, [("size", "u1"), ("corners", "<i4", 3)])
    faces["size"], faces["corners"] = 3, shape.faces
    head = "\n".join([*header, "end_header", ""]).encode()
    return head + points.tobytes() + faces.tobytes()


def obj_files(
    path: Path,
    shape: Painted,
    texture: bytes | None = None,
    corners: Int[np.ndarray, "m 3"] | None = None,
    tail: str = "",
) -> dict[Path, bytes]:
    """OBJ and what it names, by path, the OBJ last.

    Colours stand behind the coordinates of a vertex, sRGB in [0, 1], where MeshLab and
    Blender look for them.

    Args:
        path: of the OBJ.
        shape: what to write.
        texture: a PNG; the files `beside` are written too.
        corners: the row of `shape.uv` at each corner of the faces; the corner's vertex
            when absent.
        tail: of the names of the files beside.
    """
    files = {}
    text = io.BytesIO()
    if texture is not None:
        material, image = beside(path, tail)
        files[image] = texture
        lines = f"newmtl texture\nKd 1 1 1\nKs 0 0 0\nmap_Kd {image.name}\n"
        files[material] = utf8(lines)
        text.write(utf8(f"mtllib {material.name}\nusemtl texture\n"))
    rows, form = shape.vertices, "v" + 3 * " %.17g"
    if shape.colours is not None:
        rows, form = np.hstack([rows, shape.colours]), form + 3 * " %.6g"
    np.savetxt(text, rows, form)
    faces, corner = shape.faces + 1, " %d"
    if shape.uv is not None:
        np.savetxt(text, shape.uv, "vt %.9g %.9g")
        at = shape.faces if corners is None else corners
        faces, corner = np.stack([faces, at + 1], 2).reshape(-1, 6), " %d/%d"
    np.savetxt(text, faces, "f" + 3 * corner)
    return files | {path: text.getvalue()}


def beside(path: Path, tail: str = "") -> tuple[Path, Path]:
    """The material and the PNG that an OBJ with a texture names."""
    # The format separates names by spaces.
    stem = re.sub(r"\s", "_", path.stem) + tail
    return path.with_name(f"{stem}.mtl"), path.with_name(f"{stem}.png")


def glb_bytes(
    name: str,
    shape: Painted,
    texture: bytes | None,
    normals: np.ndarray | None = None,
) -> bytes:
    """Binary glTF with one mesh of this name, its texture inside.

    normals: (n, 3) of the vertices; from the faces when absent.

    Positions are float32, as the format has no doubles. A viewer multiplies the texture
    with the colours. Other values are attributes such as _CONFIDENCE: names of one's
    own begin so.
    """
    buffer = _Buffer()
    points = shape.vertices.astype("<f4")
    limits = {"min": points.min(0).tolist(), "max": points.max(0).tolist()}
    attributes = {"POSITION": buffer.add(points, "VEC3", **limits)}
    part: dict = {"attributes": attributes, "mode": _POINTS, "material": 0}
    if len(shape.faces):
        if normals is None:
            normals = vertex_normals(shape.vertices, shape.faces)
        # A vertex without a normal, as of no face, looks to +z.
        some = np.any(normals, axis=1, keepdims=True)
        looking = np.where(some, np.asarray(normals), [0, 0, 1]).astype("<f4")
        attributes["NORMAL"] = buffer.add(looking, "VEC3")
        corners = shape.faces.astype("<u4").ravel()
        part |= {"mode": _TRIANGLES, "indices": buffer.add(corners, "SCALAR")}
    if shape.colours is not None:
        linear = _linear(shape.colours).astype("<f4")
        # Opaque: some readers want the fourth number.
        linear = np.pad(linear, ((0, 0), (0, 1)), constant_values=1)
        attributes["COLOR_0"] = buffer.add(linear, "VEC4")
    if shape.uv is not None:
        # v points down in glTF.
        down = (shape.uv * [1, -1] + [0, 1]).astype("<f4")
        attributes["TEXCOORD_0"] = buffer.add(down, "VEC2")
    for label, values in shape.values.items():
        attributes[f"_{label.upper()}"] = buffer.add(values.astype("<f4"), "SCALAR")

    surface: dict = {"metallicFactor": 0, "roughnessFactor": 0.8}
    scene = {
        "asset": {"version": "2.0", "generator": "jfsf"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": name}],
        "meshes": [{"primitives": [part], "name": name}],
        # A mesh with holes shows its inside.
        "materials": [
            {"pbrMetallicRoughness": surface, "doubleSided": True, "name": name}
        ],
    }
    if texture is not None:
        surface["baseColorTexture"] = {"index": 0}
        image = {"bufferView": buffer.append(texture), "mimeType": "image/png"}
        scene |= {"images": [image], "samplers": [{}]}
        scene["textures"] = [{"source": 0, "sampler": 0}]
    scene |= {"accessors": buffer.accessors, "bufferViews": buffer.views}
    scene["buffers"] = [{"byteLength": len(buffer.data)}]
    return _container(utf8(json.dumps(scene, ensure_ascii=False)), bytes(buffer.data))


def checker() -> bytes:
    """A PNG of one period: two by two squares, white and grey."""
    square = np.add.outer(np.arange(2), np.arange(2)) % 2
    grey = np.kron(np.where(square, _DARK, _LIGHT), np.ones((_SQUARE, _SQUARE)))
    high, wide = grey.shape
    # By hand: Pillow is not among the core packages. Each line has its filter, 0,
    # before it.
    lines = np.pad(grey.astype(np.uint8), ((0, 0), (1, 0))).tobytes()
    # 8 bits of grey, without interlace.
    header = struct.pack(">IIBBBBB", wide, high, 8, 0, 0, 0, 0)
    chunks = (b"IHDR", header), (b"IDAT", zlib.compress(lines, 9)), (b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data))
        + kind
        + data
        + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )


class _Buffer:
    """The binary part, and the views and accessors of what is in it."""

    def __init__(self):
        self.data, self.views, self.accessors = bytearray(), [], []

    def append(self, data: bytes, **view) -> int:
        """The number of the view."""
        place = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)}
        self.views.append(place | view)
        self.data += _padded(data, b"\0")
        return len(self.views) - 1

    def add(self, array: np.ndarray, kind: str, **limits) -> int:
        """The number of the accessor of float32 attributes or of uint32 indices."""
        is_float = array.dtype.kind == "f"
        view = self.append(array.tobytes(), target=_VERTICES if is_float else _INDICES)
        accessor = {"bufferView": view, "componentType": _FLOAT if is_float else _UINT}
        self.accessors.append(accessor | {"count": len(array), "type": kind} | limits)
        return len(self.accessors) - 1


def _container(text, data):
    chunks = b"".join(
        struct.pack("<I", len(chunk)) + kind + chunk
        for kind, chunk in ((b"JSON", _padded(text, b" ")), (b"BIN\0", data))
    )
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _padded(data, filler):
    return data + filler * (-len(data) % 4)


def _linear(srgb):
    return np.where(srgb > 0.04045, ((srgb + 0.055) / 1.055) ** 2.4, srgb / 12.92)

"""A painted mesh -> GLB (glTF 2.0 in one binary file), its texture inside.

trimesh writes GLB too, but its vertex colours are sRGB where glTF wants them linear,
and it needs Pillow for a texture.
"""

import json
import struct

import numpy as np

from jfsf.apps.export._paint import Painted
from jfsf.mesh import vertex_normals
from jfsf.storage._atomic import utf8

_FLOAT, _UINT = 5126, 5125
_VERTICES, _INDICES = 34962, 34963  # what a part of the buffer is for
_POINTS, _TRIANGLES = 0, 4


def glb_bytes(
    name: str,
    shape: Painted,
    texture: bytes | None,
    normals: np.ndarray | None = None,
) -> bytes:
    """The file, with one mesh of this name.

    normals: (n, 3) of its vertices; None: from its faces.

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
        found = vertex_normals(shape.vertices, shape.faces)
        looking = found if normals is None else normals
        # A vertex without a normal, as of no face, looks to +z.
        some = np.any(looking, axis=1, keepdims=True)
        looking = np.where(some, looking, [0, 0, 1]).astype("<f4")
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
    for own, values in shape.values.items():
        attributes[f"_{own.upper()}"] = buffer.add(values.astype("<f4"), "SCALAR")

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

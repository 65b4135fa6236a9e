"""A painted mesh -> binary PLY: doubles, so that positions stay to the last bit."""

import numpy as np

from jfsf.export._paint import Painted


def ply_bytes(shape: Painted) -> bytes:
    """The file. Colours are one byte a channel, sRGB; there is no texture.

    `confidence` is the property of that name, as scanners write it.
    """
    n, m = len(shape.vertices), len(shape.faces)
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {n}"]
    header += [f"property double {axis}" for axis in "xyz"]
    fields: list[tuple] = [("xyz", "<f8", 3)]
    if shape.colours is not None:
        header += [f"property uchar {name}" for name in ("red", "green", "blue")]
        fields.append(("rgb", "u1", 3))
    if shape.confidence is not None:
        header.append("property float confidence")
        fields.append(("confidence", "<f4"))
    header += [f"element face {m}", "property list uchar int vertex_indices"]
    points = np.zeros(n, fields)
    points["xyz"] = shape.vertices
    if shape.colours is not None:
        points["rgb"] = np.rint(255 * shape.colours)
    if shape.confidence is not None:
        points["confidence"] = shape.confidence
    faces = np.zeros(m, [("size", "u1"), ("corners", "<i4", 3)])
    faces["size"], faces["corners"] = 3, shape.faces
    head = "\n".join([*header, "end_header", ""]).encode()
    return head + points.tobytes() + faces.tobytes()

"""A painted mesh -> binary PLY: doubles, so that positions stay to the last bit."""

import numpy as np

from jfsf.apps.export._paint import Painted


def ply_bytes(shape: Painted) -> bytes:
    """The file. Colours are one byte a channel, sRGB; there is no texture.

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

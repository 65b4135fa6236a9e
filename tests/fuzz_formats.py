"""A small sound file of every format that is read."""

import base64
import gzip
import io
import json
import struct
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.io
import trimesh

from jfsf import testing
from jfsf.apps.landmarks import Landmarks, write_landmarks
from jfsf.apps.landmarks._morphometrics import specimens_csv, specimens_tps
from jfsf.apps.mapfiles import write_match
from jfsf.types import Certificate, Match


class Format(NamedTuple):
    """A sound file, and how to damage what a checksum or compression protects.

    parts: the protected parts of the file, and a function that puts them back; those of
        the file itself if None.
    """

    suffix: str
    data: bytes
    parts: Callable[[bytes], tuple[list[bytes], Callable]] | None = None


def npz_parts(data: bytes):
    """The arrays of a .npz; their checksums will be right."""
    with zipfile.ZipFile(io.BytesIO(data)) as file:
        members = {name: file.read(name) for name in file.namelist()}

    def join(parts):
        found = io.BytesIO()
        with zipfile.ZipFile(found, "w", zipfile.ZIP_DEFLATED) as file:
            for name, part in zip(members, parts, strict=True):
                # By its name alone it would carry the clock.
                entry = zipfile.ZipInfo(name)
                file.writestr(entry, part, zipfile.ZIP_DEFLATED)
        return found.getvalue()

    return list(members.values()), join


def gz_parts(data: bytes):
    """What is packed; its checksum will be right."""
    return [gzip.decompress(data)], lambda parts: gzip.compress(parts[0], mtime=0)


def glb_parts(data: bytes):
    """The JSON and the numbers of a .glb; their lengths will be right."""
    size = struct.unpack_from("<I", data, 12)[0]

    def join(parts):
        chunks = b""
        for part, kind, fill in zip(parts, (b"JSON", b"BIN\0"), b" \0", strict=True):
            part += bytes([fill]) * (-len(part) % 4)
            chunks += struct.pack("<I", len(part)) + kind + part
        return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks

    return [data[20 : 20 + size], data[28 + size :]], join


def formats() -> dict[str, Format]:
    """By name."""
    v, f = testing.blob(subdivisions=1)
    ball = trimesh.Trimesh(v, f, process=False)
    scene = trimesh.Scene([ball, trimesh.PointCloud(v[:9])])
    points = [f"{x:.6g} {y:.6g} {z:.6g}\n" for x, y, z in v]
    polygons = [f"3 {a} {b} {c}\n" for a, b, c in f]
    corners = [f"f {a + 1}/1/2 {b + 1} {c - len(v)}\n" for a, b, c in f]
    text = {
        ".off": [f"OFF\n{len(v)} {len(f)} 0\n", *points, *polygons],
        ".obj": [*(f"v {point}" for point in points), *corners],
        ".vts": [f"{i}\n" for i in range(1, 60)],
        ".map": [f"{i:e}\n" for i in range(1, 60)],
        ".csv": ["x,y\n# both\na.off, b/c.off\n\n", '"d,e.off",/f/g.obj\n', "b,a\n"],
        ".xyz": ["# a scan\n42\n", *points],
        ".txt": ["# head, foot\n3 8\n\n4 9  # knee\n0 1\n"],
    }
    found = {
        suffix[1:]: Format(suffix, "".join(s).encode()) for suffix, s in text.items()
    }
    for name, kind, options in (
        ("ply", "ply", {"encoding": "ascii"}),
        ("binary ply", "ply", {}),
        ("stl", "stl_ascii", {}),
        ("binary stl", "stl", {}),
        ("glb", "glb", {}),
    ):
        source = scene if kind == "glb" else ball
        data = source.export(file_type=kind, **options)
        data = data if isinstance(data, bytes) else data.encode()
        found[name] = Format(f".{kind[:3]}", data, glb_parts if kind == "glb" else None)
    packed = gzip.compress(found["off"].data, mtime=0)
    found["packed off"] = Format(".off.gz", packed, gz_parts)
    np.save(held := io.BytesIO(), v)
    found["npy"] = Format(".npy", held.getvalue())
    found["gltf"] = Format(".gltf", _embedded(scene))
    T, values = np.arange(1, 60), {"T_xy": np.arange(1, 60), "C": np.eye(4), "s": "a"}
    # Not -v6: there scipy ends the process where the type of an element is damaged.
    for name, options in (
        ("-v4", {"format": "4"}),
        ("-v7", {"do_compression": True}),
    ):
        scipy.io.savemat(held := io.BytesIO(), values, **options)
        data = held.getvalue()
        if name != "-v4":  # its header carries the clock
            data = b"MATLAB 5.0 MAT-file".ljust(116) + data[116:]
        found[f"mat {name}"] = Format(".mat", data)
    np.savez(held := io.BytesIO(), T_xy=T - 1)
    found["npz"] = Format(".npz", held.getvalue(), npz_parts)
    found["match"] = Format(".npz", _match(), npz_parts)
    for suffix in (".json", ".fcsv", ".pp", ".tsv", ".pts"):
        found[suffix[1:]] = Format(suffix, _landmarks(suffix, v[:5]))
    names, landmarks = ["a", "b, c"], ["x", "", "y"]
    some = v[:6].reshape(2, 3, 3).copy()
    some[1, 2] = np.nan
    found["tps"] = Format(".tps", specimens_tps(names, some).encode())
    table = specimens_csv(names, landmarks, some).encode()
    found["specimens"] = Format(".CSV", table)
    return found


def _embedded(scene) -> bytes:
    """The scene as one .gltf, with its numbers in it."""
    files = dict(scene.export(file_type="gltf"))
    tree = json.loads(files["model.gltf"])
    for buffer in tree["buffers"]:
        data = base64.b64encode(files[buffer["uri"]]).decode()
        buffer["uri"] = f"data:application/octet-stream;base64,{data}"
    # Of a morph, without data: zeros.
    tree["accessors"].append({"componentType": 5126, "type": "VEC3", "count": 42})
    return json.dumps(tree, indent=1).encode()


def _match() -> bytes:
    numbers = {name: np.array(0.5) for name in Certificate._fields}
    certificate = Certificate(**numbers | {"landmarks": np.zeros(2)})
    match = Match(np.arange(59) % 42, np.arange(42), np.eye(4), certificate)
    with tempfile.TemporaryDirectory() as folder:
        write_match(path := Path(folder) / "a.npz", match, index_x=np.arange(59))
        return path.read_bytes()


def _landmarks(suffix: str, points) -> bytes:
    names = ('left "eye"', "a,b;c", "Ohr", "", "5")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"a{suffix}"
        write_landmarks(path, Landmarks(names, points, system="RAS"))
        return path.read_bytes()


FORMATS = formats()

"""Make shapes like the embedded ones from the posed CC0 meshes: remesh, then compress.

    pip install gpytoolbox
    python -m experiments.accuracy.make_shapes --data FOLDER --out shapes man_walk \\
        child_kick

FOLDER/makehuman_cc0 holds NAME.npz (key v, 13380 x 3, metres) and faces.npz (key f).
Each shape is remeshed on its own by Botsch and Kobbelt's method (2004), from gpytoolbox
(MIT), which only this script needs. It also writes shapes.json: seeds, quality.
"""

import json
import platform
import zlib
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from scipy.spatial import KDTree

from experiments import command_line
from jfsf.storage._atomic import write_atomically, write_text


def remesh(vertices, faces, n, seed):
    """A closed, evenly sampled mesh of the same surface with about n vertices.

    Args:
        vertices: (N, 3) float64.
        faces: (m, 3) int.
        n: wanted vertices; met within a few percent.
        seed: shuffles the input and turns it, so that no two meshings agree.

    Returns:
        vertices (~n, 3) float64, faces (~2n, 3) int.
    """
    from gpytoolbox import remesh_botsch

    rng = np.random.default_rng(seed)
    order = rng.permutation(len(vertices))
    shuffled = rng.permutation(np.argsort(order)[faces].astype(np.int32))
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    turn[0] *= np.linalg.det(turn)  # a reflection would turn the mesh inside out
    turned = vertices[order] @ turn
    area = trimesh.Trimesh(turned, shuffled, process=False).area
    # n equilateral triangles a side: area = 2n * sqrt(3)/4 h^2. The curvature takes its
    # share of the vertices, so the second round corrects h by what the first one gave.
    h = np.sqrt(2 / np.sqrt(3) * area / n)
    first, _ = remesh_botsch(turned, shuffled, 10, h)
    points, triangles = remesh_botsch(turned, shuffled, 10, h * np.sqrt(len(first) / n))
    return points @ turn.T, triangles


def pack(vertices, faces, template):
    """The arrays of the embedded format: 16-bit vertices are vq * scale + lo.

    Args:
        vertices: (n, 3) float64, n <= 65536.
        faces: (m, 3) int.
        template: (13380, 3), the posed mesh that the vertices were remeshed from.

    Returns:
        dict of vq, lo, scale, f, template_to_vertex; the last by nearest vertex.
    """
    if len(vertices) > 65536:
        raise ValueError(f"pack: {len(vertices)} vertices, 16 bits number 65536")
    lo = vertices.min(0).astype(np.float32)
    scale = np.float32((vertices - lo).max() / 65535)
    vq = np.clip(np.rint((vertices - lo) / scale), 0, 65535).astype(np.uint16)
    nearest = KDTree(unpack(vq, scale, lo)).query(template)[1]
    to_vertex = np.asarray(nearest, np.uint16)
    f = faces.astype(np.uint16)
    return dict(vq=vq, lo=lo, scale=scale, f=f, template_to_vertex=to_vertex)


def unpack(vq, scale, lo):
    """Vertices (n, 3) float64 of the embedded format."""
    return vq * float(scale) + lo.astype(np.float64)


def check(packed, template) -> dict[str, Any]:
    """Quality of a packed shape; ValueError unless it is one closed outward manifold.

    template_error: metres from a template point to its vertex: the grain of the truth.
    """
    vertices = unpack(packed["vq"], packed["scale"], packed["lo"])
    mesh = trimesh.Trimesh(vertices, packed["f"].astype(np.int64), process=False)
    sound = mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0
    if not sound or mesh.body_count != 1 or mesh.euler_number != 2:
        raise ValueError(
            f"check: watertight {mesh.is_watertight}, winding "
            f"{mesh.is_winding_consistent}, volume {mesh.volume:.3g}, bodies "
            f"{mesh.body_count}, Euler number {mesh.euler_number}: "
            "want True, True, > 0, 1, 2"
        )
    error = np.linalg.norm(vertices[packed["template_to_vertex"]] - template, axis=1)
    angles = np.degrees(mesh.face_angles.min(1))
    return {
        "vertices": len(vertices),
        "faces": len(mesh.faces),
        "smallest_angle_deg": round(float(angles.min()), 1),
        "smallest_angle_deg_5_percent": round(float(np.percentile(angles, 5)), 1),
        "template_error_mean": round(float(error.mean()), 5),
        "template_error_max": round(float(error.max()), 5),
    }


def main() -> None:
    parser = command_line.parser(
        "Remesh and compress the CC0 shapes.", out=Path("shapes"), data=True
    )
    parser.add_argument("names", nargs="*", help="default: all in the folder")
    parser.add_argument("--vertices", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=0)
    args = command_line.parse(parser)
    source = args.data / "makehuman_cc0"
    faces = np.load(source / "faces.npz")["f"]
    every = sorted(p.stem for p in source.glob("*.npz") if p.stem != "faces")
    args.out.mkdir(parents=True, exist_ok=True)
    shapes = {}
    for name in args.names or every:
        template = np.load(source / f"{name}.npz")["v"].astype(np.float64)
        seed = zlib.crc32(f"{name} {args.seed}".encode())
        packed = pack(*remesh(template, faces, args.vertices, seed), template)
        shapes[name] = check(packed, template)
        path = args.out / f"{name}.npz"
        save = lambda file, packed=packed: np.savez_compressed(file, **packed)
        write_atomically(path, save)
        print(f"{path}: {path.stat().st_size} bytes, {json.dumps(shapes[name])}")
    packages = ("gpytoolbox", "numpy", "scipy", "trimesh")
    report = {
        "seed": args.seed,
        "device": f"{platform.machine()} CPU, Python {platform.python_version()}",
        "versions": {package: version(package) for package in packages},
        "shapes": shapes,
    }
    text = json.dumps(report, indent=2) + "\n"
    write_text(args.out / "shapes.json", text)


if __name__ == "__main__":
    main()

"""A glTF or GLB file -> Mesh, through trimesh.

trimesh fills with zeros what it cannot decode, and as many as the file says. So the
scene is looked through first.
"""

import io
import json
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from jfsf.mesh._values import MeshError
from jfsf.types import Mesh

MOST_ZEROS = 1_000_000  # items without data, of what is no vertex or face: morphs
_DRACO = "KHR_draco_mesh_compression"


def parse_gltf(data: bytes, folder: Path, suffix: str) -> Mesh:
    """Read the triangles and points of a glTF or GLB scene, in world coordinates.

    Parts come in the order of the file's meshes. Lines are left out. glTF itself splits
    vertices at seams: see `weld`.

    Args:
        data: contents of the file.
        folder: of the file, with the other files that a .gltf may name.
        suffix: ".glb" or ".gltf".

    Raises:
        MeshError: what trimesh cannot read, or reads as another shape: a compression,
            normalised positions, a skin, and morph targets with weights. Errors of
            trimesh pass through.
    """
    points, triangles, total = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
    for matrix, part in scene_parts(data, folder, suffix):
        xyz = np.asarray(part.vertices, np.float64)
        faces = np.asarray(getattr(part, "faces", triangles[0]), np.int64)
        # A mirrored part must still face outward.
        step = -1 if np.linalg.det(matrix[:3, :3]) < 0 else 1
        points.append(xyz @ matrix[:3, :3].T + matrix[:3, 3])
        triangles.append(faces[:, ::step] + total)
        total += len(xyz)
    return Mesh(np.concatenate(points), np.concatenate(triangles))


def scene_parts(
    data: bytes, folder: Path, suffix: str, *, skip_materials: bool = True
) -> list[tuple[np.ndarray, Any]]:
    """The placed parts of a scene that are read, in the order of their vertices.

    Args:
        data, folder, suffix: as `parse_gltf`.
        skip_materials: textures are not read.

    Returns:
        Of each the matrix (4, 4) that places it, and trimesh's Trimesh or PointCloud,
        which may be in several places.

    Raises:
        MeshError: as `parse_gltf`.
    """
    described = _scene(data)
    _check_accessors(described)
    _check_pose(described)
    import trimesh  # Slow to import, and no other format needs it.
    from trimesh.resolvers import FilePathResolver

    scene = trimesh.load_scene(
        io.BytesIO(data),
        file_type=suffix[1:],
        resolver=FilePathResolver(str(folder)),
        process=False,
        skip_materials=skip_materials,
    )
    rank = {name: i for i, name in enumerate(scene.geometry)}
    parts = [scene.graph[node] for node in scene.graph.nodes_geometry]
    found = []
    for matrix, name in sorted(parts, key=lambda part: rank[part[1]]):
        part: Any = scene.geometry[name]
        if not isinstance(part, trimesh.Trimesh | trimesh.PointCloud):
            continue
        if not np.any(part.vertices):
            # trimesh gives zeros for draco data if DracoPy is not installed.
            raise MeshError(
                f"the vertices of its part {name!r} are all 0", "export it uncompressed"
            )
        found.append((np.asarray(matrix), part))
    return found


def _scene(data: bytes) -> dict[str, Any]:
    """The JSON of either format."""
    if data.startswith(b"glTF"):
        data = data[20 : 20 + int.from_bytes(data[12:16], "little")]
    return json.loads(data)


def _check_accessors(scene: dict[str, Any]) -> None:
    accessors = scene.get("accessors", [])
    for number, accessor in enumerate(accessors):
        if "bufferView" not in accessor and accessor["count"] > MOST_ZEROS:
            raise MeshError(
                f"its accessor {number} announces {accessor['count']} items without "
                "data",
                "export it uncompressed",
            )
    for mesh in scene.get("meshes", []):
        for part in mesh["primitives"]:
            if _DRACO in part.get("extensions", {}) and find_spec("DracoPy"):
                continue
            used = part["attributes"].get("POSITION"), part.get("indices")
            for accessor in (accessors[i] for i in used if i is not None):
                if "bufferView" not in accessor or "sparse" in accessor:
                    raise MeshError(
                        "it has vertices or faces that are compressed or sparse",
                        "export it uncompressed",
                    )
            position = part["attributes"].get("POSITION")
            if position is not None and accessors[position].get("normalized"):
                raise MeshError(
                    "its positions are normalised integers (KHR_mesh_quantization)",
                    "export it with floats, or run gltf-transform dequantize on it",
                )


def _check_pose(scene: dict[str, Any]) -> None:
    """Refuse meshes whose vertices are elsewhere than their positions say."""
    meshes = scene.get("meshes", [])
    for node in scene.get("nodes", []):
        if "mesh" not in node:
            continue
        if "skin" in node:
            raise MeshError(
                "it has a mesh with a skin, and poses by joints are not read",
                "apply the pose and export it without the skin; in Blender, apply the "
                "Armature modifier",
            )
        mesh = meshes[node["mesh"]]
        has_targets = any(part.get("targets") for part in mesh["primitives"])
        if has_targets and any(node.get("weights", mesh.get("weights", []))):
            raise MeshError(
                "it has a mesh with morph targets, whose weights are not read",
                "apply them and export it again; in Blender, apply all shape keys",
            )

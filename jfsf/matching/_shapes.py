"""Meshes and point clouds that can be matched, and their spectra. Host side."""

from typing import NamedTuple

from jfsf.matching._settings import Settings
from jfsf.mesh import (
    MeshError,
    denoised,
    orient,
    reconstruct,
    unclear_winding,
    validate,
    without_holes,
)
from jfsf.mesh._winding import MAX_UNCLEAR
from jfsf.spectral._eigenpairs import spectrum_of_valid
from jfsf.spectral._laplacian import plain_arrays
from jfsf.types import Mesh, Spectrum


def basis(
    mesh: Mesh,
    *,
    name: str = "mesh",
    settings: Settings = Settings(),
    cache: bool = True,
) -> Spectrum:
    """The spectrum that `match` gives a shape, whatever it is matched with.

    Args:
        mesh: as `match` takes it. Its faces are wound outward first; a point cloud gets
            those that `jfsf.mesh.reconstruct` finds.
        name, cache: as `jfsf.spectral.spectrum`.
        settings: `k` is read, and the number of eigenpairs that the search needs.

    Returns:
        As `jfsf.spectral.spectrum`, with `Settings.k` eigenpairs, fewer for fewer than
        4 k vertices.

    Raises:
        MeshError: as `match`.
    """
    check_matchable(mesh, name=name, settings=settings)
    return basis_of(shape_of(plain_arrays(mesh)), name, settings, cache)


def check_matchable(
    mesh: Mesh, *, name: str = "mesh", settings: Settings = Settings()
) -> None:
    """Raise MeshError for a mesh that `match` refuses.

    Args:
        mesh: any mesh or point cloud.
        name: opens the message: the file, or the argument.
        settings: say how many vertices are needed.

    Raises:
        MeshError: as `jfsf.mesh.validate`, or too few vertices.
    """
    validate(mesh, name=name)
    if (n := len(mesh.vertices)) < settings.min_vertices:
        raise MeshError(
            f"has {n} vertices, matching needs {settings.min_vertices}",
            "subdivide the mesh",
            name,
        )


class MatchedShape(NamedTuple):
    """A shape that `check_matchable` has accepted.

    surface: the mesh; of a point cloud the oriented surface, without faces if unknown.
    whole: of a point cloud with a surface, the mesh or cloud whose Laplacian it gets;
        else None.
    """

    surface: Mesh
    whole: Mesh | None = None


def shape_of(mesh: Mesh) -> MatchedShape:
    """A mesh as it is; a point cloud with the surface that is found for it."""
    if len(mesh.faces):
        return MatchedShape(mesh)
    surface, whole = reconstruct(mesh)
    return MatchedShape(surface, whole if len(surface.faces) else None)


def checked(mesh_x: Mesh, mesh_y: Mesh, settings: Settings) -> dict[str, Mesh]:
    """Both meshes by the names of their arguments, as arrays of one precision."""
    meshes = {"mesh_x": mesh_x, "mesh_y": mesh_y}
    for name, mesh in meshes.items():
        check_matchable(mesh, name=name, settings=settings)
    return {name: plain_arrays(mesh) for name, mesh in meshes.items()}


def tells_left_from_right(shape: MatchedShape) -> bool:
    """Whether its faces are wound consistently, nearly all of them."""
    faces = len(shape.surface.faces) > 0
    return faces and unclear_winding(shape.surface) <= MAX_UNCLEAR


def basis_of(
    shape: MatchedShape,
    name: str,
    settings: Settings,
    cache: bool,
    *,
    threads: bool = True,
) -> Spectrum:
    """`basis` of a shape that was checked.

    threads: whether its solver may use all cores.
    """
    mesh, whole = shape
    k = settings.eigenpairs(len(mesh.vertices))
    options = {"name": name, "cache": cache, "threads": threads}
    if whole is None:
        wound = without_holes(orient(denoised(mesh))) if len(mesh.faces) else mesh
        return spectrum_of_valid(wound, k, **options)
    spec = spectrum_of_valid(whole, k, laplacian="robust", **options)
    # Of the whole's other triangles, if it has any, the winding is unknown.
    return spec._replace(faces=mesh.faces)

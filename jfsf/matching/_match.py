"""Two meshes -> Match: checks, spectra, then the stages. Host side.

This file is long because the public functions explain all that they take.
"""

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Float, Int
from threadpoolctl import threadpool_limits

from jfsf.arguments import checked_descriptors, checked_initial, checked_landmarks
from jfsf.convert import HasMaps
from jfsf.initial import Orientation, orientation_sign
from jfsf.matching._coarse import (
    at_copies,
    coarse_copy,
    have_copies,
    start_from_copies,
)
from jfsf.matching._running import compile_stages, run_compiled
from jfsf.mesh import (
    MeshError,
    boundary_edges,
    denoised,
    orient,
    reconstruct,
    validate,
    without_holes,
)
from jfsf.parts import match_parts
from jfsf.pipeline import InitialMap
from jfsf.settings import Settings
from jfsf.sizes import Given, padded, padded_arguments, padded_sizes, spectrum_like
from jfsf.spectral import functional_map, spectrum_of_valid, truncate
from jfsf.types import ArrayLike, Match, Mesh, Spectrum


def match(
    mesh_x: Mesh,
    mesh_y: Mesh,
    *,
    orientation: Orientation = "preserve",
    landmarks: Int[ArrayLike, "l 2"] | None = None,
    descriptors: tuple[Float[ArrayLike, "n_x d"], Float[ArrayLike, "n_y d"]]
    | None = None,
    initial: Float[ArrayLike, "k_x k_y"] | Int[ArrayLike, " n_x"] | HasMaps | None = (
        None
    ),
    partial: bool = False,
    settings: Settings = Settings(),
    cache: bool = True,
    progress: Callable[[str], object] | None = None,
) -> Match:
    """Point-to-point maps between two shapes, both ways, from the meshes alone.

    Args:
        mesh_x, mesh_y: one connected component each, any units and sizes, 160 vertices
            or more (`Settings.min_vertices`); a mesh without faces is a point cloud.
        orientation: "preserve" asks for the map that keeps left and right (faces are
            wound outward first), "reverse" for its mirror image, "any" for the best of
            both. Of a point cloud the surface is found first (`jfsf.mesh.reconstruct`);
            where it has no clear outside, it is always "any".
        landmarks: rows (vertex of X, vertex of Y) known to correspond; one row decides
            a flip. One that does not fit the others is not obeyed, see
            `Certificate.landmarks`.
        descriptors: one matrix a shape, column i of X's corresponding to column i of
            Y's, any unit and sign. They replace the wave kernel signature, or stand
            beside it with `FeatureSettings(keep_wks=True)`; curvature stays.
        initial: a functional map C_yx in the eigenbases of `basis`, a point-to-point
            map T_xy, or a record with T_xy such as `Maps` or `Match`. It replaces the
            search. Its own orientation is kept, whatever `orientation` says. Of C_yx
            the leading block of `Settings.ks[0]` functions counts: 30 by default.
        partial: one shape is a part of the other, or both overlap. Both are meshes in
            one unit; bodies may differ in size by a factor of 1.5. It takes neither
            landmarks, nor descriptors, nor an initial map. Cuts change the sizes of
            arrays, so it runs on the host, with `match` of the cuts inside: it cannot
            be traced. It takes about five times as long. Two closed surfaces share all.
            The confidence is not calibrated for parts.
        settings: how each stage works, converters included.
        cache: keep spectra and compiled programs on disk (`jfsf.storage.folder`).
        progress: called with the name of each stage as it begins.

    Returns:
        T_xy, T_yx, C_yx and the certificate, in jax's default precision. With `partial`
        also matched_x and matched_y; the certificate is that of the overlap, its gap
        and confidence also count the rivals that were found. A vertex that is not
        matched has the image nearest to it after bending.

    Raises:
        MeshError: a mesh that cannot be matched, with the reason.
        ValueError: landmarks, descriptors or an initial map that do not fit the meshes,
            an unknown orientation, or no overlap found with `partial`.
    """
    meshes = {"mesh_x": mesh_x, "mesh_y": mesh_y}
    for name, mesh in meshes.items():
        check_matchable(mesh, name=name, settings=settings)
    if partial:
        if not (landmarks is None and descriptors is None and initial is None):
            raise ValueError(
                "match: partial=True takes neither landmarks, nor descriptors, nor an "
                "initial map; leave them out"
            )
        return _partial(mesh_x, mesh_y, orientation, settings, cache, progress)
    sizes = len(mesh_x.vertices), len(mesh_y.vertices)
    shapes = {name: _shape(mesh) for name, mesh in meshes.items()}
    if not all(len(shape.surface.faces) for shape in shapes.values()):
        orientation = "any"
    given = Given(
        checked_landmarks(landmarks, sizes),
        checked_descriptors(descriptors, sizes),
        checked_initial(initial, sizes),
        orientation_sign(orientation),
        False,
    )
    found = _match(shapes, given, settings, cache, progress)
    return found._replace(T_xy=found.T_xy[: sizes[0]], T_yx=found.T_yx[: sizes[1]])


def symmetry(
    mesh: Mesh, *, settings: Settings = Settings(), cache: bool = True
) -> Match:
    """The map of a shape to itself that swaps left and right.

    It is the best map that reverses orientation and moves the shape's points. For a
    shape without such a symmetry it is still the best there is.

    Args:
        mesh, settings, cache: as `match`.

    Returns:
        As `match`, X and Y being the mesh: T_xy and T_yx both are the symmetry, found
        in either direction, and agree up to near vertices.

    Raises:
        MeshError: as `match`, and for a point cloud without a clear outside, which has
            no left and right.
    """
    check_matchable(mesh, settings=settings)
    n, shape = len(mesh.vertices), _shape(mesh)
    if len(shape.surface.faces) == 0:
        raise MeshError(
            f"symmetry: mesh has {n} vertices and no faces, and a point cloud without "
            "a clear outside no left and right; triangulate it"
        )
    given = Given(None, None, None, orientation_sign("reverse"), True)
    found = _match({"mesh": shape}, given, settings, cache)
    return found._replace(T_xy=found.T_xy[:n], T_yx=found.T_yx[:n])


def basis(
    mesh: Mesh,
    *,
    name: str = "mesh",
    settings: Settings = Settings(),
    cache: bool = True,
) -> Spectrum:
    """The spectrum that `match` gives a shape, whatever it is matched with.

    Args:
        mesh: as `match` takes it; its faces are wound outward first. Of a point cloud
            these are the faces that `jfsf.mesh.reconstruct` finds.
        name, cache: as `jfsf.spectral.spectrum`.
        settings: `k` counts, and what the search needs.

    Returns:
        As `jfsf.spectral.spectrum`, with `Settings.k` eigenpairs, fewer for fewer than
        4 k vertices.

    Raises:
        MeshError: as `match`.
    """
    check_matchable(mesh, name=name, settings=settings)
    return _basis(_shape(mesh), name, settings, cache)


def padded_bases(
    mesh_x: Mesh,
    mesh_y: Mesh,
    *,
    settings: Settings = Settings(),
    cache: bool = True,
) -> tuple[Spectrum, Spectrum]:
    """The bases of a pair as `match` hands them to its stages.

    A stage that `match` has compiled for the pair serves these without a new program.

    Args:
        mesh_x, mesh_y, settings, cache: as `match`.

    Returns:
        Spectra with equally many eigenpairs, padded to common sizes.

    Raises:
        MeshError: as `match`.
    """
    meshes = {"mesh_x": mesh_x, "mesh_y": mesh_y}
    for name, mesh in meshes.items():
        check_matchable(mesh, name=name, settings=settings)
    shapes = {name: _shape(mesh) for name, mesh in meshes.items()}
    specs = [_basis(s, name, settings, cache) for name, s in shapes.items()]
    sizes = padded_sizes([s.surface for s in shapes.values()], settings)
    padded_x, padded_y = (padded(*pair) for pair in zip(specs, sizes, strict=True))
    return padded_x, padded_y


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
            f"{name}: has {n} vertices, matching needs {settings.min_vertices}; "
            "subdivide the mesh"
        )


def _partial(
    mesh_x: Mesh,
    mesh_y: Mesh,
    orientation: Orientation,
    settings: Settings,
    cache: bool,
    progress: Callable[[str], object] | None,
) -> Match:
    """`match` with partial=True."""
    for name, mesh in (("mesh_x", mesh_x), ("mesh_y", mesh_y)):
        if len(mesh.faces) == 0:
            raise MeshError(
                f"{name}: has no faces, and partial=True cuts surfaces; triangulate it"
            )
    sign = orientation_sign(orientation)
    if not any(len(boundary_edges(mesh.faces)) for mesh in (mesh_x, mesh_y)):
        found = match(
            mesh_x,
            mesh_y,
            orientation=orientation,
            settings=settings,
            cache=cache,
            progress=progress,
        )
        all_x, all_y = (jnp.ones(len(m.vertices), bool) for m in (mesh_x, mesh_y))
        return found._replace(matched_x=all_x, matched_y=all_y)

    say = progress or (lambda name: None)

    def refine(part_x, part_y, T_xy):
        say("refinement of a region")
        sizes = len(part_x.vertices), len(part_y.vertices)
        initial = checked_initial(T_xy, sizes)
        given = Given(None, None, initial, sign, False)
        parts = {"part of mesh_x": _Shape(part_x), "part of mesh_y": _Shape(part_y)}
        # The spectra of cuts on the way are never asked for again.
        found = _match(parts, given, settings, cache, keep_spectra=False)
        return found._replace(T_xy=found.T_xy[: sizes[0]], T_yx=found.T_yx[: sizes[1]])

    say("regions")
    found = match_parts(mesh_x, mesh_y, refine, int(sign))
    k = min(settings.eigenpairs(len(mesh.vertices)) for mesh in (mesh_x, mesh_y))
    spec_x, spec_y = (
        jax.tree.map(
            jnp.asarray, truncate(_basis(_Shape(mesh), name, settings, cache), k)
        )
        for name, mesh in (("mesh_x", mesh_x), ("mesh_y", mesh_y))
    )
    T_xy, T_yx, matched_x, matched_y = map(jnp.asarray, found[:4])
    C_yx = functional_map(T_xy, spec_x, spec_y)
    certificate = jax.tree.map(jnp.asarray, found.certificate)
    return Match(T_xy, T_yx, C_yx, certificate, matched_x, matched_y)


class _Shape(NamedTuple):
    """A shape that `check_matchable` has accepted.

    surface: the mesh; of a point cloud the oriented surface, without faces if unknown.
    whole: of a point cloud with a surface, the mesh or cloud whose Laplacian it gets;
        else None.
    """

    surface: Mesh
    whole: Mesh | None = None


def _shape(mesh: Mesh) -> _Shape:
    if len(mesh.faces):
        return _Shape(mesh)
    surface, whole = reconstruct(mesh)
    return _Shape(surface, whole if len(surface.faces) else None)


def _match(
    shapes: Mapping[str, _Shape],
    given: Given,
    settings: Settings,
    cache: bool,
    progress: Callable[[str], object] | None = None,
    *,
    keep_spectra: bool = True,
) -> Match:
    """Of the first shape and the last, which may be one."""
    keep_spectra &= cache
    if progress is not None:
        progress("spectra")
    surfaces = [shape.surface for shape in shapes.values()]
    sizes = padded_sizes(surfaces, settings)
    unpadded, given = given, padded_arguments(given, sizes)
    # Threads for the spectra, and two that compile. The limit is set around all: one
    # set and lifted by each of them would be left behind.
    threads = ThreadPoolExecutor(len(shapes) + 2)
    with threadpool_limits(1, user_api="blas"), threads as pool:
        # Two spectra with two threads each take longer than one after the other.
        alone = len(shapes) == 1
        specs = pool.map(
            lambda item: _basis(
                item[1], item[0], settings, keep_spectra, threads=alone
            ),
            shapes.items(),
        )
        # Compiling or loading the programs takes as long as the spectra, or longer.
        like = [spectrum_like(size) for size in sizes]
        compile_stages(like[0], like[-1], given, settings, keep=cache, pool=pool)
        specs = [padded(*pair) for pair in zip(specs, sizes, strict=True)]
    coarse = None
    if have_copies(surfaces, sizes, settings):
        coarse = partial(
            _coarse_start, shapes, unpadded, specs, settings, cache, progress
        )
    return run_compiled(
        *(specs[0], specs[-1], given, settings),
        keep=cache,
        progress=progress,
        coarse=coarse,
    )


def _coarse_start(
    shapes: Mapping[str, _Shape],
    given: Given,
    specs: list[Spectrum],
    settings: Settings,
    cache: bool,
    progress: Callable[[str], object] | None,
) -> InitialMap | None:
    """A start for these shapes from the match of their coarse copies; or None."""
    copies = {n: coarse_copy(s.surface, settings) for n, s in shapes.items()}
    parts = {name: _Shape(copy.mesh) for name, copy in copies.items()}
    both = list(copies.values())
    x, y = both[0], both[-1]
    if progress is not None:
        progress("coarse copies")
    try:
        for name, part in parts.items():
            check_matchable(part.surface, name=name, settings=settings)
        found = _match(
            *(parts, at_copies(given, x, y), settings, cache, progress),
            keep_spectra=False,
        )
    except MeshError:  # the copy is broken, the whole is not
        return None
    return start_from_copies(found, x, y, specs[0], specs[-1], settings=settings)


def _basis(
    shape: _Shape, name: str, settings: Settings, cache: bool, *, threads: bool = True
) -> Spectrum:
    mesh, whole = shape
    k = settings.eigenpairs(len(mesh.vertices))
    options = {"name": name, "cache": cache, "threads": threads}
    if whole is None:
        wound = without_holes(orient(denoised(mesh))) if len(mesh.faces) else mesh
        return spectrum_of_valid(wound, k, **options)
    found = spectrum_of_valid(whole, k, laplacian="robust", **options)
    # Of the whole's other triangles, if it has any, the winding is unknown.
    return found._replace(faces=mesh.faces)

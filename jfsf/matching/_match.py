"""Two meshes -> Match: checks, spectra, then the policy. Host side.

This file is long because the public functions explain all that they take.
"""

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from time import perf_counter
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from threadpoolctl import threadpool_limits

from jfsf.arguments import (
    MatchInputs,
    check_one_unit,
    checked_descriptors,
    checked_initial,
    checked_landmarks,
    padded_inputs,
)
from jfsf.convert import HasMaps, nearest
from jfsf.evidence import landmark_distances, map_distances
from jfsf.initial import Orientation, orientation_sign
from jfsf.mesh import (
    MAX_UNCLEAR,
    MeshError,
    boundary_edges,
    denoised,
    orient,
    reconstruct,
    unclear_winding,
    validate,
    vertex_areas,
    without_holes,
)
from jfsf.parts import match_parts
from jfsf.policy import PairState, attempt_pairs, compile_first_attempt
from jfsf.runtime import CompileOnly, OneByOne, padded, padded_shapes, spectrum_like
from jfsf.settings import EvidenceSettings, Settings
from jfsf.spectral import embeddings, functional_map, spectrum_of_valid, truncate
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
    same_unit: bool = True,
    settings: Settings = Settings(),
    cache: bool = True,
    progress: Callable[[str], object] | None = None,
) -> Match:
    """Point-to-point maps between two shapes, both ways, from the meshes alone.

    Args:
        mesh_x, mesh_y: one connected component each (`jfsf.match_components` takes
            several), any units and sizes, 160 vertices or more
            (`Settings.min_vertices`); a mesh without faces is a point cloud.
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
            the leading block of `Settings.ks[0]` functions counts: 30 by default. The
            map is kept, but others are tried on coarse copies: one that fits as well
            makes it less sure. `Settings(retry_below=0)` leaves that out.
        partial: one shape is a part of the other, or both overlap. Both are meshes;
            see `same_unit` for their sizes. Landmarks and descriptors guide the search
            for the region; the map within it is refined without the descriptors. An
            initial map replaces that search: it is turned into a T_xy, its scale is
            read from it, and no other is tried. Cuts change the sizes of arrays, so it
            runs on the host, with `match` of the cuts inside: it cannot be traced. It
            takes some ten times as long. Two closed surfaces share all. There is no
            confidence for parts.
        same_unit: with `partial`, whether both are in one unit. Then bodies may differ
            in size by a factor of 1.5. Else a size between 0.3 and 3 times that of the
            file is looked for, which takes longer and is less certain. Sizes of whole
            shapes never matter.
        settings: how each stage works, converters included.
        cache: keep spectra and compiled programs on disk (`jfsf.storage.folder`).
        progress: called with the name of each stage as it begins.

    Returns:
        T_xy, T_yx, C_yx, the certificate and the confidence of each vertex, in jax's
        default precision, and which starts were attempted (`jfsf.types.MatchInfo`).
        With `partial` membership_x, membership_y, matched_x and matched_y of each
        vertex in place of the last two, and the shares of the areas that are matched;
        the certificate is that of the overlap, without a confidence; its gap counts the
        rivals that were found. A vertex that is not matched has the image nearest to it
        after bending.

    Raises:
        MeshError: a mesh that cannot be matched, with the reason.
        ValueError: landmarks, descriptors or an initial map that do not fit the meshes,
            an unknown orientation, or with `partial` no overlap found, or shapes whose
            sizes differ by 12 times or more, as in millimetres and in metres.
    """
    meshes = _checked(mesh_x, mesh_y, settings)
    host = _Host(cache, cache, progress)
    if partial:
        inputs = _inputs(meshes, orientation, landmarks, descriptors, initial)
        T_yx = getattr(initial, "T_yx", None)
        return _partial(meshes, inputs, T_yx, same_unit, settings, host)
    given = _given(meshes, orientation, landmarks, descriptors, initial)
    return _match(*given, settings, host)


def alternatives(
    mesh_x: Mesh,
    mesh_y: Mesh,
    *,
    orientation: Orientation = "preserve",
    landmarks: Int[ArrayLike, "l 2"] | None = None,
    descriptors: tuple[Float[ArrayLike, "n_x d"], Float[ArrayLike, "n_y d"]]
    | None = None,
    min_distance: float = EvidenceSettings().distinct,
    settings: Settings = Settings(),
    cache: bool = True,
    progress: Callable[[str], object] | None = None,
) -> list[Match]:
    """The maps that `match` chooses from, the most confident first.

    `match` tries further starts only where it is in doubt, so a sure pair has one map.
    `Settings(retry_below=1)` has them tried for every pair, and `nonisometric_attempts`
    says how many of their maps are bent on the whole shapes. This takes as long as
    `match` with the same settings.

    Args:
        mesh_x, mesh_y, orientation, landmarks, descriptors, settings, cache, progress:
            as `match`.
        min_distance: a map is left out if its images lie nearer than this to those of
            a more confident one (`jfsf.evidence.map_distances`). 0 keeps the maps of
            all attempts.

    Returns:
        The match of each attempt, as `match` returns it, that of `match` itself first.
        `Match.info` says of each which attempt it is (`won`) and where its start came
        from (`start`).

    Raises:
        MeshError, ValueError: as `match`.
    """
    meshes = _checked(mesh_x, mesh_y, settings)
    given = _given(meshes, orientation, landmarks, descriptors, None)
    pair = _attempted(*given, settings, _Host(cache, cache, progress))
    matches = pair.results(settings)
    confidence = [float(match.certificate.confidence) for match in matches]
    order = np.argsort(-np.nan_to_num(confidence, nan=-1.0), kind="stable").tolist()
    order.remove(pair.won)
    pairs = settings.distance_pairs
    apart = map_distances(matches, pair.spectra, distance_pairs=pairs)
    kept = [pair.won]
    for i in order:
        if min_distance <= 0 or apart[i, kept].min() >= min_distance:
            kept.append(i)
    return [_cut(matches[i], *meshes.values()) for i in kept]


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
    shape = _shape(mesh)
    if len(shape.surface.faces) == 0:
        raise MeshError(
            f"symmetry: mesh has {len(mesh.vertices)} vertices and no faces, and a "
            "point cloud without a clear outside no left and right; triangulate it"
        )
    inputs = MatchInputs(sign=orientation_sign("reverse"), self_map=True)
    return _match({"mesh": shape}, inputs, settings, _Host(cache, cache))


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


class _Shape(NamedTuple):
    """A shape that `check_matchable` has accepted.

    surface: the mesh; of a point cloud the oriented surface, without faces if unknown.
    whole: of a point cloud with a surface, the mesh or cloud whose Laplacian it gets;
        else None.
    """

    surface: Mesh
    whole: Mesh | None = None


class _Host(NamedTuple):
    """What is kept on disk, and who is told of the stages."""

    keep_programs: bool
    keep_spectra: bool
    progress: Callable[[str], object] | None = None

    def say(self, name: str) -> None:
        if self.progress is not None:
            self.progress(name)


def _shape(mesh: Mesh) -> _Shape:
    if len(mesh.faces):
        return _Shape(mesh)
    surface, whole = reconstruct(mesh)
    return _Shape(surface, whole if len(surface.faces) else None)


def _checked(mesh_x: Mesh, mesh_y: Mesh, settings: Settings) -> dict[str, Mesh]:
    """Both meshes by the names of their arguments."""
    meshes = {"mesh_x": mesh_x, "mesh_y": mesh_y}
    for name, mesh in meshes.items():
        check_matchable(mesh, name=name, settings=settings)
    return meshes


def _tells_left_from_right(shape: _Shape) -> bool:
    faces = len(shape.surface.faces) > 0
    return faces and unclear_winding(shape.surface) <= MAX_UNCLEAR


def _given(
    meshes: Mapping[str, Mesh], orientation, landmarks, descriptors, initial
) -> tuple[dict[str, _Shape], MatchInputs]:
    """Both shapes, and what was given with them, checked."""
    shapes = {name: _shape(mesh) for name, mesh in meshes.items()}
    if not all(_tells_left_from_right(shape) for shape in shapes.values()):
        orientation = "any"
    return shapes, _inputs(meshes, orientation, landmarks, descriptors, initial)


def _inputs(
    meshes: Mapping[str, Mesh], orientation, landmarks, descriptors, initial
) -> MatchInputs:
    size_x, size_y = (len(mesh.vertices) for mesh in meshes.values())
    return MatchInputs(
        checked_landmarks(landmarks, (size_x, size_y)),
        checked_descriptors(descriptors, (size_x, size_y)),
        checked_initial(initial, (size_x, size_y)),
        orientation_sign(orientation),
    )


def _match(
    shapes: Mapping[str, _Shape], inputs: MatchInputs, settings: Settings, host: _Host
) -> Match:
    """Of the first shape and the last, which may be one."""
    surfaces = [shape.surface for shape in shapes.values()]
    best = _attempted(shapes, inputs, settings, host).result(settings)
    return _cut(best, surfaces[0], surfaces[-1])


def attempted_pair(
    mesh_x: Mesh,
    mesh_y: Mesh,
    *,
    settings: Settings = Settings(),
    cache: bool = True,
) -> PairState:
    """All that `match` tries: for studies of the starts and of the evidence.

    Args:
        mesh_x, mesh_y, settings, cache: as `match`.

    Returns:
        Attempts on the padded shapes, and those on their coarse copies.

    Raises:
        MeshError: as `match`.
    """
    meshes = _checked(mesh_x, mesh_y, settings)
    shapes, inputs = _given(meshes, "preserve", None, None, None)
    return _attempted(shapes, inputs, settings, _Host(cache, cache))


def _cut(match: Match, mesh_x: Mesh, mesh_y: Mesh) -> Match:
    """Without padding."""
    return match.without_padding(len(mesh_x.vertices), len(mesh_y.vertices))


def _attempted(
    shapes: Mapping[str, _Shape], inputs: MatchInputs, settings: Settings, host: _Host
) -> PairState:
    """All attempts of the first shape and the last, which may be one; padded."""
    host.say("spectra")
    started = perf_counter()
    surfaces = [shape.surface for shape in shapes.values()]
    k = settings.eigenpairs(min(len(mesh.vertices) for mesh in surfaces))
    sizes = padded_shapes(k, [(len(m.vertices), len(m.faces)) for m in surfaces])
    given = padded_inputs(inputs, sizes)
    # Threads for the spectra, and two that compile. The limit is set around all: one
    # set and lifted by each of them would be left behind.
    threads = ThreadPoolExecutor(len(shapes) + 2)
    with threadpool_limits(1, user_api="blas"), threads as pool:
        # Two spectra with two threads each take longer than one after the other.
        alone, keep = len(shapes) == 1, host.keep_spectra
        specs = pool.map(
            lambda item: _basis(item[1], item[0], settings, keep, threads=alone),
            shapes.items(),
        )
        # Compiling or loading the programs takes as long as the spectra, or longer.
        like = [spectrum_like(size) for size in sizes]
        compiler = CompileOnly(host.keep_programs, pool, programs := [])
        like_pair = PairState((like[0], like[-1]), given)
        compile_first_attempt(like_pair, compiler, settings=settings)
        specs = [
            jax.tree.map(jnp.asarray, padded(spec, size))
            for spec, size in zip(specs, sizes, strict=True)
        ]
        if not all(program.ready() for program in programs):
            host.say("compiling, once for shapes of about this size")
    pair = PairState((specs[0], specs[-1]), given)
    pair.seconds["spectra"] = perf_counter() - started

    runner = OneByOne(host.keep_programs, host.progress)
    attempt_pairs([pair], runner, settings=settings)
    return pair


def _basis(
    shape: _Shape, name: str, settings: Settings, cache: bool, *, threads: bool = True
) -> Spectrum:
    mesh, whole = shape
    k = settings.eigenpairs(len(mesh.vertices))
    options = {"name": name, "cache": cache, "threads": threads}
    if whole is None:
        wound = without_holes(orient(denoised(mesh))) if len(mesh.faces) else mesh
        return spectrum_of_valid(wound, k, **options)
    spec = spectrum_of_valid(whole, k, laplacian="robust", **options)
    # Of the whole's other triangles, if it has any, the winding is unknown.
    return spec._replace(faces=mesh.faces)


def _partial(
    meshes: Mapping[str, Mesh],
    inputs: MatchInputs,
    T_yx: Any,
    same_unit: bool,
    settings: Settings,
    host: _Host,
) -> Match:
    """`match` with partial=True; T_yx is that of the initial map, if it has one."""
    for name, mesh in meshes.items():
        if len(mesh.faces) == 0:
            raise MeshError(
                f"{name}: has no faces, and partial=True cuts surfaces; triangulate it"
            )
    if not any(len(boundary_edges(mesh.faces)) for mesh in meshes.values()):
        shapes = {name: _Shape(mesh) for name, mesh in meshes.items()}
        match = _match(shapes, inputs, settings, host)
        ones = (jnp.ones(len(mesh.vertices)) for mesh in meshes.values())
        return _with_region(match, meshes, *ones)

    of_regions = replace(settings, retry_below=0.0)

    # A map tells the scale itself.
    if inputs.initial is None:
        check_one_unit(*meshes.values())

    def refine(part_x, part_y, T_xy, landmarks=None):
        host.say("refinement of a region")
        sizes = len(part_x.vertices), len(part_y.vertices)
        own = MatchInputs(
            checked_landmarks(landmarks, sizes),
            initial=checked_initial(T_xy, sizes),
            sign=inputs.sign,
        )
        parts = {"part of mesh_x": _Shape(part_x), "part of mesh_y": _Shape(part_y)}
        # The spectra of cuts on the way are never asked for again.
        quiet = host._replace(keep_spectra=False, progress=None)
        return _match(parts, own, of_regions, quiet)

    host.say("spectra")
    x, y = meshes.values()
    k = min(settings.eigenpairs(len(mesh.vertices)) for mesh in meshes.values())
    spec_x, spec_y = (
        jax.tree.map(
            jnp.asarray,
            truncate(_basis(_Shape(mesh), name, settings, host.keep_spectra), k),
        )
        for name, mesh in meshes.items()
    )
    initial = inputs.initial
    if initial is not None and initial.ndim == 2:
        C_yx = jnp.asarray(initial[:k, :k])
        initial = nearest(*embeddings(C_yx, spec_x.evecs, spec_y.evecs)).T_xy
    if T_yx is not None:
        T_yx = checked_initial(T_yx, (len(y.vertices), len(x.vertices)))
    rows = None if inputs.landmarks is None else np.stack(inputs.landmarks, 1)
    parts = match_parts(
        x,
        y,
        refine,
        inputs.sign,
        T_xy=initial,
        T_yx=T_yx,
        landmarks=rows,
        descriptors=inputs.descriptors,
        same_unit=same_unit,
        settings=settings.parts,
        progress=host.progress,
    )
    T_xy, T_yx, member_x, member_y = map(jnp.asarray, parts[:4])
    C_yx = functional_map(T_xy, spec_x, spec_y)
    certificate = jax.tree.map(jnp.asarray, parts.certificate)
    if inputs.landmarks is not None:
        # Of the whole shapes: one may be outside of the region that was found.
        at_x, at_y = inputs.landmarks
        pairs = settings.distance_pairs
        away = landmark_distances(T_xy[at_x], at_y, spec_y, distance_pairs=pairs)
        certificate = certificate._replace(landmarks=away.astype(C_yx.dtype))
    match = Match(T_xy, T_yx, C_yx, certificate)
    return _with_region(match, meshes, member_x, member_y)


def _with_region(
    match: Match, meshes: Mapping[str, Mesh], member_x: Array, member_y: Array
) -> Match:
    """The match with what both shapes share, from the membership of each vertex."""
    inside = member_x > 0.5, member_y > 0.5
    areas = (jnp.asarray(vertex_areas(*mesh)) for mesh in meshes.values())
    share_x, share_y = (
        jnp.sum(jnp.where(own, area, 0)) / jnp.sum(area)
        for area, own in zip(areas, inside, strict=True)
    )
    return match._replace(
        matched_x=inside[0],
        matched_y=inside[1],
        membership_x=member_x,
        membership_y=member_y,
        overlap_x=share_x,
        overlap_y=share_y,
    )

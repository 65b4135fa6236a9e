"""Two meshes -> Match: what is given is checked, then matched. Host side."""

from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Float, Int

from jfsf.convert import HasMaps
from jfsf.initial import orientation_sign
from jfsf.initial._search import Orientation
from jfsf.matching._arguments import (
    MatchInputs,
    checked_descriptors,
    checked_initial,
    checked_landmarks,
)
from jfsf.matching._attempted import Host, attempted
from jfsf.matching._pairs import PairState
from jfsf.matching._partial import match_partial
from jfsf.matching._rivals import DISTINCT, map_distances
from jfsf.matching._settings import Settings
from jfsf.matching._shapes import (
    MatchedShape,
    check_matchable,
    checked,
    shape_of,
    tells_left_from_right,
)
from jfsf.mesh import MeshError
from jfsf.types import ArrayLike, Match, Mesh


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
        orientation: "preserve" asks for the map that preserves left and right (faces
            are wound outward first), "reverse" for the map that mirrors, "any" for the
            better of both. Of a point cloud the surface is reconstructed first
            (`jfsf.mesh.reconstruct`); if it has no clear outside, "any" is used.
        landmarks: (l, 2) integers, rows of a vertex of X and a vertex of Y, from 0,
            that are known to correspond; one row decides a flip. A landmark that does
            not fit the others is not obeyed, see `Certificate.landmarks`. No rows are
            as None.
        descriptors: two matrices, one row for each vertex of X and of Y. Column i of
            one corresponds to column i of the other, in any unit and sign. They replace
            the wave kernel signature, or are used beside it with
            `FeatureSettings(keep_wks=True)`; curvature is always used.
        initial: a functional map C_yx in the eigenbases of `basis`, a point-to-point
            map T_xy, or a record with T_xy such as `Maps` or `Match`. It replaces the
            search, and its own orientation is kept, whatever `orientation` says. Of
            C_yx only the leading block of `Settings.ks[0]` functions is read, 30 by
            default. The map is kept, but others are tried on coarse copies, and one
            that fits as well lowers the confidence. `Settings(retry_below=0)` tries no
            others.
        partial: whether one shape is a part of the other, or both overlap. Both must be
            meshes; see `same_unit` for their sizes. Landmarks and descriptors guide the
            search for the region; the refinement within it does not use descriptors. An
            initial map replaces that search: it is converted to T_xy, the ratio of
                sizes
            is read from it, as far as `same_unit` allows, and no other start is tried.
            Cuts change the sizes of arrays, so this runs on the host and cannot be
            traced. It takes one to three and a half times as long. Two closed surfaces
            share everything.
        same_unit: with `partial`, whether both shapes are in one unit. If so, bodies
            may differ in size by a factor of 1.5. If not, sizes are ignored: X is
            scaled to the length of Y, and 0.4 to 2.5 times that is tried, which takes
            longer and is less reliable. Sizes of whole shapes never matter.
        settings: parameters of each stage, and its functions, converters included.
        cache: keep spectra and compiled programs on disk (`jfsf.storage.folder`).
        progress: called with the name of each stage as it begins.

    Returns:
        T_xy, T_yx, C_yx, the certificate, the confidence of each vertex, in jax's
        default precision, and which starts were attempted (`jfsf.types.MatchInfo`).
        With `partial` there are memberships, matched vertices and the matched shares of
        both areas, in place of the confidence of vertices and the starts. The
        certificate is then that of the overlap; its gap is the log odds minus those of
        the next map that was refined, and its confidence is nan unless `same_unit`. A
        vertex that is not matched has the image nearest to it after the deformation.

    Raises:
        MeshError: a mesh that cannot be matched, with the reason.
        ValueError: landmarks, descriptors or an initial map that do not fit the meshes,
            an unknown orientation, or with `partial` no overlap found, or shapes whose
            sizes differ by 12 times or more, as in millimetres and in metres, with
            `same_unit`.
    """
    meshes = checked(mesh_x, mesh_y, settings)
    host = Host(cache, cache, progress)
    if partial:
        inputs = _inputs(meshes, orientation, landmarks, descriptors, initial)
        T_yx = getattr(initial, "T_yx", None)
        return match_partial(meshes, inputs, T_yx, same_unit, settings, host)
    given = _given(meshes, orientation, landmarks, descriptors, initial)
    return attempted(*given, settings, host).result(settings)


def alternatives(
    mesh_x: Mesh,
    mesh_y: Mesh,
    *,
    orientation: Orientation = "preserve",
    landmarks: Int[ArrayLike, "l 2"] | None = None,
    descriptors: tuple[Float[ArrayLike, "n_x d"], Float[ArrayLike, "n_y d"]]
    | None = None,
    min_distance: float = DISTINCT,
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
            a more confident one (`map_distances` in `jfsf.matching._rivals`). 0 keeps
            the maps of all attempts.

    Returns:
        The match of each attempt, in the form that `match` returns; the first is the
        match that `match` itself returns. `Match.info` says which attempt each is
        (`won`) and where its start came from (`start`).

    Raises:
        MeshError, ValueError: as `match`.
    """
    meshes = checked(mesh_x, mesh_y, settings)
    given = _given(meshes, orientation, landmarks, descriptors, None)
    pair = attempted(*given, settings, Host(cache, cache, progress))
    matches = pair.results(settings)
    confidence = [float(match.certificate.confidence) for match in matches]
    order = np.argsort(-np.nan_to_num(confidence, nan=-1.0), kind="stable").tolist()
    order.remove(pair.won)
    apart = map_distances(matches, pair.spectra)
    kept = [pair.won]
    for i in order:
        if min_distance <= 0 or apart[i, kept].min() >= min_distance:
            kept.append(i)
    sizes = [len(mesh.vertices) for mesh in meshes.values()]
    return [matches[i].without_padding(*sizes) for i in kept]


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
    shape = shape_of(mesh)
    if len(shape.surface.faces) == 0:
        raise MeshError(
            f"mesh has {len(mesh.vertices)} vertices and no faces, and a point "
            "cloud without a clear outside no left and right",
            "triangulate it",
            "symmetry",
        )
    inputs = MatchInputs(sign=orientation_sign("reverse"), self_map=True)
    pair = attempted({"mesh": shape}, inputs, settings, Host(cache, cache))
    return pair.result(settings)


def attempted_pair(
    mesh_x: Mesh,
    mesh_y: Mesh,
    *,
    settings: Settings = Settings(),
    cache: bool = True,
) -> PairState:
    """Every attempt of `match` on a pair, for studies of starts and of evidence.

    Args:
        mesh_x, mesh_y, settings, cache: as `match`.

    Returns:
        The attempts on the padded shapes, and those on their coarse copies.

    Raises:
        MeshError: as `match`.
    """
    meshes = checked(mesh_x, mesh_y, settings)
    shapes, inputs = _given(meshes, "preserve", None, None, None)
    return attempted(shapes, inputs, settings, Host(cache, cache))


def _given(
    meshes: Mapping[str, Mesh], orientation, landmarks, descriptors, initial
) -> tuple[dict[str, MatchedShape], MatchInputs]:
    """Both shapes, and what was given with them, checked."""
    orientation_sign(orientation)  # a wrong word is an error of any pair
    shapes = {name: shape_of(mesh) for name, mesh in meshes.items()}
    if not all(tells_left_from_right(shape) for shape in shapes.values()):
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

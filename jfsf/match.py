"""Two meshes -> Match, the whole way: spectra, search, refinement, conversion."""

from concurrent.futures import ThreadPoolExecutor
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int
from threadpoolctl import threadpool_limits

from jfsf.certificate import certify
from jfsf.compiling import kept_call
from jfsf.convert import brief, brief_nearest, sinkhorn
from jfsf.descriptors import hks, wks
from jfsf.fmap import embeddings, functional_map, truncate, uniform
from jfsf.hypotheses import Seen
from jfsf.mesh import MeshError, orient, validate
from jfsf.padding import bucket, pad
from jfsf.refine import arap, zoomout
from jfsf.sampling import restrict, tile_points
from jfsf.search import (
    HYPOTHESES,
    SECOND,
    Orientation,
    check_search,
    search_seen,
    way_of,
)
from jfsf.sides import both
from jfsf.spectrum import spectrum
from jfsf.tiles import spectral_tiles
from jfsf.types import Certificate, Match, Mesh, Spectrum, Tiles

K = 128  # eigenpairs a shape; more make a better map before `arap`, hardly after it
# The rounds in place, where descriptors weigh most, clean the start up. Finer schedules
# slide further from it; coarser ones are as good once `arap` has followed.
KS = (30,) * 4 + (45, 65, 110, K)
EVERY = 5  # one WKS energy in so many: neighbours say nearly the same
TILED = 2000  # vertices above which neighbours are searched among candidates
LARGE = 20_000  # vertices above which C_yx is refined on samples
REFINED = 4000  # samples, up to twice as many


def match(
    mesh_x: Mesh,
    mesh_y: Mesh,
    *,
    orientation: Orientation = "preserve",
    landmarks: Int[Array, "l 2"] | None = None,
    hypotheses: int = HYPOTHESES,
    cache: bool = True,
) -> Match:
    """Point-to-point maps between two shapes, both ways, from the meshes alone.

    Args:
        mesh_x, mesh_y: one connected component each, any units and sizes, 160 vertices
            or more; a mesh without faces is a point cloud.
        orientation: "preserve" asks for the map that keeps left and right (faces are
            wound outward first), "reverse" for its mirror image, "any" for the best of
            both. Point clouds have no orientation: for them it is always "any".
        landmarks: rows (vertex of X, vertex of Y) known to correspond; one row decides
            a flip.
        hypotheses: how many functional maps the search tries; see `search`.
        cache: keep spectra on disk between calls, and the program where jax keeps its
            own (`JAX_COMPILATION_CACHE_DIR`).

    Returns:
        T_xy, T_yx, C_yx and the certificate, in jax's default precision.

    Raises:
        MeshError: a mesh that cannot be matched, with the reason.
        ValueError: bad landmarks, too few hypotheses, or an unknown orientation.
    """
    _check("mesh_x", mesh_x)
    _check("mesh_y", mesh_y)
    n_x, n_y = len(mesh_x.vertices), len(mesh_y.vertices)
    pairs = _landmarks(landmarks, n_x, n_y)
    if len(mesh_x.faces) == 0 or len(mesh_y.faces) == 0:
        orientation = "any"
    spec_x, spec_y = common(*_bases(mesh_x, mesh_y, cache))
    way = way_of(orientation)
    spec_x, spec_y = _on_device(spec_x, spec_y)
    found = _run(spec_x, spec_y, pairs, way, False, hypotheses, cache)
    return found._replace(T_xy=found.T_xy[:n_x], T_yx=found.T_yx[:n_y])


def symmetry(mesh: Mesh, *, hypotheses: int = HYPOTHESES, cache: bool = True) -> Match:
    """The map of a shape to itself that swaps left and right.

    The best map that reverses orientation and moves the shape's points. A shape without
    such a symmetry gets its least bad one.

    Args:
        mesh, hypotheses, cache: as `match`; with faces.

    Returns:
        As `match`, X and Y the mesh: T_xy and T_yx both are the symmetry, found in
        either direction, and agree up to near vertices.

    Raises:
        MeshError: as `match`, and a point cloud, which has no left and right.
        ValueError: too few hypotheses.
    """
    _check("mesh", mesh)
    n = len(mesh.vertices)
    if len(mesh.faces) == 0:
        raise MeshError(
            f"symmetry: mesh has {n} vertices and no faces, and a point cloud no left "
            "and right; triangulate it"
        )
    (spec,) = _on_device(basis(mesh, cache=cache))
    found = _run(spec, spec, None, way_of("reverse"), True, hypotheses, cache)
    return found._replace(T_xy=found.T_xy[:n], T_yx=found.T_yx[:n])


def basis(mesh: Mesh, *, name: str = "mesh", cache: bool = True) -> Spectrum:
    """The spectrum that `match` gives a shape, whatever it is matched with.

    Args:
        mesh: as `match` takes it; its faces are wound outward first.
        name, cache: as `spectrum`.

    Returns:
        As `spectrum`, with `K` eigenpairs, fewer for fewer than 4 `K` vertices.

    Raises:
        MeshError: as `match`.
    """
    _check(name, mesh)
    wound = orient(mesh) if len(mesh.faces) else mesh
    # The upper quarter of a mesh's spectrum says more of its triangles than its shape.
    k = max(SECOND[-1], min(K, len(mesh.vertices) // 4))
    return spectrum(wound, k, name=name, cache=cache)


def common(spec_x: Spectrum, spec_y: Spectrum) -> tuple[Spectrum, Spectrum]:
    """Both, cut to as many eigenpairs: `match_spectra` wants as many of each."""
    k = min(len(spec_x.evals), len(spec_y.evals))
    return truncate(spec_x, k), truncate(spec_y, k)


def match_spectra(
    spec_x: Spectrum,
    spec_y: Spectrum,
    landmarks: Int[Array, "l 2"] | None = None,
    *,
    orientation: Orientation | Int[Array, ""] = "preserve",
    hypotheses: int = HYPOTHESES,
    itself: Bool[Array, ""] | bool = False,
) -> Match:
    """`match` from the spectra on: pure, so it vmaps over pairs of equal size.

    Args:
        spec_x, spec_y: 40 eigenpairs or more, as many of each; mass 0 is padding.
            Neighbours are searched among candidates above `TILED` vertices, and C_yx
            is refined on samples above `LARGE`.
        landmarks, hypotheses: as `match`.
        orientation, itself: as `search`; neither compiles anew.
    """
    way = way_of(orientation)
    return _match_spectra(spec_x, spec_y, landmarks, way, itself, hypotheses=hypotheses)


@partial(jax.jit, static_argnames="hypotheses")
def _match_spectra(spec_x, spec_y, landmarks, way, itself, *, hypotheses):
    check_search(spec_x, spec_y, hypotheses)
    at_x, at_y = (None, None) if landmarks is None else landmarks.T
    look_x, look_y = both(
        lambda spec, at: Seen.of(spec, _descriptors(spec, at), itself),
        (spec_x, at_x),
        (spec_y, at_y),
    )
    found = search_seen(look_x, look_y, way, itself, hypotheses=hypotheses)
    widest = min(len(spec_x.evals), len(spec_y.evals))
    ks = tuple(min(k, widest) for k in KS)
    # Point clouds have no orientation; nan must not reach the embeddings.
    turned = jnp.sign(jnp.nan_to_num(found.orientation[0]))
    start = (
        found.C_yx[0],
        look_x.extra,
        look_y.extra,
        turned * look_x.field,
        look_y.field,
    )
    tiles = seen_tiles = _tiles(spec_x, spec_y)
    seen_x, seen_y = spec_x, spec_y
    if max(len(spec_x.mass), len(spec_y.mass)) > LARGE:
        at_x, at_y = (
            tile_points(spec, num=min(REFINED, len(spec.mass)))
            for spec in (spec_x, spec_y)
        )
        seen_x, seen_y = restrict(spec_x, at_x), restrict(spec_y, at_y)
        C_yx, extra_x, extra_y, field_x, field_y = start
        start = C_yx, extra_x[at_x], extra_y[at_y], field_x[at_x], field_y[at_y]
        seen_tiles = _tiles(seen_x, seen_y)
    C_yx = zoomout(
        seen_x,
        seen_y,
        *start,
        ks=ks,
        converter=brief,
        weighted=True,
        tiles=seen_tiles,
    )
    emb_x, emb_y = embeddings(C_yx, spec_x.evecs, spec_y.evecs, space="direct")
    marginals = uniform(spec_x.mass), uniform(spec_y.mass)
    if len(spec_x.faces) and len(spec_y.faces):
        maps = brief_nearest(emb_x, emb_y, *marginals, tiles=tiles)
        handed = jnp.where(turned < 0, -1.0, 1.0)
        emb_x, emb_y = arap(
            spec_x, spec_y, maps, handed, converter=brief_nearest, tiles=tiles
        )
    filtered = sinkhorn(emb_x, emb_y, *marginals, tiles=tiles)
    C_yx = functional_map(filtered.T_xy, truncate(spec_x, widest), spec_y)
    gap = found.energy[1] / found.energy[0] - 1
    certificate = certify(filtered, emb_x, emb_y, C_yx, spec_x, spec_y, gap)
    return Match(filtered.T_xy, filtered.T_yx, C_yx, certificate)


def _descriptors(spec: Spectrum, landmarks) -> Array:
    desc = wks(spec)[:, ::EVERY]
    if landmarks is None:
        return desc
    # Heat from a landmark is positive up to the cut of the spectrum.
    return jnp.concatenate([desc, jnp.maximum(hks(spec, landmarks, num=10), 0)], 1)


def _run(spec_x, spec_y, landmarks, way, itself, hypotheses: int, cache: bool) -> Match:
    return kept_call(
        _match_spectra,
        *(spec_x, spec_y, landmarks, way, itself),
        records=(Spectrum, Match, Certificate),
        keep=cache,
        hypotheses=hypotheses,
    )


def _tiles(spec_x: Spectrum, spec_y: Spectrum) -> tuple[Tiles, Tiles] | None:
    if max(len(spec_x.mass), len(spec_y.mass)) <= TILED:
        return None
    return both(spectral_tiles, (spec_x,), (spec_y,))


def _check(name: str, mesh: Mesh) -> None:
    validate(mesh, k=SECOND[-1], name=name)


def _bases(mesh_x: Mesh, mesh_y: Mesh, cache: bool) -> list[Spectrum]:
    one = lambda name, mesh: basis(mesh, name=name, cache=cache)
    names, meshes = ("mesh_x", "mesh_y"), (mesh_x, mesh_y)
    # The limit is set around both, for two threads that set and lift their own would
    # leave it behind.
    with threadpool_limits(1, user_api="blas"), ThreadPoolExecutor(2) as pool:
        return list(pool.map(one, names, meshes))


def _on_device(*specs: Spectrum) -> list[Spectrum]:
    # Padded first: what is done to jax arrays of each size compiles for each size.
    # A closed surface has two faces a vertex.
    sizes = [(bucket(len(s.mass)), bucket(len(s.faces), 1024)) for s in specs]
    most = tuple(map(max, zip(*sizes, strict=True)))
    # One size for both is half the program, but far apart it is twice the work.
    if most[0] <= 2 * min(n for n, _ in sizes):
        sizes = [most] * len(specs)
    padded = (pad(spec, *size) for spec, size in zip(specs, sizes, strict=True))
    return [jax.tree.map(jnp.asarray, spec) for spec in padded]


def _landmarks(landmarks, n_x: int, n_y: int):
    if landmarks is None:
        return None
    pairs = np.asarray(landmarks)
    if pairs.ndim != 2 or pairs.shape[1] != 2 or len(pairs) == 0:
        raise ValueError(
            f"match: landmarks have shape {pairs.shape}; give rows (vertex of X, "
            "vertex of Y)"
        )
    if not np.issubdtype(pairs.dtype, np.integer):
        raise ValueError(f"match: landmarks are {pairs.dtype}; give vertex numbers")
    for column, n, name in ((0, n_x, "mesh_x"), (1, n_y, "mesh_y")):
        low, high = pairs[:, column].min(), pairs[:, column].max()
        if low < 0 or high >= n:
            raise ValueError(
                f"match: landmarks name vertices {low} to {high} of {name}, which has "
                f"vertices 0 to {n - 1}"
            )
    return jnp.asarray(pairs, jnp.int32)

"""Two meshes -> Match, the whole way. Host side: checks, spectra, one program."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int
from threadpoolctl import threadpool_limits

from jfsf.compiling import ready
from jfsf.fmap import truncate
from jfsf.mesh import MeshError, orient, validate
from jfsf.padding import bucket, pad
from jfsf.pipeline import K, match_spectra
from jfsf.search import HYPOTHESES, SECOND, Orientation, way_of
from jfsf.spectrum import spectrum
from jfsf.types import Certificate, Match, Mesh, Spectrum


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
    meshes = {"mesh_x": mesh_x, "mesh_y": mesh_y}
    rest = pairs, way_of(orientation), False
    found = _match(meshes, *rest, hypotheses=hypotheses, cache=cache)
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
    rest = None, way_of("reverse"), True
    found = _match({"mesh": mesh}, *rest, hypotheses=hypotheses, cache=cache)
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
    return spectrum(wound, _eigenpairs(mesh), name=name, cache=cache)


def common(spec_x: Spectrum, spec_y: Spectrum) -> tuple[Spectrum, Spectrum]:
    """Both, cut to as many eigenpairs: `match_spectra` wants as many of each."""
    k = min(len(spec_x.evals), len(spec_y.evals))
    return truncate(spec_x, k), truncate(spec_y, k)


def _match(meshes: dict[str, Mesh], *rest, hypotheses: int, cache: bool) -> Match:
    """Of the first mesh and the last; rest: what `_matched` takes beside spectra."""
    one = lambda name: basis(meshes[name], name=name, cache=cache)
    sizes = _sizes(*meshes.values())
    like = [_like(*size) for size in sizes]
    # The limit is set around all, for threads that set and lift their own would leave
    # it behind.
    with threadpool_limits(1, user_api="blas"), ThreadPoolExecutor(2) as pool:
        specs = pool.map(one, meshes)
        # To compile it, or to load it, takes as long as the spectra or longer.
        run = _program(like[0], like[-1], *rest, hypotheses=hypotheses, keep=cache)
        padded = [_padded(*each) for each in zip(specs, sizes, strict=True)]
    return run(padded[0], padded[-1], *rest)


def _program(*args, hypotheses: int = HYPOTHESES, keep: bool = False) -> Callable:
    records = Spectrum, Match, Certificate
    return ready(_matched, *args, records=records, keep=keep, hypotheses=hypotheses)


def _matched(spec_x, spec_y, landmarks, way, itself, *, hypotheses):
    options = {"itself": itself, "hypotheses": hypotheses}
    return match_spectra(spec_x, spec_y, landmarks, orientation=way, **options)


def _sizes(*meshes: Mesh) -> list[tuple[int, int, int]]:
    """Eigenpairs, vertices and faces of each, padded: all that it compiles for."""
    k = min(map(_eigenpairs, meshes))
    # A closed surface has two faces a vertex.
    sizes = [(bucket(len(m.vertices)), bucket(len(m.faces), 1024)) for m in meshes]
    most = tuple(map(max, zip(*sizes, strict=True)))
    # One size for both is half the program, but far apart it is twice the work.
    if most[0] <= 2 * min(n for n, _ in sizes):
        sizes = [most] * len(meshes)
    return [(k, n, m) for n, m in sizes]


def _like(k: int, n: int, m: int) -> Spectrum:
    """A spectrum's shapes, before its values are there."""
    return jax.eval_shape(
        lambda: Spectrum(
            jnp.zeros(k),
            jnp.zeros((n, k)),
            jnp.zeros(n),
            jnp.zeros((m, 3), jnp.int32),
            jnp.zeros((n, 3)),
        )
    )


def _padded(spec: Spectrum, size: tuple[int, int, int]) -> Spectrum:
    # On the host: what is done to jax arrays of each size compiles for each size.
    k, n, m = size
    return jax.tree.map(jnp.asarray, pad(truncate(spec, k), n, m))


def _eigenpairs(mesh: Mesh) -> int:
    # The upper quarter of a mesh's spectrum says more of its triangles than its shape.
    return max(SECOND[-1], min(K, len(mesh.vertices) // 4))


def _check(name: str, mesh: Mesh) -> None:
    validate(mesh, k=SECOND[-1], name=name)


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

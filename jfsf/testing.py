"""Hypothesis strategies for shapes, and changes with a known effect on their map.

For tests only: it needs hypothesis, from the extra jfsf[test]. Sizes are arguments and
are not drawn, so jitted code under test compiles once. Whatever is drawn shrinks to
seed 0.
"""

from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import trimesh
from hypothesis import strategies as st
from jaxtyping import Array, Float, Int

from jfsf.mesh._edit import mirror_image
from jfsf.spectral import spectrum
from jfsf.types import Maps, Mesh, Spectrum

seeds = st.integers(0, 2**31 - 1)


def blob(seed: int = 0, *, subdivisions: int = 2) -> Mesh:
    """A closed bumpy ellipsoid without symmetry, wound outward.

    10 * 4^subdivisions + 2 vertices: 42, 162, 642, 2562.
    """
    ball = trimesh.creation.icosphere(subdivisions=subdivisions)
    v, rng = np.array(ball.vertices), np.random.default_rng(seed)
    waves, height = rng.normal(size=(3, 4)), rng.normal(size=4)
    # Low enough that the surface never folds over.
    bumps = 0.4 * np.sin(2 * v @ waves) @ height / np.abs(height).sum()
    faces = np.array(ball.faces, np.int32)
    return Mesh(v * (1 + bumps)[:, None] * [1.0, 1.4, 2.0], faces)


def meshes(*, subdivisions: int = 2) -> st.SearchStrategy[Mesh]:
    """Blobs of one size."""
    return seeds.map(lambda seed: blob(seed, subdivisions=subdivisions))


def spectra(k: int, *, subdivisions: int = 2) -> st.SearchStrategy[Spectrum]:
    """Spectra of blobs of one size: jax arrays in the default precision."""
    # Eigenpairs take long, so there are eight shapes, each computed once.
    return st.integers(0, 7).map(lambda seed: blob_spectrum(seed, k, subdivisions))


@cache
def blob_spectrum(seed: int, k: int, subdivisions: int = 2) -> Spectrum:
    """Spectrum of a blob: jax arrays in the default precision of the first call."""
    found = spectrum(blob(seed, subdivisions=subdivisions), k, cache=False)
    return cast(found, jnp.zeros(0).dtype)


@st.composite
def point_sets(draw: Any, n: int, k: int) -> Float[np.ndarray, "n k"]:
    """n points in k dimensions: in general position, with ties, or with duplicates."""
    rng = np.random.default_rng(draw(seeds))
    kind = draw(st.sampled_from(("normal", "lattice", "repeated")))
    if kind == "lattice":
        return rng.integers(-2, 3, (n, k)).astype(float)
    points = rng.normal(size=(n, k))
    return points[rng.integers(n, size=n)] if kind == "repeated" else points


@st.composite
def embedding_pairs(
    draw: Any, n_x: int, n_y: int, k: int
) -> tuple[Float[np.ndarray, "n_x k"], Float[np.ndarray, "n_y k"]]:
    """Samples of one smooth surface in k dimensions, as two aligned shapes give."""
    rng = np.random.default_rng(draw(seeds))
    waves, phase = rng.normal(size=(2, k)) * 2, rng.uniform(0, 6, k)
    noise = draw(st.sampled_from((0.0, 0.05)))

    def sample(n):
        curved = np.sin(rng.uniform(-1, 1, (n, 2)) @ waves + phase)
        return curved + noise * rng.normal(size=(n, k))

    return sample(n_x), sample(n_y)


def permutations(n: int) -> st.SearchStrategy[Int[np.ndarray, " n"]]:
    """Orders of n vertices."""
    return seeds.map(lambda seed: np.random.default_rng(seed).permutation(n))


def signs(k: int) -> st.SearchStrategy[Float[np.ndarray, " k"]]:
    """Signs of k eigenvectors, the constant's kept."""
    flips = lambda seed: np.random.default_rng(seed).choice((-1.0, 1.0), k - 1)
    return seeds.map(lambda seed: np.concatenate([[1.0], flips(seed)]))


@st.composite
def motions(draw: Any) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"]]:
    """Rigid motions: a rotation that keeps orientation, and a shift."""
    rng = np.random.default_rng(draw(seeds))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return turn * np.sign(np.linalg.det(turn)), rng.normal(size=3)


def move(mesh: Mesh, motion: tuple[Any, Any], *, unit: float = 1.0) -> Mesh:
    """The mesh turned, shifted, then measured in another unit."""
    turn, shift = motion
    return mesh._replace(vertices=unit * (mesh.vertices @ turn.T + shift))


def mirror(mesh: Mesh) -> Mesh:
    """The mirror image in x, with faces wound as before: outward stays outward.

    Vertex i and face i keep their numbers.
    """
    return mirror_image(mesh)


def relabel(mesh: Mesh, order: Int[np.ndarray, " n"]) -> Mesh:
    """The same surface, vertex i being the old vertex order[i]."""
    place = np.argsort(order).astype(np.int32)
    return Mesh(mesh.vertices[order], place[mesh.faces])


def relabel_spectrum(spec: Spectrum, order: Int[np.ndarray, " n"]) -> Spectrum:
    """The spectrum of `relabel(mesh, order)`, eigenvectors and all."""
    place = jnp.asarray(np.argsort(order), jnp.int32)
    return spec._replace(
        evecs=spec.evecs[order],
        mass=spec.mass[order],
        faces=place[spec.faces],
        vertices=spec.vertices[order],
    )


def relabel_maps(
    maps: Any, order_x: Int[np.ndarray, " n_x"], order_y: Int[np.ndarray, " n_y"]
) -> Maps:
    """The maps of a pair after X and Y were relabelled."""
    place_x, place_y = np.argsort(order_x), np.argsort(order_y)
    T_xy, T_yx = np.asarray(maps.T_xy), np.asarray(maps.T_yx)
    return Maps(place_y[T_xy[order_x]], place_x[T_yx[order_y]])  # type: ignore


def flip_signs(spec: Spectrum, by: Float[np.ndarray, " k"]) -> Spectrum:
    """Eigenvectors times `by`: another basis of the same shape."""
    return spec._replace(evecs=spec.evecs * jnp.asarray(by, spec.evecs.dtype)[None])


def flip_map(
    C_yx: Float[Array, "k_x k_y"],
    by_x: Float[np.ndarray, " k_x"],
    by_y: Float[np.ndarray, " k_y"],
) -> Float[Array, "k_x k_y"]:
    """C_yx of the same map in bases flipped by `by_x` and `by_y`."""
    return C_yx * jnp.asarray(by_x[:, None] * by_y[None], C_yx.dtype)


def cast(spec: Spectrum, dtype: Any = jnp.float64) -> Spectrum:
    """The spectrum as jax arrays, its reals in `dtype`."""
    real = Spectrum(*(jnp.asarray(a, dtype) for a in spec))
    return real._replace(faces=jnp.asarray(spec.faces, jnp.int32))


def stack(records: list[Any]) -> Any:
    """Records of equal shapes as one batch, for vmap."""
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *records)

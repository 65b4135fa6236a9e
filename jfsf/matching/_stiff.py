"""What is left after a similarity, as a smooth field of few degrees of freedom.

Bones and teeth of other animals differ as a whole: they are longer, thicker, turned in
themselves. Free bending lets the smooth parts slide there; a thin plate does not. Over
the displacement u of a shape X that lies on Y already,

    E(u) = sum_s w_s ((n_s . r_s)^2 + f |r_s|^2) + stiffness J(u),
    r_s = p_s + u(p_s) - q_s,

with samples p_s of X and their nearest points q_s of Y, and samples of Y and their
nearest points of X, the normals n_s of Y, and weights w_s that fall off with the
distance. J is the bending energy of a thin-plate spline in space,

    u(p) = A p + b - sum_c v_c |p - c|,  J(u) = - sum_cd v_c . v_d |c - d|

(Duchon 1977; Bookstein, Principal warps, PAMI 1989): affine maps are free. Of a spline
on some vertices only the fields of least energy are taken, the first principal warps.
Nearest points and u are found in turn, and the stiffness falls meanwhile, as in Chui
and Rangarajan (A new point matching algorithm, CVIU 2003). Host side (numpy, scipy).
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy.linalg import eigh
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist

from jfsf.mesh._geometry import vertex_areas, vertex_normals
from jfsf.types import Mesh

# In sqrt(area), at last; chosen by `experiments/fit/fit_rigid.py`. The other numbers
# are set by hand: on heel bones and molars half and twice as much are as good.
STIFFNESS = 3e-4
AT_FIRST = 100.0  # times as stiff at first
REACH = 0.05  # distance at which a nearest point counts 1 / e; half is worse
NORMAL_WEIGHT = 0.1  # distance that normals at an angle of 1 count for
FREE = 0.1  # f, what a distance along the surface counts beside one off it
CENTRES, WARPS = 200, 60  # c, and principal warps of these
SAMPLES, POINTS = 600, 5000  # s of each shape; of X, those that may be nearest
ROUNDS, AT_LAST = 20, 6  # in all, and those of the last stiffness
ROWS = 100_000  # vertices at a time


def nearest_alike(moved: Mesh, target: Mesh, *, mirrors: bool) -> np.ndarray:
    """(n,) the vertex of a shape nearest to each of one laid on it that faces alike."""
    signs = -1 if mirrors else 1, 1
    moved_rows, rows = (
        np.hstack([mesh.vertices, sign * NORMAL_WEIGHT * vertex_normals(*mesh)])
        for mesh, sign in zip((moved, target), signs, strict=True)
    )
    return np.asarray(KDTree(rows).query(moved_rows)[1])


def stiffly_onto(
    mesh: Mesh,
    laid: Float[np.ndarray, "n 3"],
    target: Mesh,
    *,
    mirrors: bool,
    stiffness: float = STIFFNESS,
) -> Float[np.ndarray, "n 3"]:
    """Where the vertices of a shape lie that is deformed onto another.

    Args:
        mesh: the shape at rest, of area 1.
        laid: its vertices, laid on the other by a similarity.
        target: the other, of area 1.
        mirrors: whether the similarity swaps left and right.
        stiffness: of the field, in sqrt(area).
    """
    points, some = _some(mesh, POINTS), _some(target, SAMPLES)
    warps, energy = principal_warps(mesh.vertices[points], _centres(mesh, points))
    basis, start = warps(mesh.vertices[points]), laid[points]
    # The field is smooth: normals turn little.
    side = -1 if mirrors else 1
    normal = side * NORMAL_WEIGHT * vertex_normals(laid, mesh.faces)[points]
    normal_y = vertex_normals(target.vertices, target.faces)
    goal = np.hstack([target.vertices, NORMAL_WEIGHT * normal_y])
    near, own = KDTree(goal), slice(SAMPLES)
    shares = _shares(mesh, points[own]), _shares(target, some)
    coefficients, falls = np.zeros((len(energy), 3)), ROUNDS - AT_LAST
    for turn in range(ROUNDS):
        now = np.hstack([start + basis @ coefficients, normal])
        queries = (near, now[own]), (KDTree(now), goal[some])
        (away, there), (away_y, here) = (
            map(np.asarray, tree.query(rows)) for tree, rows in queries
        )
        of_x = np.concatenate([np.arange(len(there)), here])
        of_y = np.concatenate([there, some])
        share, far = np.concatenate(shares), np.concatenate([away, away_y])
        factor = stiffness * AT_FIRST ** max(1 - turn / falls, 0)
        coefficients = _solved(
            basis[of_x],
            target.vertices[of_y] - start[of_x],
            normal_y[of_y],
            share * np.exp(-((far / REACH) ** 2)),
            factor * energy,
        )
    # Many vertices at a time, since each has a distance to each centre.
    parts = np.array_split(mesh.vertices, -(-len(laid) // ROWS))
    return laid + np.concatenate([warps(part) @ coefficients for part in parts])


def principal_warps(
    points: np.ndarray, centres: np.ndarray
) -> tuple[Callable[[np.ndarray], np.ndarray], np.ndarray]:
    """The smoothest fields of thin-plate splines with these centres.

    Args:
        points: (n, 3), over which the fields have a mean square of 1.
        centres: (c, 3).

    Returns:
        A function that reads the fields at any points (q, 3), as (q, 4 + WARPS) or
        fewer, and the bending energy of each. The first four are affine, of none.
    """
    affine = lambda at: np.hstack([np.ones((len(at), 1)), at - points.mean(0)])
    # Weights v that no affine field can stand for: J is finite.
    free = np.linalg.qr(affine(centres), mode="complete")[0][:, 4:]
    bending = -free.T @ cdist(centres, centres) @ free
    fields = -cdist(points, centres) @ free
    trend = np.linalg.lstsq(affine(points), fields, rcond=None)[0]
    fields = fields - affine(points) @ trend
    square = fields.T @ fields / len(points)
    # Centres in one place have no field between them.
    square += 1e-9 * np.trace(square) / len(square) * np.eye(len(square))
    last = min(WARPS, len(square)) - 1
    energy, weight = eigh(bending, square, subset_by_index=(0, last))
    weight, trend = free @ weight, trend @ weight

    def warps(at: np.ndarray) -> np.ndarray:
        plain = affine(at)
        return np.hstack([plain, -cdist(at, centres) @ weight - plain @ trend])

    return warps, np.concatenate([np.zeros(4), np.maximum(energy, 0)])


def _solved(basis, goal, normal, weight, energy):
    """(k, 3) coefficients of the field of least energy E."""
    k = basis.shape[1]
    along = (basis[:, :, None] * normal[:, None]).reshape(len(basis), -1)
    weighted = weight[:, None] * basis
    system = FREE * basis.T @ weighted + np.diag(energy)
    system = along.T @ (weight[:, None] * along) + np.kron(system, np.eye(3))
    right = (weight * np.sum(normal * goal, 1)) @ along
    right = right + FREE * (weighted.T @ goal).ravel()
    # Flat shapes leave some affine maps without a meaning.
    system[np.diag_indices(3 * k)] += 1e-12 * np.trace(system)
    return np.linalg.solve(system, right).reshape(k, 3)


def _centres(mesh: Mesh, points: np.ndarray) -> np.ndarray:
    """Vertices far from each other."""
    among = mesh.vertices[points]
    away = np.linalg.norm(among - among.mean(0), axis=1)
    chosen = [int(np.argmax(away))]
    away = np.full(len(among), np.inf)
    for _ in range(min(CENTRES, len(among)) - 1):
        away = np.minimum(away, np.linalg.norm(among - among[chosen[-1]], axis=1))
        chosen.append(int(np.argmax(away)))
    return among[chosen]


def _some(mesh: Mesh, number: int) -> np.ndarray:
    """Numbers of some vertices."""
    return np.random.default_rng(0).permutation(len(mesh.vertices))[:number]


def _shares(mesh: Mesh, at: np.ndarray) -> np.ndarray:
    """How much each of some vertices counts: 1 in all."""
    area = vertex_areas(mesh.vertices, mesh.faces)[at]
    return area / area.sum()

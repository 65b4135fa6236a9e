"""The records that travel between the functions: NamedTuples of arrays.

`_xy` reads "from X to Y" everywhere. DESIGN notation: T_XY -> `T_xy`, C_YX -> `C_yx`.
"""

from typing import Any, NamedTuple

from jaxtyping import Array, Bool, Float, Int

# Host records hold numpy arrays, traced ones hold jax arrays; both are "arrays" here.
ArrayLike = Any


class Mesh(NamedTuple):
    """A triangle mesh, or a point cloud when it has no faces. Host side (numpy).

    vertices: (n, 3) float64, in the file's own units and order.
    faces: (m, 3) int32, 0-based; (0, 3) for a point cloud.
    """

    vertices: ArrayLike
    faces: ArrayLike


class Spectrum(NamedTuple):
    """The first k eigenpairs of the Laplace-Beltrami operator of a shape of area 1.

    evals: ascending, the first 0; on the shape scaled to unit area.
    evecs: mass-orthonormal, evecs.T @ diag(mass) @ evecs = I; the first is constant.
    mass: lumped vertex areas, they sum to 1; 0 marks padding.
    faces: wound outward, for orientation, curvature and `refine.arap`. (0, 3) for a
        point cloud. A padding face is (0, 0, 0).
    vertices: positions, centred, of the shape scaled to unit area, for curvature and
        `refine.arap`. 0 on padding.
    """

    evals: Float[Array, " k"]
    evecs: Float[Array, "n k"]
    mass: Float[Array, " n"]
    faces: Int[Array, "m 3"]
    vertices: Float[Array, "n 3"]


class Maps(NamedTuple):
    """A point-to-point map and one the other way.

    T_xy: the vertex of Y for each vertex of X.
    T_yx: the vertex of X for each vertex of Y.
    """

    T_xy: Int[Array, " n_x"]
    T_yx: Int[Array, " n_y"]


class Neighbours(NamedTuple):
    """k0 nearest points of the other set for each point, nearest first.

    idx: their indices; ties by lower index.
    dist: Euclidean distances; inf where there are fewer than k0 valid points.
    """

    idx: Int[Array, "n k0"]
    dist: Float[Array, "n k0"]


class Tiles(NamedTuple):
    """Points in compact groups of equal size, groups close in number close in space.

    member: the point in each slot.
    real: whether the slot is the point's own; it has one, or none if it takes no part.
        The other slots repeat points and are never chosen.
    """

    member: Int[Array, "t s"]
    real: Bool[Array, "t s"]


class Found(NamedTuple):
    """Neighbours both ways from a search among candidates.

    near_xy, near_yx: neighbours in Y of each point of X, and the other way.
    recall: share of the points compared with the exhaustive search whose nearest
        neighbour was found, or one no more than 0.1 % farther, in the worse direction;
        nan where none was compared.
    exhausted: whether that was too little, so that in such a direction all points were
        compared with all.
    """

    near_xy: Neighbours
    near_yx: Neighbours
    recall: Float[Array, ""]
    exhausted: Bool[Array, ""]


class Kernel(NamedTuple):
    """Sparse kernel K (n_x, n_y) in the log domain, each entry stored once.

    Row i holds its own k0 neighbours in Y (`idx_xy`); the entries that only a vertex
    of Y asked for stand in the other half (`idx_yx`). An absent entry has log weight
    -inf and index 0.
    """

    idx_xy: Int[Array, "n_x k0"]
    log_xy: Float[Array, "n_x k0"]
    idx_yx: Int[Array, "n_y k0"]
    log_yx: Float[Array, "n_y k0"]


class Filtered(NamedTuple):
    """What the Fast Sinkhorn Filter returns: both maps and the plan they come from.

    The plan is diag(exp f) K diag(exp g); its sums are the marginals.

    T_xy, T_yx: row and column argmax of the plan.
    kernel: K, sparse.
    f, g: log scalings; 0 on padding.
    marginal_error: l1 gap of the plan's row and column sums, as a fraction of all mass;
        0 is exact.
    empty_x, empty_y: number of vertices that no mass can reach.
    """

    T_xy: Int[Array, " n_x"]
    T_yx: Int[Array, " n_y"]
    kernel: Kernel
    f: Float[Array, " n_x"]
    g: Float[Array, " n_y"]
    marginal_error: Float[Array, ""]
    empty_x: Int[Array, ""]
    empty_y: Int[Array, ""]


class PreciseMap(NamedTuple):
    """A vertex-to-point map: each vertex of X goes to a point on a triangle of Y.

    corners: the triangle's vertices in Y.
    bary: barycentric coordinates, non-negative, rows sum to 1.
    """

    corners: Int[Array, "n_x 3"]
    bary: Float[Array, "n_x 3"]


class Certificate(NamedTuple):
    """Evidence of how good a map is, computed without ground truth.

    marginal_error: l1 gap of the plan's sums, as a fraction of all mass.
    empty: vertices of either shape that no mass reached.
    coverage_xy, coverage_yx: share of the target's area that the map hits.
    bijectivity_x, bijectivity_y: mean spectral distance between a vertex and its image
        there and back, relative to the mean distance of two random vertices.
    orthogonality: |C^T C - I|_2, 0 for an area-preserving map.
    orientation: correlation in [-1, 1]; about +0.9 for a map that preserves
        orientation, -0.9 for a mirrored one; nan for point clouds.
    gap: by how much more energy the runner-up of the search has, relative to the map's;
        near 0 two really different maps fit the shapes equally well.
    nn_agreement: share of X's vertices that nearest neighbour sends to the same vertex.
    finite: whether every number the maps came from is finite.
    """

    marginal_error: Float[Array, ""]
    empty: Int[Array, ""]
    coverage_xy: Float[Array, ""]
    coverage_yx: Float[Array, ""]
    bijectivity_x: Float[Array, ""]
    bijectivity_y: Float[Array, ""]
    orthogonality: Float[Array, ""]
    orientation: Float[Array, ""]
    gap: Float[Array, ""]
    nn_agreement: Float[Array, ""]
    finite: Bool[Array, ""]


class Match(NamedTuple):
    """Two shapes matched: maps both ways, the functional map, and the evidence.

    T_xy: the vertex of Y for each vertex of X.
    T_yx: the vertex of X for each vertex of Y.
    C_yx: functions on Y pulled back to X, in the eigenbases of `jfsf.match.basis`.
    certificate: evidence of how good the maps are.
    """

    T_xy: Int[Array, " n_x"]
    T_yx: Int[Array, " n_y"]
    C_yx: Float[Array, "k_x k_y"]
    certificate: Certificate

"""The records that travel between the functions: NamedTuples of arrays.

This file is long because every field is explained.

`_xy` reads "from X to Y" everywhere. The paper's T_XY is `T_xy`, its C_YX is `C_yx`.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jfsf._exported import exported
from jfsf._figures import FIGURES, explained

# Host records hold numpy arrays, traced ones hold jax arrays; both are "arrays" here.
ArrayLike = Any


@exported
class Mesh(NamedTuple):
    """A triangle mesh, or a point cloud when it has no faces. Host side (numpy).

    vertices: (n, 3) float64 positions, in the units and the order of the file.
    faces: (m, 3) int32, vertices from 0; (0, 3) for a point cloud.
    """

    vertices: ArrayLike
    faces: ArrayLike


@exported
class Spectrum(NamedTuple):
    """The first k eigenpairs of the Laplace-Beltrami operator of a shape of area 1.

    evals: ascending eigenvalues of the shape scaled to area 1; the first is 0.
    evecs: mass-orthonormal eigenvectors, one a column: evecs.T @ diag(mass) @ evecs =
        I. The first is constant.
    mass: lumped areas of the vertices, which sum to 1; 0 marks padding.
    faces: wound outward, for orientation, curvature and `refine.arap`. (0, 3) for a
        point cloud; `jfsf.basis` gives one the faces found by `jfsf.mesh.reconstruct`.
        A padding face is (0, 0, 0).
    vertices: centred positions on the shape scaled to area 1, for curvature and
        `refine.arap`. 0 on padding.
    """

    evals: Float[Array, " k"]
    evecs: Float[Array, "n k"]
    mass: Float[Array, " n"]
    faces: Int[Array, "m 3"]
    vertices: Float[Array, "n 3"]


@exported
class Maps(NamedTuple):
    """Point-to-point maps between X and Y, one in each direction.

    T_xy: the vertex of Y, from 0, for each vertex of X.
    T_yx: the vertex of X, from 0, for each vertex of Y.
    """

    T_xy: Int[Array, " n_x"]
    T_yx: Int[Array, " n_y"]


@exported
class Neighbours(NamedTuple):
    """The k0 nearest points of the other set for each point, nearest first.

    idx: indices of the neighbours; 0 where there are fewer than k0 valid points.
    dist: Euclidean distances to the neighbours; inf where there are fewer than k0
        valid points.
    """

    idx: Int[Array, "n k0"]
    dist: Float[Array, "n k0"]


@exported
class Tiles(NamedTuple):
    """Compact groups of points, all of one size; consecutive groups are close in space.

    member: index of the point in each slot.
    valid: whether each slot counts. Every point that takes part has one slot that
        counts, every other point none. Slots that do not count repeat points.
    """

    member: Int[Array, "t s"]
    valid: Bool[Array, "t s"]


@exported
class NeighboursBothWays(NamedTuple):
    """Neighbours in both directions, and how reliable the search for them was.

    near_xy: the neighbours in Y of each point of X.
    near_yx: the neighbours in X of each point of Y.
    recall: the share of neighbours that the search found, the smaller of both
        directions, estimated by exhaustive search of a sample. Among tiles it counts
        the points whose nearest neighbour was found, or one at most 0.1 % farther; with
        `NeighbourSettings.bins` it counts all neighbours. 1 where all points were
        compared and all neighbours found. nan if no point of the sample takes part.
    searched_all: whether all points were compared in at least one direction, because
        its recall among tiles was too small or there were no tiles.
    """

    near_xy: Neighbours
    near_yx: Neighbours
    recall: Float[Array, ""]
    searched_all: Bool[Array, ""]


@exported
class Kernel(NamedTuple):
    """Sparse kernel K (n_x, n_y) in the log domain, each entry stored once.

    An entry is absent where its log weight is -inf and its index 0.

    idx_xy: the k0 neighbours in Y of each vertex of X, the columns of its entries.
    log_xy: log K of the entries of `idx_xy`.
    idx_yx: for each vertex of Y, the vertices of X that are its neighbours, the rows of
        its entries. An entry that is also in `idx_xy` is absent here.
    log_yx: log K of the entries of `idx_yx`.
    """

    idx_xy: Int[Array, "n_x k0"]
    log_xy: Float[Array, "n_x k0"]
    idx_yx: Int[Array, "n_y k0"]
    log_yx: Float[Array, "n_y k0"]


@exported
class Plan(NamedTuple):
    """Sparse transport plan S = diag(exp f) K diag(exp g), laid out as its kernel K.

    idx_xy: the vertices of Y to which each vertex of X sends mass, as `Kernel.idx_xy`.
    weight_xy: the mass that is sent from X to Y by each entry of `idx_xy`; 0 where it
        is absent.
    idx_yx: the vertices of X from which each vertex of Y receives the rest, as
        `Kernel.idx_yx`.
    weight_yx: the mass that is sent from X to Y by each entry of `idx_yx`; 0 where it
        is absent.
    """

    idx_xy: Int[Array, "n_x k0"]
    weight_xy: Float[Array, "n_x k0"]
    idx_yx: Int[Array, "n_y k0"]
    weight_yx: Float[Array, "n_y k0"]


@exported
class Filtered(NamedTuple):
    """What the Fast Sinkhorn Filter returns: both maps and the plan they come from.

    The plan is S = diag(exp f) K diag(exp g) (`jfsf.convert.plan`). Its row and column
    sums are the marginals or, with a `reach`, the part of them that has a partner.

    T_xy: the argmax of each row of the plan: the vertex of Y for each vertex of X.
    T_yx: the argmax of each column of the plan: the vertex of X for each vertex of Y.
    kernel: K, sparse.
    f: logarithms of the row scalings; 0 on padding.
    g: logarithms of the column scalings; 0 on padding.
    marginal_error: l1 distance of the plan's row and column sums from those asked for,
        as a fraction of all mass: 0 is exact, 2 the most.
    empty_x: number of vertices of X that no mass can reach.
    empty_y: number of vertices of Y that no mass can reach.
    converged: whether the marginal error is at most the tolerance asked for; True where
        a fixed number of updates was asked for.
    num_iters: updates of each side that were made.
    recall: share of neighbours that the search found (`NeighboursBothWays.recall`); nan
        if the kernel came from elsewhere.
    membership_x: the mass that each vertex of X keeps, as a share of its marginal, at
        most 1; 0 on padding, and for a vertex that no mass can reach. None without
        `reach`, where all mass must arrive.
    membership_y: the mass that each vertex of Y keeps, as a share of its marginal, at
        most 1; 0 on padding, and for a vertex that no mass can reach. None without
        `reach`, where all mass must arrive.
    """

    T_xy: Int[Array, " n_x"]
    T_yx: Int[Array, " n_y"]
    kernel: Kernel
    f: Float[Array, " n_x"]
    g: Float[Array, " n_y"]
    marginal_error: Float[Array, ""]
    empty_x: Int[Array, ""]
    empty_y: Int[Array, ""]
    converged: Bool[Array, ""]
    num_iters: Int[Array, ""]
    recall: Float[Array, ""]
    membership_x: Float[Array, " n_x"] | None = None
    membership_y: Float[Array, " n_y"] | None = None


@exported
class Aligned(NamedTuple):
    """Embeddings of both shapes in one Euclidean space, which a converter compares.

    emb_x: one row for each vertex of X.
    emb_y: one row for each vertex of Y, in the same space.
    moved_x: where the vertices of X lie when it is deformed onto Y, in sqrt(area); None
        if the shapes were not deformed.
    moved_y: where the vertices of Y lie when it is deformed onto X, in sqrt(area); None
        if the shapes were not deformed.
    """

    emb_x: Float[Array, "n_x d"]
    emb_y: Float[Array, "n_y d"]
    moved_x: Float[Array, "n_x 3"] | None = None
    moved_y: Float[Array, "n_y 3"] | None = None


@exported
class Bent(NamedTuple):
    """Positions of both shapes, each deformed onto the other, in sqrt(area).

    moved_x: where the vertices of X lie when it is deformed onto Y.
    moved_y: where the vertices of Y lie when it is deformed onto X.
    """

    moved_x: Float[ArrayLike, "n_x 3"]
    moved_y: Float[ArrayLike, "n_y 3"]


@exported
class PreciseMap(NamedTuple):
    """A vertex-to-point map: each vertex of X goes to a point on a triangle of Y.

    corners: the vertices of Y at the corners of the triangle for each vertex of X.
    bary: barycentric coordinates on that triangle, non-negative; rows sum to 1.
    """

    corners: Int[Array, "n_x 3"]
    bary: Float[Array, "n_x 3"]


@exported
class Certificate(NamedTuple):
    """Evidence of how good a map is, computed without ground truth.

    `jfsf._figures.FIGURES` says of each number what it means, and why it may be nan.

    landmarks: spectral distance between the image of each landmark and its partner,
        relative to the mean distance of two random vertices; above 0.5 the map
        misses it. Empty without landmarks.
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
    mirror_gap: Float[Array, ""]
    nn_agreement: Float[Array, ""]
    recall: Float[Array, ""]
    finite: Bool[Array, ""]
    energy: Float[Array, ""]
    log_stretch_std: Float[Array, ""]
    residual: Float[Array, ""]
    shear: Float[Array, ""]
    area_std: Float[Array, ""]
    normal_gap: Float[Array, ""]
    spectrum_gap: Float[Array, ""]
    region_cost: Float[Array, ""]
    person_agreement: Float[Array, ""]
    log_odds: Float[Array, ""]
    share: Float[Array, ""]
    rivals: Float[Array, ""]
    mirrored: Float[Array, ""]
    confidence: Float[Array, ""]
    landmarks: Float[Array, " l"]

    def figures(self) -> dict[str, Any]:
        """The figures that are single numbers, by name: all fields but `landmarks`.

        They are plain Python numbers, which `json.dumps` takes. Figures of a batch of
        matches, and traced ones, stay arrays.
        """
        return {name: _plain(getattr(self, name)) for name in FIGURES}

    @classmethod
    def unknown(cls, dtype: Any = float) -> "Certificate":
        """A certificate without evidence, to be filled by `_replace`.

        All numbers are nan, but `empty` is 0 and `finite` True; there are no landmarks.
        """
        figures: dict[str, Any] = dict.fromkeys(FIGURES, np.full((), np.nan, dtype))
        figures |= {"empty": np.zeros((), np.int32), "finite": np.ones((), bool)}
        return cls(**figures, landmarks=figures["gap"][None][:0])


def _plain(value: ArrayLike) -> Any:
    if np.ndim(value):
        return value
    try:
        return np.asarray(value).item()
    except TypeError:  # jax's, of what is traced
        return value


Certificate.__doc__ = f"{Certificate.__doc__}\n" + "\n".join(map(explained, FIGURES))


# Where starts come from, and the stages that are timed, in their order.
SOURCES = "given", "search", "landmarks", "coarse copies", "motion"
STAGES = (
    "spectra",
    "features",
    "search",
    "kept landmarks",
    "refinement",
    "bending and conversion",
    "coarse copies",
    "motion",
)


@exported
class MatchInfo(NamedTuple):
    """How a match was found, on the host.

    source: for each attempt, in order, where its start came from: its number in
        `SOURCES`.
    confidence: the confidence of each attempt's map, in [0, 1] or nan.
    won: the number, from 0, of the attempt that is the match.
    seconds: what each of `STAGES` took, in seconds, compiling included; nan for a stage
        that was not run. For a stage that was run for several pairs at a time, this
        pair's share.
    """

    source: Int[ArrayLike, " a"]
    confidence: Float[ArrayLike, " a"]
    won: Int[ArrayLike, ""]
    seconds: Float[ArrayLike, " s"]

    @property
    def sources(self) -> list[str]:
        """The name of each attempt's source."""
        return [SOURCES[i] for i in self.source]

    @property
    def start(self) -> str:
        """The source of the start that won."""
        return self.sources[int(self.won)]


@exported
class Match(NamedTuple):
    """Two shapes matched: maps both ways, the functional map, and the evidence.

    Fields "of parts" are those of `match(partial=True)`, and None if the shapes were
    matched as wholes. Two closed surfaces given as parts share everything: all of their
    vertices are matched, with membership 1.

    T_xy: the vertex of Y, from 0, for each vertex of X.
    T_yx: the vertex of X, from 0, for each vertex of Y.
    C_yx: the functional map: functions on Y pulled back to X, in the eigenbases of
        `jfsf.basis`.
    certificate: evidence of how good the maps are.
    matched_x: of parts, whether each vertex of X is in the region that both share.
    matched_y: of parts, whether each vertex of Y is in the region that both share.
    confidence_x: for each vertex of X, the probability that its image is within 0.05 of
        its true partner, in geodesic distance over sqrt(area)
        (`jfsf.matching.vertex_confidence`); nan where the shapes were not deformed onto
        each other, 0 on padding. None for parts.
    confidence_y: for each vertex of Y, the probability that its image is within 0.05 of
        its true partner, in geodesic distance over sqrt(area)
        (`jfsf.matching.vertex_confidence`); nan where the shapes were not deformed onto
        each other, 0 on padding. None for parts.
    radius_x: for each vertex of X a length in sqrt(area) of Y: if the map is right on
        the whole, the image is less than that from the true partner with 90 %
        probability, in geodesic distance (`jfsf.matching.vertex_radius`); nan where the
        shapes were not deformed onto each other, inf on padding. None for parts.
    radius_y: for each vertex of Y a length in sqrt(area) of X: if the map is right on
        the whole, the image is less than that from the true partner with 90 %
        probability, in geodesic distance (`jfsf.matching.vertex_radius`); nan where the
        shapes were not deformed onto each other, inf on padding. None for parts.
    membership_x: of parts, how clearly each vertex of X is in the region that both
        share, in [0, 1]; `matched_x` is where it is above one half. It falls with the
        distance of the surfaces after the deformation, and across their boundaries. It
        is not a probability.
    membership_y: of parts, how clearly each vertex of Y is in the region that both
        share, in [0, 1]; `matched_y` is where it is above one half. It falls with the
        distance of the surfaces after the deformation, and across their boundaries. It
        is not a probability.
    overlap_x: of parts, the share of X's area that is matched.
    overlap_y: of parts, the share of Y's area that is matched.
    info: which starts were attempted, and how long it took; None for a single attempt
        (`jfsf.match_spectra`) and for parts. The number of attempts differs between
        matches: to stack matches, leave it out (`_replace(info=None)`).
    """

    T_xy: Int[Array, " n_x"]
    T_yx: Int[Array, " n_y"]
    C_yx: Float[Array, "k_x k_y"]
    certificate: Certificate
    matched_x: Bool[Array, " n_x"] | None = None
    matched_y: Bool[Array, " n_y"] | None = None
    confidence_x: Float[Array, " n_x"] | None = None
    confidence_y: Float[Array, " n_y"] | None = None
    radius_x: Float[Array, " n_x"] | None = None
    radius_y: Float[Array, " n_y"] | None = None
    membership_x: Float[Array, " n_x"] | None = None
    membership_y: Float[Array, " n_y"] | None = None
    overlap_x: Float[Array, ""] | None = None
    overlap_y: Float[Array, ""] | None = None
    info: MatchInfo | None = None

    def without_padding(self, n_x: int, n_y: int) -> "Match":
        """The match of the first n_x vertices of X and the first n_y of Y."""
        kinds = "matched", "confidence", "radius", "membership"
        of_x, of_y = ([f"{kind}_{side}" for kind in kinds] for side in "xy")
        sizes = dict.fromkeys(("T_xy", *of_x), n_x)
        sizes |= dict.fromkeys(("T_yx", *of_y), n_y)
        known = [name for name in sizes if getattr(self, name) is not None]
        return self._replace(**{n: getattr(self, n)[: sizes[n]] for n in known})

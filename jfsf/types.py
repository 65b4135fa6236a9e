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

    vertices: (n, 3) float64, in the file's own units and order.
    faces: (m, 3) int32, 0-based; (0, 3) for a point cloud.
    """

    vertices: ArrayLike
    faces: ArrayLike


@exported
class Spectrum(NamedTuple):
    """The first k eigenpairs of the Laplace-Beltrami operator of a shape of area 1.

    evals: ascending, the first 0; on the shape scaled to unit area.
    evecs: mass-orthonormal, evecs.T @ diag(mass) @ evecs = I; the first is constant.
    mass: lumped vertex areas, they sum to 1; 0 marks padding.
    faces: wound outward, for orientation, curvature and `refine.arap`. (0, 3) for a
        point cloud; `jfsf.basis` gives one the faces found by `jfsf.mesh.reconstruct`.
        A padding face is (0, 0, 0).
    vertices: positions, centred, of the shape scaled to unit area, for curvature and
        `refine.arap`. 0 on padding.
    """

    evals: Float[Array, " k"]
    evecs: Float[Array, "n k"]
    mass: Float[Array, " n"]
    faces: Int[Array, "m 3"]
    vertices: Float[Array, "n 3"]


@exported
class Maps(NamedTuple):
    """A point-to-point map and one the other way.

    T_xy: the vertex of Y for each vertex of X.
    T_yx: the vertex of X for each vertex of Y.
    """

    T_xy: Int[Array, " n_x"]
    T_yx: Int[Array, " n_y"]


@exported
class Neighbours(NamedTuple):
    """The k0 nearest points of the other set for each point, nearest first.

    idx: their indices; 0 where there are fewer than k0 valid points.
    dist: Euclidean distances; inf there.
    """

    idx: Int[Array, "n k0"]
    dist: Float[Array, "n k0"]


@exported
class Tiles(NamedTuple):
    """Compact groups of points, all of one size; consecutive groups are close in space.

    member: index of the point in each slot.
    valid: whether the slot counts. Every point that takes part has one such slot, every
        other point none. The slots that do not count repeat points.
    """

    member: Int[Array, "t s"]
    valid: Bool[Array, "t s"]


@exported
class NeighboursBothWays(NamedTuple):
    """Neighbours in both directions, and how reliable the search for them was.

    near_xy, near_yx: neighbours in Y of each point of X, and in X of each point of Y.
    recall: among tiles the share of points whose nearest neighbour was found, or one at
        most 0.1 % farther (`NeighbourSettings.tolerance`); the smaller of both
        directions. 1 for a direction in which all points were compared, else estimated
        on a sample, by exhaustive search. With `NeighbourSettings.bins` the share of
        all neighbours, estimated so. nan if no point of the samples takes part.
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

    Row i holds its own k0 neighbours in Y (`idx_xy`); the entries that only a vertex
    of Y asked for stand in the other half (`idx_yx`). An absent entry has log weight
    -inf and index 0.
    """

    idx_xy: Int[Array, "n_x k0"]
    log_xy: Float[Array, "n_x k0"]
    idx_yx: Int[Array, "n_y k0"]
    log_yx: Float[Array, "n_y k0"]


@exported
class Plan(NamedTuple):
    """Sparse transport plan S = diag(exp f) K diag(exp g), laid out as its kernel K.

    idx_xy, idx_yx: as in `Kernel`.
    weight_xy, weight_yx: mass of each entry, 0 where it is absent.
    """

    idx_xy: Int[Array, "n_x k0"]
    weight_xy: Float[Array, "n_x k0"]
    idx_yx: Int[Array, "n_y k0"]
    weight_yx: Float[Array, "n_y k0"]


@exported
class Filtered(NamedTuple):
    """What the Fast Sinkhorn Filter returns: both maps and the plan they come from.

    The plan is S = diag(exp f) K diag(exp g) (`jfsf.convert.plan`). Its row and column
    sums are the marginals, or with a `reach` what of these has a partner.

    T_xy, T_yx: row and column argmax of the plan.
    kernel: K, sparse.
    f, g: log scalings; 0 on padding.
    marginal_error: l1 gap of the plan's row and column sums, as a fraction of all mass;
        0 is exact, 2 the most.
    empty_x, empty_y: number of vertices that no mass can reach.
    converged: whether the marginal error is at most the tolerance asked for; True where
        a fixed number of updates was asked for.
    num_iters: updates of each side that were made.
    recall: of the search for neighbours (`NeighboursBothWays.recall`); nan where the
        kernel came from elsewhere.
    membership_x, membership_y: the mass that each point keeps, as a share of its
        marginal, at most 1; 0 on padding, and for a point that no mass can reach. None
        where all mass must arrive, without `reach`.
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

    emb_x, emb_y: a row a vertex.
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

    corners: the triangle's vertices in Y.
    bary: barycentric coordinates, non-negative, rows sum to 1.
    """

    corners: Int[Array, "n_x 3"]
    bary: Float[Array, "n_x 3"]


@exported
class Certificate(NamedTuple):
    """Evidence of how good a map is, computed without ground truth.

    `jfsf._figures.FIGURES` says of each number what it means, and why it may be nan.

    landmarks: spectral distance between the image of each landmark and its partner,
        relative to the mean distance of two random vertices; above
        `jfsf.matching.MISSED` the map misses it. Empty without landmarks.
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
    log_odds: Float[Array, ""]
    share: Float[Array, ""]
    rivals: Float[Array, ""]
    mirrored: Float[Array, ""]
    confidence: Float[Array, ""]
    landmarks: Float[Array, " l"]

    def figures(self) -> dict[str, Any]:
        """What is a single number, by name: all but the landmarks.

        Plain numbers of Python, as `json.dumps` takes; the arrays themselves of many
        matches at once, and while they are traced.
        """
        return {name: _plain(getattr(self, name)) for name in FIGURES}

    @classmethod
    def unknown(cls, dtype: Any = float) -> "Certificate":
        """A certificate that says nothing, to be filled by `_replace`.

        All numbers are nan, no vertex is empty, all is finite, without landmarks.
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

    source: for each attempt, in their order, the number in `SOURCES` of its start's.
    confidence: of each attempt; in [0, 1], or nan.
    won: the number of the attempt that is the match.
    seconds: that each of `STAGES` took, compiling included; nan for one that was not
        run. Where a stage was run for several pairs at a time, a pair's share of them.
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

    T_xy: the vertex of Y for each vertex of X.
    T_yx: the vertex of X for each vertex of Y.
    C_yx: functions on Y pulled back to X, in the eigenbases of `jfsf.basis`.
    certificate: evidence of how good the maps are.
    matched_x, matched_y: the vertices of each shape that the other has too; None if the
        shapes were matched as wholes.
    confidence_x, confidence_y: for each vertex, the probability that its image is
        within 0.05 of its true partner, geodesically, in sqrt(area)
        (`jfsf.matching.vertex_confidence`); nan where the shapes were not bent onto
        each other, 0 on padding. None for parts.
    radius_x, radius_y: for each vertex a length in sqrt(area) of the shape that its
        image lies on. If the map is right on the whole, the image is less than that
        from the true partner with 90 % probability, geodesically
        (`jfsf.matching.vertex_radius`); nan where the shapes were not bent onto each
        other, inf on padding. None for parts.
    membership_x, membership_y: of parts, how clearly each vertex is in the region that
        both share, in [0, 1]; matched_x and matched_y are where it is above one half.
        It falls with the distance of the surfaces after bending, and across their
        rims. It is no probability. None if the shapes were matched as wholes.
    overlap_x, overlap_y: the share of the area of each shape that is matched; None if
        the shapes were matched as wholes.
    info: which starts were attempted, and how long it took; None for a single attempt
        (`jfsf.match_spectra`) and for parts. Matches differ in how many there were: to
        stack matches, leave it out (`_replace(info=None)`).

    Two closed surfaces given as parts share all: they are matched as wholes, and their
    membership is 1 throughout.
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
        """That of the first n_x vertices of X and n_y of Y."""
        kinds = "matched", "confidence", "radius", "membership"
        of_x, of_y = ([f"{kind}_{side}" for kind in kinds] for side in "xy")
        sizes = dict.fromkeys(("T_xy", *of_x), n_x)
        sizes |= dict.fromkeys(("T_yx", *of_y), n_y)
        known = [name for name in sizes if getattr(self, name) is not None]
        return self._replace(**{n: getattr(self, n)[: sizes[n]] for n in known})

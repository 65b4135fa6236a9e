"""Settings: how `match` works, stage by stage. Frozen, hashable, static under jit."""

from dataclasses import dataclass, field, fields
from typing import Any

from jfsf.array import describe, static_key
from jfsf.convert import Converter, quick_nearest, quick_sinkhorn, sinkhorn
from jfsf.initial import SearchSettings
from jfsf.neighbours import NeighbourSettings
from jfsf.refine import ArapSettings, ZoomOutSettings
from jfsf.spectral import DISTANCE_PAIRS, FeatureSettings


@dataclass(frozen=True, eq=False, repr=False)
class Settings:
    """How `match` works. Settings of equal content are equal and share a program.

    Lengths are relative to sqrt(area). Values were chosen by the mean error on FAUST
    000-079, TOSCA and the embedded shapes.

    k: eigenpairs a shape, fewer for fewer than 4 k vertices: the higher ones then say
        more of the triangles than of the shape. More than 128 make a better map before
        the bending, hardly after it.
    features: descriptors, curvature and oriented products.
    search: the search for the initial map.
    retry_below: a map of less confidence (`Certificate.confidence`) is refined again
        from other starts (`jfsf.initial.nonisometric_candidates`), until one reaches
        this. The most confident is kept. Of 248 near-isometric pairs none is below 0.9.
        0 leaves it out.
    screening_rounds: times that the shapes are bent by each of these starts, unrefined,
        to compare the confidence. It takes a quarter of the time of a refined map and
        ranks starts no worse: bent for long, shapes fit by a wrong map too.
    nonisometric_attempts: of these starts, so many are refined, the most confident
        first.
    coarse_vertices: vertices of coarse copies, on which `jfsf.match` tries the further
        starts of shapes that are more than twice as large, padding included. The best
        map of the copies is the one start that is tried on the whole shapes. 0 tries
        all starts on these.
    ks: sizes of the basis in the refinement, see `zoomout`, from that of the start to
        the last. A larger `k` alone lengthens C_yx, not the refinement. Rounds of equal
        size, where descriptors weigh most, correct the start. Finer schedules slide
        away from it further; coarser ones are as good if the bending follows.
    refine_converter: the converter of these rounds.
    zoomout: how they weigh columns.
    bend_rounds: times that both shapes are deformed onto each other, see `arap`; 0
        leaves it out. Two point clouds without surfaces (`jfsf.mesh.reconstruct`) are
        not bent. Beside a mesh, the points of such a cloud move freely.
    bend_converter: the converter before and between these.
    bend: how shapes are deformed.
    converter: the last converter. The certificate needs its plan for three of its
        figures; they are nan without one.
    neighbours: how neighbours are searched, for converters that declare
        `neighbour_settings`.
    tiles_above: vertices of the larger shape, padding included, above which neighbours
        are searched among tiles, at a cost that grows like n
        (`experiments/bench_large.py`).
    samples_above: vertices of a shape, padding included, above which the functional map
        is refined on samples.
    samples: of these; a power of two.
    exhaustive_up_to: vertices of the larger shape, padding included, above which all
        points are never compared with all. Above it the farthest points of a shape are
        chosen among its `samples`, too.
    min_recall: recall among tiles below which the last conversion compares all points,
        up to `exhaustive_up_to` vertices. For a converter that declares `min_recall`,
        and a bending converter that leaves it open.
    distance_pairs: eigenpairs of the biharmonic distance, for samples and certificate.
    """

    k: int = 128
    features: FeatureSettings = field(default_factory=FeatureSettings)
    search: SearchSettings = field(default_factory=SearchSettings)
    retry_below: float = 0.9
    screening_rounds: int = 2
    nonisometric_attempts: int = 2
    coarse_vertices: int = 5000
    ks: tuple[int, ...] = (30, 30, 30, 30, 45, 65, 110, 128)
    refine_converter: Converter = quick_sinkhorn
    zoomout: ZoomOutSettings = field(default_factory=ZoomOutSettings)
    bend_rounds: int = 8
    bend_converter: Converter = quick_nearest
    bend: ArapSettings = field(default_factory=ArapSettings)
    converter: Converter = sinkhorn
    neighbours: NeighbourSettings = field(default_factory=NeighbourSettings)
    tiles_above: int = 2000
    samples_above: int = 4096
    samples: int = 4096
    exhaustive_up_to: int = 20_480
    min_recall: float = 0.95
    distance_pairs: int = DISTANCE_PAIRS

    def __post_init__(self) -> None:
        """ValueError for values that no match can be made with."""
        object.__setattr__(self, "ks", tuple(self.ks))
        if not self.ks or list(self.ks) != sorted(self.ks) or self.ks[0] < 2:
            raise ValueError(
                f"Settings: ks is {self.ks}; give sizes from 2 up that do not decrease"
            )
        if self.k < self.ks[-1]:
            raise ValueError(
                f"Settings: k is {self.k}, but ks ends at {self.ks[-1]}; raise k or "
                "shorten ks"
            )
        if self.bend_rounds < 0 or self.samples < 1:
            raise ValueError(
                f"Settings: bend_rounds is {self.bend_rounds} and samples "
                f"{self.samples}; give 0 or more, and 1 or more"
            )
        if self.screening_rounds < 1 or self.nonisometric_attempts < 1:
            raise ValueError(
                f"Settings: screening_rounds is {self.screening_rounds} and "
                f"nonisometric_attempts {self.nonisometric_attempts}; give 1 or more"
            )
        if self.samples & (self.samples - 1):
            raise ValueError(
                f"Settings: samples is {self.samples}; give a power of two"
            )
        if 0 < self.coarse_vertices < self.min_vertices or self.coarse_vertices < 0:
            raise ValueError(
                f"Settings: coarse_vertices is {self.coarse_vertices}; give 0, or "
                f"{self.min_vertices} or more"
            )
        if not 0 <= self.retry_below <= 1:
            raise ValueError(
                f"Settings: retry_below is {self.retry_below}; give a probability"
            )
        for name in ("converter", "refine_converter", "bend_converter"):
            if not callable(getattr(self, name)):
                raise ValueError(
                    f"Settings: {name} is {getattr(self, name)!r}; give a function, "
                    "see jfsf.convert.Converter"
                )

    @property
    def min_vertices(self) -> int:
        """Vertices that a shape needs: four for each eigenpair of the search."""
        return 4 * self.search.eigenpairs

    def eigenpairs(self, vertices: int) -> int:
        """Eigenpairs that a shape of so many vertices gets."""
        return max(self.search.eigenpairs, min(self.k, vertices // 4))

    def as_record(self) -> dict[str, Any]:
        """Plain values for a file of results: nested settings and functions as text."""
        plain = (bool, int, float, str)
        return {
            name: value if isinstance(value, plain) else describe(value)
            for name, value in self._items()
        }

    def _items(self) -> list[tuple[str, Any]]:
        return [(f.name, getattr(self, f.name)) for f in fields(self)]

    def _key(self) -> tuple[Any, ...]:
        return tuple((name, static_key(value)) for name, value in self._items())

    def __eq__(self, other: object) -> bool:
        """Whether both have equal content."""
        return isinstance(other, Settings) and self._key() == other._key()

    def __hash__(self) -> int:
        """Of the content."""
        return hash(self._key())

    def __repr__(self) -> str:
        """What one would write to make it, every field included."""
        return describe(self)

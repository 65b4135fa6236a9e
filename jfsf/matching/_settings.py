"""Settings: how `match` works, stage by stage. Frozen, hashable, static under jit."""

from dataclasses import dataclass, field, fields, replace
from typing import Any

from jfsf.array._jit import check_types, static_key, static_text
from jfsf.convert import Converter, sinkhorn
from jfsf.convert._variants import quick_sinkhorn
from jfsf.initial import SearchSettings
from jfsf.matching._stages import (
    Deform,
    Describe,
    Refine,
    deform_by_arap,
    refine_by_zoomout,
)
from jfsf.matching.parts import PartSettings
from jfsf.neighbours import NeighbourSettings
from jfsf.refine import ArapSettings
from jfsf.spectral import FeatureSettings, features

COARSE_VERTICES = 1200
# Fields that no stage reads, beside `parts` and `coarse_vertices`.
OF_THE_HOST = (
    "retry_below",
    "copies_above",
    "nonisometric_attempts",
    "rigid_below",
    "people",
)


@dataclass(frozen=True, eq=False, repr=False)
class Settings:
    """How `match` works. Settings of equal content are equal and share a program.

    Lengths are relative to sqrt(area). Values were chosen by the mean error on FAUST
    000-079, TOSCA and the embedded shapes.

    k: eigenpairs of each shape; fewer for a shape of fewer than 4 k vertices, whose
        higher ones say more of the triangles than of the shape. More than 128 improve
        the map before the deformation, but hardly after it.
    describe: the function that makes the features of a shape: a
        `jfsf.matching.Describe`.
    features: parameters of the features: descriptors, curvature, oriented products.
    search: parameters of the search for the initial map.
    retry_below: confidence of a map, by its own evidence (`Certificate.confidence`),
        below which further starts are tried on coarse copies. The best of these are
        attempted on the whole shapes, and the most confident map is kept. A map that is
        given is kept in any case, but compared with them. 0 tries no further starts.
    coarse_vertices: number of vertices of the coarse copies (`jfsf.matching`), on which
        all further starts are tried, and which are deformed first if shapes are large.
    copies_above: number of vertices of the larger shape, padding included, above which
        `match` deforms coarse copies first, for `bend_rounds`; the whole shapes follow
        them and are deformed for `last_rounds`. It takes less time, and the mean errors
        are smaller (`experiments/fit/choose_copies.py`). Not with a `deform` of your
        own.
    nonisometric_attempts: number of maps of the coarse copies that are attempted on the
        whole shapes: those that differ and rank highest. If the map so far ranks first
        it is one of them, so with 1 nothing more is attempted then. With two the mean
        error of creatures is smaller than with one, and with three no smaller; on
        SHREC'07 it is the same (`experiments/fit/fit_attempts.py`).
    people: whether a network that knows people (`jfsf.learned`) is asked about whole
        shapes in doubt, and about parts. Where it takes both for people, it adds a
        start, and evidence of each map that is compared
        (`Certificate.person_agreement`). False leaves it out.
    rigid_below: mean distance in sqrt(area), of both shapes to each other after a
        similarity fitted to the map and a stiff deformation, below which the last map
        is read from there, without free bending, and kept: on bones, teeth and faces it
        slides less. For two disks the limit is twice as large. 0 makes no such map, nor
        do landmarks or a map that is given. Chosen by `experiments/fit/fit_rigid.py`.
    ks: sizes of the basis in the refinement, from that of the start to the last; see
        `zoomout`. A larger `k` alone lengthens C_yx, not the refinement. Rounds of
        equal size, where descriptors weigh most, correct the start. Finer schedules
        slide further away from it; coarser ones are as good if the shapes are deformed
        after.
    refine: the function that refines a functional map: a `jfsf.matching.Refine`. The
        package's own reads `ks` and `refine_converter`.
    refine_converter: the converter in the rounds of the refinement.
    deform: the function that deforms both shapes: a `jfsf.matching.Deform`. The
        package's own reads `bend_rounds`, `last_rounds` and `bend`.
    bend_rounds: number of times that both shapes are deformed onto each other, see
        `arap`; 0 for none. Two point clouds without surfaces (`jfsf.mesh.reconstruct`)
        are not deformed. Beside a mesh, the points of such a cloud move freely.
    last_rounds: number of times that whole shapes are deformed after their coarse
        copies.
    bend: parameters of each deformation.
    converter: the last converter. Three figures of the certificate need its plan, and
        are nan if it returns none.
    neighbours: how neighbours are searched, for all converters. Without tiles the
        search is approximate, as it was when the other numbers were chosen.
    tiles_above: number of vertices of the larger shape, padding included, above which
        neighbours are searched among tiles, at a cost that grows like n
        (`experiments/bench/bench_large.py`).
    samples: number of samples, a power of two, at which the functional map is refined
        if a shape has more vertices, padding included.
    exhaustive_up_to: number of vertices of the larger shape, padding included, above
        which all points are never compared with all, and the farthest points of a shape
        are chosen among its `samples`.
    parts: how `match(partial=True)` finds the region that two shapes share.
    """

    k: int = 128
    describe: Describe = features
    features: FeatureSettings = field(default_factory=FeatureSettings)
    search: SearchSettings = field(default_factory=SearchSettings)
    retry_below: float = 0.9
    coarse_vertices: int = COARSE_VERTICES
    copies_above: int = 5120
    nonisometric_attempts: int = 2
    people: bool = True
    rigid_below: float = 0.009
    ks: tuple[int, ...] = (30, 30, 30, 30, 45, 65, 110, 128)
    refine: Refine = refine_by_zoomout
    refine_converter: Converter = quick_sinkhorn
    deform: Deform = deform_by_arap
    bend_rounds: int = 8
    last_rounds: int = 2
    bend: ArapSettings = field(default_factory=ArapSettings)
    converter: Converter = sinkhorn
    neighbours: NeighbourSettings = NeighbourSettings(bins=12)
    tiles_above: int = 2000
    samples: int = 4096
    exhaustive_up_to: int = 20_480
    parts: PartSettings = field(default_factory=PartSettings)

    def __post_init__(self) -> None:
        """ValueError for values that no match can be made with."""
        check_types(self)
        if not self.ks or list(self.ks) != sorted(self.ks) or self.ks[0] < 2:
            raise ValueError(
                f"Settings: ks is {self.ks}; give sizes from 2 up that do not decrease"
            )
        if self.k < self.ks[-1]:
            raise ValueError(
                f"Settings: k is {self.k}, but ks ends at {self.ks[-1]}; raise k or "
                "shorten ks"
            )
        least = {"bend_rounds": 0, "last_rounds": 0}
        for name, few in (least | {"samples": 1, "nonisometric_attempts": 1}).items():
            if (number := getattr(self, name)) < few:
                raise ValueError(f"Settings: {name} is {number}; give {few} or more")
        if self.samples & (self.samples - 1):
            raise ValueError(
                f"Settings: samples is {self.samples}; give a power of two"
            )
        if self.coarse_vertices < self.min_vertices:
            raise ValueError(
                f"Settings: coarse_vertices is {self.coarse_vertices}; give "
                f"{self.min_vertices} or more"
            )
        if not 0 <= self.retry_below <= 1:
            raise ValueError(
                f"Settings: retry_below is {self.retry_below}; give a probability"
            )
        converters = "converter", "refine_converter"
        for name in (*converters, "describe", "refine", "deform"):
            if not callable(getattr(self, name)):
                kind = "convert.Converter" if name in converters else "matching"
                raise ValueError(
                    f"Settings: {name} is {getattr(self, name)!r}; give a function, "
                    f"see jfsf.{kind}"
                )

    @property
    def min_vertices(self) -> int:
        """Vertices that a shape needs: four for each eigenpair of the search."""
        return 4 * self.search.eigenpairs

    def eigenpairs(self, vertices: int) -> int:
        """Eigenpairs that a shape of so many vertices gets."""
        return max(self.search.eigenpairs, min(self.k, vertices // 4))

    def of_stages(self) -> "Settings":
        """The same, but what the host alone reads is as by default.

        Stages are compiled with these: settings that differ in nothing else share their
        programs.
        """
        usual = {f.name: f.default for f in fields(self) if f.name in OF_THE_HOST}
        least = max(COARSE_VERTICES, self.min_vertices)
        return replace(self, **usual, parts=PartSettings(), coarse_vertices=least)

    def check_search(self) -> None:
        """ValueError if the refinement begins above what the search finds."""
        if self.ks[0] > (size := self.search.final_ks[-1]):
            raise ValueError(
                f"Settings: ks begins at {self.ks[0]}, but the search finds maps "
                f"of {size} functions; begin with {size} or fewer"
            )

    def as_record(self) -> dict[str, Any]:
        """Plain values for a file of results: nested settings and functions as text."""
        plain = (bool, int, float, str)
        return {
            name: value if isinstance(value, plain) else static_text(value)
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
        return static_text(self)

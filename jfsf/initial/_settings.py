"""How the search for an initial map works, in numbers."""

from dataclasses import dataclass, field

from jfsf.initial._terms import Weights
from jfsf.refine import ZoomOutSettings
from jfsf.spectral._sampling import DISTANCE_PAIRS


@dataclass(frozen=True)
class SearchSettings:
    """How `candidates` searches. Hashable, for static arguments.

    hypotheses: functional maps that are tried, at most; time grows with them. The
        default is all starts, the best ten of them, and these with each flip.
    sign_functions: first eigenfunctions, the constant included, whose sign patterns are
        all tried as starts.
    descriptor_weights: of the columns beside the eigenfunctions, for the starts: each
        sign pattern is tried with each. The best weight depends on the shapes. With 0.5
        the legs of TOSCA's dogs are exchanged, with 1 the hands of the embedded child.
    descriptor_weight: the same afterwards, and in the refinement. More exchanges hands
        even from a right start.
    start_ks: sizes of the basis for the starts, see `zoomout`.
    fits: weights of the fits to descriptors, which are starts too.
    fit_size: size of these functional maps.
    orthogonal_fits: weights of further fits, with orthogonality as a term.
    orthogonality: weight of that term.
    orthogonal_steps: of Levenberg-Marquardt.
    fit_ks: sizes of the basis for these starts; they end where `start_ks` ends.
    flip_range: the eigenfunctions whose signs are flipped one at a time in the best
        starts: functions that are odd from front to back are among them.
    flip_ks: sizes of the basis after a flip; the first is the end of `flip_range`.
    extremities: found on each shape, for the starts of `nonisometric_candidates`.
    assigned: of these, in one start. Two shapes may have unequal numbers of limbs.
    assignments: starts of this kind, those that change distances between extremities
        most evenly and bring together extremities that look alike.
    assignment_ks: sizes of the basis for these starts.
    extremity_weight: of the distances to assigned extremities beside eigenfunctions.
    nonisometric_descriptor_weight: the same as `descriptor_weight` for these starts.
        Where proportions differ so do descriptors: more spoils right maps.
    difference_weight: of what assigned extremities differ in, beside
        `jfsf.initial.log_stretch_std` of a map.
    nonisometric_candidates: maps kept of these. Later ones are right where the first is
        not.
    samples: farthest points on which hypotheses are refined.
    final_samples: farthest points on which the last candidates are refined and ranked.
    final_ks: sizes of the basis for these.
    compared: leading rows and columns of a functional map in which two are compared.
    min_difference: share of that block's energy in which two candidates must differ.
    curvature_energy: energy of curvatures that differ by one standard deviation.
    half_mirrored_energy: energy of a map that keeps orientation on half of the shape
        and mirrors the other half.
    wrong_orientation_energy: added for a map of the wrong orientation: more than any
        other energy.
    distance_pairs: eigenpairs of the biharmonic distance, for farthest points.
    zoomout: weights of the columns in all refinements of the search.
    """

    hypotheses: int = 160
    sign_functions: int = 5
    descriptor_weights: tuple[float, ...] = (0.0, 0.5, 1.0)
    descriptor_weight: float = 0.5
    start_ks: tuple[int, ...] = (5, 7, 9, 12, 16, 20)
    fits: tuple[Weights, ...] = (
        Weights(1.0, 0.1, 0.1, 0.1),
        Weights(1.0, 1.0, 1.0, 1.0),
    )
    fit_size: int = 30
    orthogonal_fits: tuple[Weights, ...] = ()
    orthogonality: float = 1.0
    orthogonal_steps: int = 10
    fit_ks: tuple[int, ...] = (16, 20)
    flip_range: tuple[int, int] = (6, 16)
    flip_ks: tuple[int, ...] = (16, 18, 21, 24, 28, 33, 40)
    extremities: int = 7
    assigned: int = 5
    assignments: int = 160
    assignment_ks: tuple[int, ...] = (8, 10, 13, 16, 20, 25, 30)
    extremity_weight: float = 2.0
    nonisometric_descriptor_weight: float = 0.1
    difference_weight: float = 0.4
    nonisometric_candidates: int = 8
    samples: int = 300
    final_samples: int = 1000
    final_ks: tuple[int, ...] = (30, 30, 30, 40)
    compared: int = 20
    min_difference: float = 0.04
    curvature_energy: float = 0.125
    half_mirrored_energy: float = 0.2
    wrong_orientation_energy: float = 100.0
    distance_pairs: int = DISTANCE_PAIRS
    zoomout: ZoomOutSettings = field(default_factory=ZoomOutSettings)

    def __post_init__(self) -> None:
        """ValueError for numbers that do not fit each other."""
        least = self.starts + self.flips
        if self.hypotheses < least:
            raise ValueError(
                f"SearchSettings: hypotheses is {self.hypotheses}, the least is {least}"
            )
        size, end = self.start_ks[-1], self.flip_range[1]
        facts = {
            f"start_ks begin at {self.start_ks[0]}, sign_functions is "
            f"{self.sign_functions}; make them equal": (
                self.start_ks[0] == self.sign_functions
            ),
            f"fit_ks end at {self.fit_ks[-1]}, start_ks at {size}; make them equal": (
                self.fit_ks[-1] == size
            ),
            f"fit_ks begin at {self.fit_ks[0]}, fit_size is {self.fit_size}; fit more "
            "functions": self.fit_ks[0] <= self.fit_size,
            f"flip_range ends at {end}, flip_ks begin at {self.flip_ks[0]}; make them "
            "equal": self.flip_ks[0] == end,
            f"flip_range is {self.flip_range}, starts have {size} functions": (
                0 < self.flip_range[0] < end <= size
            ),
            f"final_ks begin at {self.final_ks[0]}, flip_ks end at {self.flip_ks[-1]}; "
            "begin with no more": self.final_ks[0] <= self.flip_ks[-1],
            f"assigned is {self.assigned}, extremities {self.extremities}; assign 3 or "
            "more, and no more than there are": (
                3 <= self.assigned <= self.extremities <= self.samples
            ),
            f"assignment_ks end at {self.assignment_ks[-1]}, final_ks begin at "
            f"{self.final_ks[0]}; end with no fewer": (
                self.assignment_ks[-1] >= self.final_ks[0]
            ),
            f"nonisometric_candidates is {self.nonisometric_candidates}, assignments "
            f"{self.assignments}; keep 1 or more, and no more than there are": (
                1 <= self.nonisometric_candidates <= self.assignments
            ),
            f"samples is {self.samples}, final_samples {self.final_samples}; it must "
            "not be more": self.samples <= self.final_samples,
        }
        for message, holds in facts.items():
            if not holds:
                raise ValueError(f"SearchSettings: {message}")

    @property
    def starts(self) -> int:
        """Maps that the search begins with."""
        patterns = 2 ** (self.sign_functions - 1)
        fits = len(self.fits) + len(self.orthogonal_fits)
        return len(self.descriptor_weights) * patterns + fits

    @property
    def flips(self) -> int:
        """Maps that are made of each of the best starts, itself included."""
        first, end = self.flip_range
        return 1 + end - first

    @property
    def parents(self) -> int:
        """Starts that are kept and flipped."""
        return min((self.hypotheses - self.starts) // self.flips, self.starts)

    @property
    def eigenpairs(self) -> int:
        """Eigenpairs that both spectra need."""
        sizes = *self.start_ks, *self.fit_ks, *self.flip_ks, *self.final_ks
        return max(self.fit_size, *sizes, *self.assignment_ks)

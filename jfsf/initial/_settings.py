"""How the search for an initial map works, in numbers.

The numbers in upper case were tuned together, on FAUST, TOSCA and the embedded shapes;
`experiments/fit/fit_starts.py` compares the fits. The sizes of the bases follow each
other: a stage begins where the one before it ends, or below.
"""

from dataclasses import dataclass

from jfsf.initial._terms import Weights
from jfsf.refine import ZoomOutSettings

# First eigenfunctions, the constant included, whose sign patterns are all tried.
SIGN_FUNCTIONS = 5
# Of the columns beside the eigenfunctions, for the starts: each sign pattern is tried
# with each. The best weight depends on the shapes. With 0.5 the legs of TOSCA's dogs
# are exchanged, with 1 the hands of the embedded child.
DESCRIPTOR_WEIGHTS = (0.0, 0.5, 1.0)
START_KS = (5, 7, 9, 12, 16, 20)  # sizes of the basis for the starts, see `zoomout`
# Weights of the fits to descriptors, which are starts too; the size of these functional
# maps; and the sizes of the basis in which they are refined.
FIT_WEIGHTS = Weights(1.0, 0.1, 0.1, 0.1), Weights(1.0, 1.0, 1.0, 1.0)
FIT_SIZE = 30
FIT_KS = (16, 20)
# The eigenfunctions whose signs are flipped one at a time in the best starts: functions
# that are odd from front to back are among them. Then the sizes of the basis.
FLIP_RANGE = (6, 16)
FLIP_KS = (16, 18, 21, 24, 28, 33, 40)
FINAL_KS = (30, 30, 30, 40)  # sizes of the basis for the last candidates
EIGENPAIRS = 40  # that both spectra need: the largest basis
STARTS = len(DESCRIPTOR_WEIGHTS) * 2 ** (SIGN_FUNCTIONS - 1) + len(FIT_WEIGHTS)
FLIPS = 1 + FLIP_RANGE[1] - FLIP_RANGE[0]  # maps made of a start, itself included

# Extremities found on each shape, and how many of them are assigned in one start. Two
# shapes may have unequal numbers of limbs.
EXTREMITIES = 7
ASSIGNED = 5
ASSIGNMENT_KS = (8, 10, 13, 16, 20, 25, 30)  # sizes of the basis for these starts
# Of the distances to assigned extremities beside eigenfunctions.
EXTREMITY_WEIGHT = 2.0
# Of descriptors where proportions differ: then so do descriptors, and more spoils right
# maps.
NONISOMETRIC_DESCRIPTOR_WEIGHT = 0.1
# Of what assigned extremities differ in, beside `log_stretch_std` of a map.
DIFFERENCE_WEIGHT = 0.4

COMPARED = 20  # leading rows and columns in which two functional maps are compared
# Share of that block's energy in which two candidates must differ.
MIN_DIFFERENCE = 0.04
CURVATURE_ENERGY = 0.125  # of curvatures that differ by one standard deviation
# Of a map that keeps orientation on half of the shape and mirrors the other half.
HALF_MIRRORED_ENERGY = 0.2
WRONG_ORIENTATION_ENERGY = 100.0  # more than any other energy
ZOOMOUT = ZoomOutSettings()  # in all refinements of the search


@dataclass(frozen=True)
class SearchSettings:
    """How `candidates` searches. Hashable, for static arguments.

    hypotheses: functional maps that are tried, at most; time grows with them. The
        default is all starts, the best ten of them, and these with each flip.
    descriptor_weight: of descriptors, curvature and oriented products beside the
        eigenfunctions, after the starts and in the refinement. A larger one exchanges
        hands even from a right start.
    assignments: starts that bring extremities together, for shapes of other
        proportions: those that change distances between extremities most evenly and
        bring together extremities that look alike.
    nonisometric_candidates: maps of these starts that are kept. Later ones are right
        where the first is not.
    samples: farthest points on which hypotheses are refined.
    final_samples: farthest points on which the last candidates are refined and ranked.
    """

    hypotheses: int = 160
    descriptor_weight: float = 0.5
    assignments: int = 160
    nonisometric_candidates: int = 8
    samples: int = 300
    final_samples: int = 1000

    def __post_init__(self) -> None:
        """ValueError for numbers that do not fit each other."""
        facts = {
            f"hypotheses is {self.hypotheses}, the least is {STARTS + FLIPS}": (
                self.hypotheses >= STARTS + FLIPS
            ),
            f"nonisometric_candidates is {self.nonisometric_candidates}, assignments "
            f"{self.assignments}; keep 1 or more, and no more than there are": (
                1 <= self.nonisometric_candidates <= self.assignments
            ),
            f"samples is {self.samples}; there are {EXTREMITIES} extremities among "
            "them": self.samples >= EXTREMITIES,
            f"samples is {self.samples}, final_samples {self.final_samples}; it must "
            "not be more": self.samples <= self.final_samples,
        }
        for message, holds in facts.items():
            if not holds:
                raise ValueError(f"SearchSettings: {message}")

    @property
    def parents(self) -> int:
        """Starts that are kept and flipped."""
        return min((self.hypotheses - STARTS) // FLIPS, STARTS)

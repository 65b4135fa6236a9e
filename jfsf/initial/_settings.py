"""How much the search tries, and the sizes of the basis it goes through."""

from dataclasses import dataclass

from jfsf.array._jit import check_types
from jfsf.initial._terms import Weights

# Starts: all sign patterns of the first eigenfunctions, the constant included, with
# each weight of the columns beside the eigenfunctions. The best weight depends on the
# shapes. With 0.5 the legs of TOSCA's dogs are exchanged, with 1 the hands of the
# embedded child.
SIGN_FUNCTIONS = 5
START_WEIGHTS = (0.0, 0.5, 1.0)
# Sizes of the basis for these starts (`zoomout`); the first is `SIGN_FUNCTIONS`.
START_KS = (5, 7, 9, 12, 16, 20)
# Fits to descriptors are starts too: their weights, their size, and sizes of the basis,
# which end where those of the other starts do.
FITS = Weights(1.0, 0.1, 0.1, 0.1), Weights(1.0, 1.0, 1.0, 1.0)
FIT_SIZE = 30
FIT_KS = (16, 20)
# Eigenfunctions whose signs are flipped one at a time in the best starts: functions
# that are odd from front to back are among them. Then sizes of the basis after a flip.
FLIP_RANGE = (6, 16)
FLIP_KS = (16, 18, 21, 24, 28, 33, 40)
# Sizes of the basis for starts from extremities.
ASSIGNMENT_KS = (8, 10, 13, 16, 20, 25, 30)
# Maps that the search begins with, and that are made of each of the best of these.
STARTS = len(START_WEIGHTS) * 2 ** (SIGN_FUNCTIONS - 1) + len(FITS)
FLIPS = 1 + FLIP_RANGE[1] - FLIP_RANGE[0]


@dataclass(frozen=True)
class SearchSettings:
    """How much `candidates` tries. Hashable, for static arguments.

    hypotheses: most functional maps that are tried; time grows with their number. The
        default allows all starts, the best ten of them again, and these with each flip.
    descriptor_weight: weight of the columns beside the eigenfunctions, once the starts
        are refined. With a larger one, hands are exchanged even from a right start.
    samples: number of farthest points on which hypotheses are refined.
    final_samples: number of farthest points on which the last candidates are refined
        and ranked.
    final_ks: sizes of the basis in the refinement of the last candidates.
    assignments: number of starts of `nonisometric_candidates`, assignments of
        extremities to extremities.
    nonisometric_candidates: number of maps that `nonisometric_candidates` returns.
        Later ones are right on some pairs where the first is not.
    """

    hypotheses: int = 160
    descriptor_weight: float = 0.5
    samples: int = 300
    final_samples: int = 1000
    final_ks: tuple[int, ...] = (30, 30, 30, 40)
    assignments: int = 160
    nonisometric_candidates: int = 8

    def __post_init__(self) -> None:
        """ValueError for numbers that do not fit each other."""
        check_types(self)
        least, first = STARTS + FLIPS, self.final_ks[0]
        facts = {
            f"hypotheses is {self.hypotheses}, the least is {least}": (
                self.hypotheses >= least
            ),
            f"final_ks begin at {first}; begin with {ASSIGNMENT_KS[-1]} or fewer": (
                first <= ASSIGNMENT_KS[-1]
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
    def parents(self) -> int:
        """Starts that are kept and flipped."""
        return min((self.hypotheses - STARTS) // FLIPS, STARTS)

    @property
    def eigenpairs(self) -> int:
        """Eigenpairs that both spectra need."""
        return max(FIT_SIZE, *START_KS, *FLIP_KS, *ASSIGNMENT_KS, *self.final_ks)

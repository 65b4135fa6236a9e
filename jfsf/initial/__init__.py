"""The initial functional map: fits to descriptors, and a search among many maps.

Read in this order:

- `_terms`: both shapes' terms of the energy that a fit to descriptors minimises
- `_linear`: its minimum, by jaxopt or lineax
- `_nonlinear`: robust losses and orthogonality, by optimistix
- `_fit`: descriptors to a functional map by any of these
- `_settings`: the numbers of the search
- `_geodesics`: distances between samples
- `_ends`: what the ends of limbs look like
- `_samples`: a shape at samples, which is all that the search reads
- `_hypotheses`: refine maps on samples, their energy, and the best that differ
- `_seeds`: sign patterns, fits to descriptors, and flips
- `_search`: the search among these, and the ranking
- `_extremities`: extremities, and which of X may belong to which of Y
- `_proportions`: candidates from extremities, and how unevenly a map stretches
- `_given`: what two spectra are given beside them, checked
- `_start`: candidates to the starts of attempts
"""

from jfsf.initial._fit import fit
from jfsf.initial._given import given_arrays
from jfsf.initial._hypotheses import (
    SamplePair,
    best_different,
    energies,
    refine_hypotheses,
)
from jfsf.initial._linear import Fit, solve
from jfsf.initial._nonlinear import solve_nonlinear
from jfsf.initial._proportions import log_stretch_std, nonisometric_candidates
from jfsf.initial._samples import SearchSamples, search_samples
from jfsf.initial._search import (
    Candidates,
    Orientation,
    candidates,
    orientation_sign,
    search,
)
from jfsf.initial._settings import SearchSettings
from jfsf.initial._start import (
    Start,
    best_start,
    nonisometric_starts,
    search_starts,
)
from jfsf.initial._terms import ShapeTerms, Terms, Weights, combine, shape_terms, terms

__all__ = [
    "Candidates",
    "Fit",
    "Orientation",
    "SamplePair",
    "SearchSamples",
    "SearchSettings",
    "ShapeTerms",
    "Start",
    "Terms",
    "Weights",
    "best_different",
    "best_start",
    "given_arrays",
    "candidates",
    "combine",
    "energies",
    "nonisometric_candidates",
    "nonisometric_starts",
    "fit",
    "orientation_sign",
    "refine_hypotheses",
    "search",
    "search_samples",
    "search_starts",
    "shape_terms",
    "solve",
    "solve_nonlinear",
    "terms",
    "log_stretch_std",
]

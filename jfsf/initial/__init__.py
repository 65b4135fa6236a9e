"""The initial functional map: fits to descriptors, and a search among many maps.

Read in this order:

- `_terms`: both shapes' terms of the energy that a fit to descriptors minimises
- `_linear`: its minimum, by jaxopt or lineax
- `_fit`: descriptors to a functional map; robust losses, orthogonality (optimistix)
- `_settings`: how much the search tries, and the sizes it goes through
- `_samples`: a shape at samples, which is all that the search reads
- `_hypotheses`: refine maps on samples, their energy, and the best that differ
- `_search`: the search from sign patterns, fits and flips, and the ranking
- `_extremities`: extremities, and which of X may belong to which of Y
- `_proportions`: candidates from extremities, and how unevenly a map stretches
- `_start`: what spectra are given, checked; candidates to the starts of attempts
"""

from typing import TYPE_CHECKING

from jfsf._moved import names_of
from jfsf.initial._fit import fit
from jfsf.initial._linear import Fit
from jfsf.initial._proportions import nonisometric_candidates
from jfsf.initial._search import Candidates, candidates, orientation_sign, search
from jfsf.initial._settings import SearchSettings
from jfsf.initial._start import Start, search_starts
from jfsf.initial._terms import Weights

__all__ = [
    "Candidates",
    "Fit",
    "SearchSettings",
    "Start",
    "Weights",
    "candidates",
    "fit",
    "nonisometric_candidates",
    "orientation_sign",
    "search",
    "search_starts",
]

if not TYPE_CHECKING:
    __getattr__ = names_of(__name__)

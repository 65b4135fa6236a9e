"""Features -> SearchSamples: a shape at samples, all that the search reads of it."""

from typing import NamedTuple

from jaxtyping import Array, Float, Int

from jfsf._exported import exported
from jfsf.array._jit import jit
from jfsf.initial._ends import total_curvatures
from jfsf.initial._geodesics import sample_cells, sample_geodesics
from jfsf.initial._settings import FIT_SIZE, SearchSettings
from jfsf.initial._terms import ShapeTerms, shape_terms
from jfsf.spectral import Features, farthest_points


@exported
class SearchSamples(NamedTuple):
    """A shape at samples.

    search_points: features at `SearchSettings.samples` vertices, on which maps are
        refined; all vertices if there are fewer.
    ranking_points: features at `SearchSettings.final_samples` vertices, on which the
        last candidates are ranked.
    fit: for the fits to descriptors.
    geodesics: distances between the search points, see `sample_geodesics`.
    total_curvatures: total curvatures of their cells.
    """

    search_points: Features
    ranking_points: Features
    fit: ShapeTerms
    geodesics: Float[Array, "s s"]
    total_curvatures: Float[Array, "s 2"]


@jit(static_argnames="settings")
def search_samples(
    features: Features,
    among: Int[Array, " p"] | None = None,
    *,
    settings: SearchSettings = SearchSettings(),
) -> SearchSamples:
    """The shape at farthest points; the only stage of the search that depends on n.

    Args:
        features: of the whole shape.
        among: vertices that samples are chosen from, see `farthest_points`.
        settings: how many samples.

    Raises:
        ValueError: fewer eigenpairs than the settings need.
    """
    spec = features.spec
    if len(spec.evals) < settings.eigenpairs:
        raise ValueError(
            f"search_samples: the spectrum has {len(spec.evals)} eigenpairs, the "
            f"search needs {settings.eigenpairs}"
        )
    num = min(settings.final_samples, len(spec.mass if among is None else among))
    chosen = farthest_points(spec, among, num=num)
    # Each point is the farthest from those before it, so the first are samples too.
    search_points, ranking_points = (
        features.at(chosen[:count])
        for count in (settings.samples, settings.final_samples)
    )
    fit = shape_terms(spec, features.descriptors, k=FIT_SIZE)
    at = chosen[: settings.samples]
    cells = sample_cells(spec, at)
    geodesics = sample_geodesics(spec, at, cells)
    return SearchSamples(
        search_points, ranking_points, fit, geodesics, total_curvatures(spec, at, cells)
    )

"""What each figure of a certificate means: one table for all that names a figure.

The documentation of `jfsf.types.Certificate`, files of matches, the tables of reports
and the tests read `FIGURES`. A new figure is an entry here and a field there.
"""

import textwrap
from typing import NamedTuple

OLDEST = "0.2"  # the first release whose files of matches are read


class Figure(NamedTuple):
    """What a single number of a certificate means.

    meaning: a phrase for tables.
    detail: sentences for the documentation.
    unknown: why the figure may be nan; empty if it never is.
    in_place: what tables say in place of nan.
    since: the release whose files of matches are the first to have the figure.
    formerly: the figure's name in older files; empty if they lack it.
    """

    meaning: str
    detail: str = ""
    unknown: str = ""
    in_place: str = "not measured"
    since: str = OLDEST
    formerly: str = ""


_NO_PLAN = "the last conversion made no transport plan"
_NO_SAMPLES = "the shapes were not sampled"
_NOT_BENT = "the shapes were not bent onto each other as surfaces"
_ALONE = "no other map was tried"

# In the order of the fields of `Certificate`.
FIGURES: dict[str, Figure] = {
    "marginal_error": Figure(
        "gap of the transport plan to its marginals; 0 is exact",
        "In l1, as a fraction of all mass.",
        _NO_PLAN,
    ),
    "empty": Figure("vertices of either shape that no mass reached"),
    "coverage_xy": Figure(
        "share that T_xy hits of the area of Y that n_x vertices could hit",
        "If X has fewer vertices than Y, they could hit no more than n_x / n_y of Y.",
    ),
    "coverage_yx": Figure(
        "share that T_yx hits of the area of X that n_y vertices could hit",
        "If Y has fewer vertices than X, they could hit no more than n_y / n_x of X.",
    ),
    "bijectivity_x": Figure(
        "mean distance, X to Y and back; 1 for random vertices",
        "The biharmonic distance on X.",
    ),
    "bijectivity_y": Figure(
        "mean distance, Y to X and back; 1 for random vertices",
        "The biharmonic distance on Y.",
    ),
    "orthogonality": Figure("|C^T C - I|; 0 if areas are kept", "The spectral norm."),
    "orientation": Figure(
        "whether left and right are kept, from -1 to 1",
        "A correlation: about +0.9 for a map that preserves orientation, -0.9 for a "
        "mirrored one.",
        "a point cloud without a clear outside (see `jfsf.mesh.reconstruct`)",
        "unknown",
    ),
    "gap": Figure(
        "extra energy of the second candidate, relative; 0 is a tie",
        "The energy (`Candidates.energy`) of the search's second candidate over that "
        "of its first, minus 1. Where an orientation is asked for, mirrored candidates "
        "do not count. inf if no second candidate differs. Of parts: the log odds "
        "minus those of the next map that was refined.",
        "no second candidate was compared",
        "no rival",
    ),
    "mirror_gap": Figure(
        "extra energy of the mirror image, relative; below 0 it has less",
        "The energy of the search's best candidate of the other orientation over that "
        "of the best of the orientation asked for, minus 1.",
        "no orientation was asked for, or no search was made",
        "not known",
        since="0.3",
    ),
    "nn_agreement": Figure(
        "share that nearest neighbour maps alike", "Of the vertices of X.", _NO_PLAN
    ),
    "recall": Figure(
        "share of neighbours that the last search found",
        "An estimate, of a sample: of the nearest where there are tiles, else of all "
        "neighbours; 1 where all are found.",
        _NO_PLAN,
        since="0.3",
    ),
    "finite": Figure("whether every number that the map is made from is finite"),
    "energy": Figure(
        "departure from an isometry",
        "Of the final functional map, at samples (`jfsf.initial`).",
        _NO_SAMPLES,
    ),
    "log_stretch_std": Figure(
        "how unevenly the map stretches; 0 for a similarity",
        "The standard deviation of the logarithm of the final functional map's "
        "stretch, at samples.",
        _NO_SAMPLES,
        since="0.3",
        formerly="unevenness",
    ),
    "residual": Figure(
        "distance left between the bent shapes, in sqrt(area)",
        "The mean over both shapes, along the normal.",
        _NOT_BENT,
    ),
    "shear": Figure(
        "shear of triangles by the bending, but for the 1 % sheared most; 0 for none",
        "The logarithm of the larger over the smaller stretch.",
        _NOT_BENT,
    ),
    "area_std": Figure(
        "how unevenly the bending lets triangles grow; 0 if evenly",
        "The standard deviation of the logarithm by which they grow.",
        _NOT_BENT,
    ),
    "normal_gap": Figure(
        "how far normals of the bent shapes differ; 0 if not at all",
        "From the normals at the images of the vertices.",
        _NOT_BENT,
    ),
    "spectrum_gap": Figure(
        "how unlike the shapes are; 0.1 for poses, 1 for other limbs",
        "The largest difference of the logarithms of their first eigenvalues, whatever "
        "the map.",
        "an older version made the file",
        since="0.3",
    ),
    "region_cost": Figure(
        "what drawing one part onto the other leaves; small is good",
        "Of parts: what is left apart, how much the drawn shape bends, and how little "
        "of the part it covers.",
        "the shapes were matched as wholes",
    ),
    "person_agreement": Figure(
        "how well the map agrees with a network that knows people; 1 is best",
        "Of the places on a person where it sees each vertex and its image, on coarse "
        "copies (`jfsf.learned`).",
        "whole shapes were not in doubt, or the pair has few vertices, or the network "
        "did not take it for people",
        "not asked",
        since="0.3",
    ),
    "log_odds": Figure(
        "of a right map, by its own evidence; 0 is one half",
        "A logistic regression (`jfsf/matching/confidence.json`).",
        _NOT_BENT,
    ),
    "share": Figure(
        "of the odds, among maps that differ; 0.5: another fits as well",
        "The odds of the map over the sum of those of all maps that differ and were "
        "compared with it.",
        _ALONE,
        "not compared",
    ),
    "rivals": Figure(
        "other maps that fit as well, of those that were tried",
        "All of them differ. Of a shape with a symmetry they are as good as this one.",
        _ALONE,
        "not compared",
        since="0.3",
    ),
    "mirrored": Figure(
        "probability that the mirror image is right instead",
        "Then one of the shapes is mirrored.",
        "the mirror image was not tried",
        "not compared",
        since="0.3",
    ),
    "confidence": Figure(
        "probability that the map is right",
        "Right is a mean geodesic error below 0.1 of sqrt(area). Read from `log_odds` "
        "and `share`; with n rivals it is 1 / (1 + n) at most. Lower if the map misses "
        "landmarks, if its mirror image fits far better, and for shapes of different "
        "kinds (`spectrum_gap`); half where left and right cannot be told. Of parts it "
        "is that of the region that both share.",
        "shapes that were not bent as surfaces, and parts whose units may differ, have "
        "none",
        "unknown",
    ),
}


def explained(name: str) -> str:
    """A figure as an entry of the docstring of `Certificate`."""
    figure = FIGURES[name]
    nan = figure.unknown and f"nan: {figure.unknown}."
    text = " ".join(filter(None, (f"{name}: {figure.meaning}.", figure.detail, nan)))
    return textwrap.fill(text, 84, initial_indent="    ", subsequent_indent=" " * 8)

"""A certificate in words: how sure, why, and what to try.

This file is long because all sentences on a map are in one place.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jfsf._figures import FIGURES
from jfsf.matching import Settings
from jfsf.matching._confidence import MIRRORED, UNLIKE
from jfsf.matching._kept_landmarks import MISSED
from jfsf.types import Certificate, MatchInfo

# A figure of the certificate beyond one of these limits gives a warning. How many maps
# that are likely are wrong, and how many right ones are below 0.7, is in
# jfsf/matching/confidence.json: `held_out`, of sets that it was not fitted to.
LIKELY = Settings().retry_below  # so sure that `match` makes no second attempt
DOUBTFUL = 0.7
# The score of right maps is about 0.9 and of mirrored ones about -0.9. Below half, a
# part of the shape is likely to be mirrored.
MIN_ORIENTATION = 0.5
# Right maps hit about 0.9 of the area, or of what few vertices can hit. One that misses
# half of it has collapsed there.
MIN_COVERAGE = 0.5
# A tenth of the mean distance of two random vertices is many edges: beyond it the two
# maps contradict each other.
MAX_BIJECTIVITY = 0.1
# The last search among tiles then misses one nearest neighbour in ten, and the map may
# be uneven there. It need not be wrong: of a million vertices the recall was 0.88 at an
# error of 0.013 (experiments/results/bench_million.json).
MIN_RECALL = 0.9
# Below, another map fits the shapes nearly as well. Right maps have such rivals too.
SMALL_GAP = 0.1
# Of the odds of all maps that were compared: below, another one fits better.
MIN_SHARE = 0.5
# Of a map that stands alone among them.
LARGE_SHARE = 0.9


class Finding(NamedTuple):
    """Something that makes a map doubtful.

    why: one line.
    advice: what to try, in sentences.
    """

    why: str
    advice: str


def verdict(confidence: float) -> str:
    """The confidence of a certificate in words."""
    if np.isnan(confidence):
        return f"unknown: {FIGURES['confidence'].unknown}"
    if confidence >= LIKELY:
        return "very likely right"
    if confidence >= DOUBTFUL:
        return "probably right"
    return "doubtful" if confidence >= 0.5 else "probably wrong"


def level(confidence: float) -> str:
    """The colour of a confidence on a page: good, fair, poor or unknown."""
    if np.isnan(confidence):
        return "unknown"
    if confidence >= LIKELY:
        return "good"
    return "fair" if confidence >= DOUBTFUL else "poor"


def readings(certificate: Certificate) -> dict[str, tuple[str, str]]:
    """Figure of the certificate -> its value as text, and what it means."""
    score = float(certificate.orientation)
    side = "keeps left and right" if score > 0 else "swaps left and right"
    side = "unclear: parts may be flipped" if abs(score) < MIN_ORIENTATION else side
    meaning = {
        "orientation": side,
        "confidence": verdict(float(certificate.confidence)),
    }
    if np.isinf(certificate.gap):
        meaning["gap"] = "no second candidate differs from the first"
    elif _of_parts(certificate):
        meaning["gap"] = "log odds beyond those of the next region; 0 is a tie"
    texts = {}
    for name, value in certificate.figures().items():
        figure, value = FIGURES[name], np.asarray(value)
        form = "+.2f" if name == "orientation" else ".4g"
        text = ("no", "yes")[int(value)] if value.dtype == bool else f"{value:{form}}"
        if np.isnan(value):
            texts[name] = figure.in_place, figure.unknown or figure.meaning
        else:
            text = figure.in_place if np.isinf(value) else text
            texts[name] = text, meaning.get(name, figure.meaning)
    return texts


def findings(
    certificate: Certificate, orientation: str, *, landmarks: Sequence[str] = ()
) -> list[Finding]:
    """Each figure of the certificate that makes the map doubtful, gravest first.

    Args:
        certificate: the certificate of one map.
        orientation: "preserve", "reverse" or "any", as the map was asked for.
        landmarks: their names, in the order of the rows, where they have any.
    """
    figure = _numbers(certificate)
    score, likely = figure["orientation"], figure["confidence"]
    agrees = {"preserve": score, "reverse": -score, "any": abs(score)}[orientation]
    other = "preserve" if orientation == "reverse" else "reverse"
    covered = min(figure["coverage_xy"], figure["coverage_yx"])
    away = max(figure["bijectivity_x"], figure["bijectivity_y"])
    parts = _of_parts(certificate)
    known = [
        (
            not bool(certificate.finite),
            "a number is not finite: do not use this map",
            "Look for broken triangles with `jfsf info`, and repair the mesh.",
        ),
        (
            agrees < MIN_ORIENTATION,
            f"orientation {score:+.2f} is not what {orientation!r} asks for: left and "
            "right, or front and back, may be swapped; landmarks decide",
            "Give one pair of vertices that you know (--landmarks), or try "
            "--orientation any.",
        ),
        (
            figure["mirrored"] > MIRRORED,
            "the mirror image fits far better; is one of them mirrored? try "
            f"--orientation {other}",
            "Left and right of one shape may be exchanged, as in a scan that was "
            "mirrored, or of a left bone and a right one. Then match again with "
            f"--orientation {other}.",
        ),
        (
            figure["rivals"] > 0,
            f"several maps fit equally well: {_number(certificate)} that differ were "
            "found, and there may be more; a landmark decides",
            "The shape has rotations, or parts that are alike. See the candidates, and "
            "`jfsf.alternatives` for the maps; one or two pairs of vertices that you "
            "know (--landmarks) say which map is meant.",
        ),
        (
            figure["spectrum_gap"] > UNLIKE,
            "the shapes are of different kinds, and the confidence was fitted to "
            "others: eigenvalues differ by a factor of "
            f"{np.exp(figure['spectrum_gap']):.1f}",
            "See whether both files are what you think, and whether one shape is a "
            "part of the other (--partial). Landmarks at all ends may help.",
        ),
        (
            np.isnan(score) and orientation != "any" and not len(certificate.landmarks),
            f"left and right cannot be told, so {orientation!r} is not kept: a shape "
            "has no faces, and its points no clear outside",
            "See whether the map is mirrored. One pair of vertices that you know "
            "decides (--landmarks); so do faces.",
        ),
        (
            likely < DOUBTFUL and not parts,
            f"{verdict(likely)}, confidence {likely:.0%}: look at the picture; "
            "landmarks at hands, feet and head decide",
            "See whether a candidate looks right where the map does not. Then give "
            "landmarks at the ends: hands, feet, head (--landmarks).",
        ),
        (
            likely < DOUBTFUL and parts,
            f"the region is {verdict(likely)}, confidence {likely:.0%}: look at the "
            "picture; landmarks decide",
            "See whether what is grey on Y is what X lacks. Then give landmarks that "
            "both shapes have (--landmarks).",
        ),
        (
            np.isnan(likely) and parts,
            "how likely the region is right is not known where units may differ: look "
            "at the picture; landmarks, or one unit, decide",
            "See whether what is grey on Y is what X lacks. Give both shapes in one "
            "unit if you can, or landmarks that both have (--landmarks).",
        ),
        (
            # Where several fit equally well that is said already.
            figure["share"] < MIN_SHARE and not figure["rivals"] > 0,
            f"another map that differs fits as well or better (share "
            f"{figure['share']:.0%}); landmarks decide",
            "Look at the maps of `jfsf.alternatives`, and give landmarks where they "
            "differ (--landmarks).",
        ),
        (
            covered < MIN_COVERAGE,
            f"only {covered:.0%} of the area that could be hit is hit: the shapes may "
            "differ too much",
            "See whether both shapes are whole, and whether they have the same parts.",
        ),
        (
            away > MAX_BIJECTIVITY,
            f"there and back again ends {away:.2f} away: the maps disagree",
            "Colour by there and back to see where, and trust the rest.",
        ),
        (
            figure["recall"] < MIN_RECALL,
            f"the last search found {figure['recall']:.0%} of the nearest "
            "neighbours: the map may be uneven",
            "Search among more tiles (`NeighbourSettings.tiles`).",
        ),
        (
            figure["empty"] > 0,
            f"{figure['empty']:.0f} {'vertices' if figure['empty'] > 1 else 'vertex'} "
            "got no mass",
            "A few do no harm. Many: remesh the shapes more evenly.",
        ),
    ]
    doubts = [Finding(why, advice) for wrong, why, advice in known if wrong]
    for row in np.flatnonzero(np.asarray(certificate.landmarks) > MISSED):
        name = landmarks[int(row)] if row < len(landmarks) else ""
        named = f" ({name})" if name else ""
        why = f"landmark {row + 1}{named} ends far from its partner: check that row"
        advice = "Either the row is wrong, or the map is. Try without it."
        doubts.append(Finding(why, advice))
    return doubts


def _numbers(certificate: Certificate) -> dict[str, float]:
    return {name: float(value) for name, value in certificate.figures().items()}


def _number(certificate: Certificate) -> int:
    """All maps that fit equally well, the one at hand included."""
    return 1 + int(np.nan_to_num(float(certificate.rivals)))


def warnings_of(
    certificate: Certificate, orientation: str, *, landmarks: Sequence[str] = ()
) -> list[str]:
    """A line for each figure of the certificate that makes the map doubtful.

    Args:
        certificate, orientation, landmarks: as `findings`.
    """
    doubts = findings(certificate, orientation, landmarks=landmarks)
    return [finding.why for finding in doubts]


def in_short(
    certificate: Certificate, orientation: str, *, landmarks: Sequence[str] = ()
) -> list[str]:
    """Three lines: whether a map is sure, why, and what to do.

    Args:
        certificate, orientation, landmarks: as `findings`.
    """
    figure, likely = _numbers(certificate), float(certificate.confidence)
    doubts = findings(certificate, orientation, landmarks=landmarks)
    sure = verdict(likely) + ("" if np.isnan(likely) else f", confidence {likely:.0%}")
    if doubts:
        sure += "; but see why" if likely >= DOUBTFUL else ""
        why, to_do = "; ".join(one.why for one in doubts), doubts[0].advice
    else:
        known = [
            (
                figure["residual"],
                "bent onto each other, the shapes stay {:.2%} of sqrt(area) apart",
            ),
            (
                max(figure["bijectivity_x"], figure["bijectivity_y"]),
                "there and back again ends {:.3f} away, where 1 is random",
            ),
        ]
        said = [words.format(value) for value, words in known if value == value]
        score = figure["orientation"]
        if abs(score) >= MIN_ORIENTATION:
            said.insert(0, f"left and right are {'kept' if score > 0 else 'swapped'}")
        why = "; ".join(said)
        to_do = (
            "nothing" if likely >= LIKELY else "look at the picture (--png, --report)"
        )
        to_do += "; --verbose shows all figures"
    return [sure, f"why: {why}", f"to do: {to_do}"]


def reasons(certificate: Certificate, info: MatchInfo | None = None) -> list[str]:
    """Sentences on what the confidence rests on, each with its number.

    Args:
        certificate: the certificate of one map.
        info: how the match was found, for a sentence on the starts that were attempted.
    """
    figure = _numbers(certificate)
    sentences = []
    score = figure["orientation"]
    if np.isnan(score):
        sentences.append("Left and right cannot be told: a cloud has no clear outside.")
    elif abs(score) < MIN_ORIENTATION:
        sentences.append(f"Left and right are unclear (score {score:+.2f}).")
    else:
        way = "keeps" if score > 0 else "swaps"
        sentences.append(f"It {way} left and right (score {score:+.2f}, at most 1).")
    if not np.isnan(figure["residual"]):
        sentences.append(
            f"Bent onto each other, the shapes stay {figure['residual']:.4f} of "
            f"sqrt(area) apart, triangles are sheared by up to {figure['shear']:.2f} "
            "(but for the 1 % sheared most), and normals differ by "
            f"{figure['normal_gap']:.3f}."
        )
    if np.isnan(figure["confidence"]):
        sentences.append(
            "There is no confidence: it was fitted to shapes that are bent onto each "
            "other as surfaces, and to parts in one unit."
        )
    elif _of_parts(certificate):
        sentences.append(
            "The confidence is read from the log odds of the map between the regions "
            f"({figure['log_odds']:+.2f}), and from how well one shape lies on the "
            f"other where it was drawn onto it (cost {figure['region_cost']:.1f})."
        )
    else:
        sentences.append(
            "The confidence is read from the bending and the score, and from how the "
            "map stands among others where these were tried."
        )
    if not np.isnan(share := figure["share"]):
        other = "none fits" if share >= LARGE_SHARE else "another one fits"
        how = "nearly as well" if share >= MIN_SHARE else "as well or better"
        sentences.append(
            f"Of the other maps that were tried {other} {how} (share {share:.0%})."
        )
    if not np.isnan(agreed := figure["person_agreement"]):
        sentences.append(
            "A network that knows people took both shapes for people, and agrees with "
            f"the map ({agreed:.2f}, at most 1)."
        )
    if figure["rivals"] > 0:
        number = _number(certificate)
        sentences.append(f"It is one of {number} maps that fit equally well.")
    if figure["mirrored"] > MIRRORED:
        sentences.append(
            "The mirror image is the right map with a probability of "
            f"{figure['mirrored']:.0%}."
        )
    back = max(figure["bijectivity_x"], figure["bijectivity_y"])
    covered = min(figure["coverage_xy"], figure["coverage_yx"])
    sentences.append(
        f"There and back again ends {back:.3f} away, where 1 is the distance of two "
        f"random points; {covered:.0%} of the area that could be hit is hit, or more."
    )
    gap = figure["gap"]
    if _of_parts(certificate):
        if np.isfinite(gap):
            sentences.append(
                f"Its log odds are {gap:+.2f} beyond those of the next region that "
                "was refined."
            )
    elif np.isinf(gap):
        sentences.append("The search found no second map that differs.")
    elif gap < SMALL_GAP and not figure["confidence"] >= LIKELY:
        sentences.append(f"The second candidate fits nearly as well (gap {gap:.0%}).")
    elif gap >= SMALL_GAP:
        sentences.append(f"The second candidate fits worse (gap {gap:.0%}).")
    if info is not None:
        sentences.append(attempts(info))
    return sentences


def _of_parts(certificate: Certificate) -> bool:
    """Whether it is of a region that two shapes share."""
    return not np.isnan(float(certificate.region_cost))


def attempts(info: MatchInfo) -> str:
    """A sentence on the starts that were attempted, and the one that was kept."""
    if len(info.source) == 1:
        return f"One start was attempted ({info.start})."
    tried = ", ".join(
        f"{name} {'unknown' if np.isnan(confidence) else f'{confidence:.2f}'}"
        for name, confidence in zip(info.sources, info.confidence, strict=True)
    )
    return (
        f"{len(info.source)} starts were attempted ({tried}); number "
        f"{int(info.won) + 1} was kept."
    )

"""How a map stands among others that differ from it and fit nearly as well."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import expit, logsumexp

from jfsf.matching._confidence import COMPARED, rank
from jfsf.matching._kept_landmarks import MISSED
from jfsf.matching._settings import Settings
from jfsf.spectral._sampling import DISTANCE_PAIRS, biharmonic, rms_distance
from jfsf.types import Match, Spectrum

# Two maps differ if their images are so far apart in the mean, the mean distance of two
# random vertices being 1. With twice as much, two maps with one pair of legs exchanged
# count as one.
DISTINCT = 0.05
# What a map that misses all landmarks loses of its rank among others of the pair: more
# than most differences between them.
MISSED_RANK = 10.0
# Two maps are not versions of one if their images are so far apart in the mean, in that
# unit. Right maps of faces are up to 0.1 apart on coarse copies.
RIVAL = 0.2
# Two maps are rivals if the logarithms of their odds differ by no more: two meshes of
# one sphere differ by this much.
TIE = 1.0


class Ranking(NamedTuple):
    """How the m matches of one pair compare.

    share: (m,) of the odds of each match in those of all that differ from it.
    rank: (m,) of each match; more is better.
    differ: (m, m) whether two matches differ.
    distance: (m, m) the mean distance of the images of two matches (`map_distances`).
    """

    share: np.ndarray  # type: ignore
    rank: np.ndarray  # type: ignore
    differ: np.ndarray  # type: ignore
    distance: np.ndarray  # type: ignore


def share_among(
    matches: Sequence[Match],
    pair: tuple[Spectrum, Spectrum],
) -> Ranking:
    """Share of the odds of each match in those of all distinct ones.

        share_i = o_i / (o_i + sum_j o_j),  o = exp(c r),  r the rank,

    c = COMPARED["scale"] of confidence.json, over the matches j that differ from i, the
    best of each group of near copies. A map that misses landmarks ranks lower.
    Two matches differ if they are more than DISTINCT apart
    (`map_distances`).

    Args:
        matches: of one pair; a rank of nan counts as impossible.
        pair: the spectra of X and Y.

    Returns:
        Shares in [0, 1], 1 where nothing differs and nan where the rank is unknown;
        ranks; and which matches differ, and by how much.
    """
    distance = map_distances(matches, pair)
    differ = distance > DISTINCT
    rank_of = ranks(matches)
    odds = COMPARED["scale"] * rank_of
    order, shares = np.argsort(-odds, kind="stable"), []
    for i, own in enumerate(odds):
        rivals: list[int] = []
        for j in order:
            if differ[i, j] and all(differ[j, other] for other in rivals):
                rivals.append(j)
        known = np.isfinite(own) and len(rivals)
        margin = own - logsumexp(odds[rivals]) if known else np.inf
        shares.append(expit(margin) if np.isfinite(own) else np.nan)
    return Ranking(np.array(shares), rank_of, differ, distance)


def ranks(matches: Sequence[Match]) -> np.ndarray:
    """The rank of each match of one pair (`jfsf.matching._confidence.rank`), (m,).

    -inf where it is unknown. One that misses landmarks ranks lower, by
    MISSED_RANK if it misses all.
    """
    figures = [match.certificate._asdict() for match in matches]
    # On the host: so few numbers are not worth a program.
    found = np.nan_to_num([float(rank(np, **own)) for own in figures], nan=-np.inf)
    limit = MISSED
    missed = np.array([_missed(match, limit) for match in matches])
    return found - MISSED_RANK * missed


def rivals_among(
    matches: Sequence[Match], ranking: Ranking, *, settings: Settings = Settings()
) -> np.ndarray:
    """How many other maps each match cannot be told from, (m,).

    Where a match is so likely right by its own evidence that no second attempt is made
    (`Settings.retry_below`), its rivals are the others that are so likely too, whose
    images lie RIVAL away or more, and whose odds are no less than
    its own over exp(TIE). Of near copies one counts. Maps in doubt
    have no rivals: there `share_among` says more.

    Args:
        matches: of one pair.
        ranking: of these (`share_among`).
        settings: `retry_below` is read.
    """
    log_odds = [float(match.certificate.log_odds) for match in matches]
    likely = expit(np.nan_to_num(log_odds, nan=-np.inf)) >= settings.retry_below
    odds = COMPARED["scale"] * ranking.rank
    order, numbers = np.argsort(-odds, kind="stable"), []
    for i, own in enumerate(odds):
        chosen = [i]
        for j in order:
            tie = odds[j] >= own - TIE
            known = likely[i] and likely[j] and tie
            if known and ranking.distance[j, chosen].min() >= RIVAL:
                chosen.append(int(j))
        numbers.append(len(chosen) - 1)
    return np.array(numbers, float)


def map_distances(
    matches: Sequence[Match],
    pair: tuple[Spectrum, Spectrum],
    *,
    distance_pairs: int = DISTANCE_PAIRS,
) -> np.ndarray:
    """Mean distance between the images of X under each two of m maps, (m, m).

    It is the biharmonic distance on Y, relative to that of two random vertices.

    Args:
        matches: of one pair.
        pair: the spectra of X and Y; mass 0 is padding.
        distance_pairs: number of eigenpairs that the distance is computed from.
    """
    spec_x, spec_y = pair
    points = biharmonic(spec_y, distance_pairs)
    unit = float(rms_distance(points, spec_y.mass))
    points, mass = np.asarray(points), np.asarray(spec_x.mass)
    images = [points[np.asarray(match.T_xy)] for match in matches]
    apart = [[mass @ np.linalg.norm(a - b, axis=1) for b in images] for a in images]
    return np.array(apart) / (unit * mass.sum())


def _missed(match: Match, limit: float) -> float:
    """Share of the landmarks that a match misses; 0 without landmarks."""
    away = np.asarray(match.certificate.landmarks)
    return float(np.mean(away > limit)) if len(away) else 0.0

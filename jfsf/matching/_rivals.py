"""How a map stands among others that differ from it and fit nearly as well."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import expit, logsumexp

from jfsf.matching._confidence import COMPARED, rank
from jfsf.matching._settings import Settings
from jfsf.spectral._sampling import DISTANCE_PAIRS, biharmonic, rms_distance
from jfsf.types import Match, Spectrum


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
    *,
    settings: Settings = Settings(),
) -> Ranking:
    """Share of the odds of each match in those of all distinct ones.

        share_i = o_i / (o_i + sum_j o_j),  o = exp(c r),  r the rank,

    c = COMPARED["scale"] of confidence.json, over the matches j that differ from i, the
    best of each group of near copies. A map that misses landmarks ranks lower.
    Two matches differ if they are more than `EvidenceSettings.distinct` apart
    (`map_distances`).

    Args:
        matches: of one pair; a rank of nan counts as impossible.
        pair: the spectra of X and Y.
        settings: `evidence`, `distance_pairs`.

    Returns:
        Shares in [0, 1], 1 where nothing differs and nan where the rank is unknown;
        ranks; and which matches differ, and by how much.
    """
    distance = map_distances(matches, pair, distance_pairs=settings.distance_pairs)
    differ = distance > settings.evidence.distinct
    rank_of = ranks(matches, settings=settings)
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


def ranks(matches: Sequence[Match], *, settings: Settings = Settings()) -> np.ndarray:
    """The rank of each match of one pair (`jfsf.matching._confidence.rank`), (m,).

    -inf where it is unknown. One that misses landmarks ranks lower, by
    `EvidenceSettings.missed_rank` if it misses all.
    """
    figures = [match.certificate.figures() for match in matches]
    # On the host: so few numbers are not worth a program.
    found = np.nan_to_num([float(rank(np, **own)) for own in figures], nan=-np.inf)
    limit = settings.evidence.missed
    missed = np.array([_missed(match, limit) for match in matches])
    return found - settings.evidence.missed_rank * missed


def rivals_among(
    matches: Sequence[Match], ranking: Ranking, *, settings: Settings = Settings()
) -> np.ndarray:
    """How many other maps each match cannot be told from, (m,).

    Where a match is so likely right by its own evidence that no second attempt is made
    (`Settings.retry_below`), its rivals are the others that are so likely too, whose
    images lie `EvidenceSettings.rival` away or more, and whose odds are no less than
    its own over exp(`EvidenceSettings.tie`). Of near copies one counts. Maps in doubt
    have no rivals: there `share_among` says more.

    Args:
        matches: of one pair.
        ranking: of these (`share_among`).
        settings: `evidence`, `retry_below`.
    """
    log_odds = [float(match.certificate.log_odds) for match in matches]
    likely = expit(np.nan_to_num(log_odds, nan=-np.inf)) >= settings.retry_below
    odds = COMPARED["scale"] * ranking.rank
    order, numbers = np.argsort(-odds, kind="stable"), []
    for i, own in enumerate(odds):
        chosen = [i]
        for j in order:
            tie = odds[j] >= own - settings.evidence.tie
            known = likely[i] and likely[j] and tie
            if known and ranking.distance[j, chosen].min() >= settings.evidence.rival:
                chosen.append(int(j))
        numbers.append(len(chosen) - 1)
    return np.array(numbers, float)


def map_distances(
    matches: Sequence[Match],
    pair: tuple[Spectrum, Spectrum],
    *,
    distance_pairs: int = DISTANCE_PAIRS,
) -> np.ndarray:
    """Mean distance of the images of X under each two maps, (m, m).

    It is the biharmonic distance on Y, relative to that of two random vertices.

    Args:
        matches: of one pair.
        pair: the spectra of X and Y; mass 0 is padding.
        distance_pairs: eigenpairs of the distance.
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

"""How a map stands among others that differ from it and fit nearly as well."""

from collections.abc import Sequence

import numpy as np

from jfsf.settings import Settings
from jfsf.spectral import biharmonic
from jfsf.types import Match, Spectrum


def share_among(
    matches: Sequence[Match], spec_y: Spectrum, *, settings: Settings = Settings()
) -> np.ndarray:
    """Share of the odds of each match in those of all distinct ones.

        share_i = o_i / (o_i + sum_j o_j),  o = p / (1 - p),  p the confidence,

    over the matches j that differ from i, the most likely of each group of near copies.
    Two matches differ if their images are `EvidenceSettings.distinct` apart in the
    mean, in biharmonic distance relative to that of two random vertices.

    Args:
        matches: of one pair, each with its own confidence; nan counts as 0.
        spec_y: of the target.
        settings: `evidence`, `distance_pairs`.

    Returns:
        (m,) numbers in [0, 1]; 1 where nothing differs, or nothing is likely at all.
    """
    points = np.asarray(biharmonic(spec_y, settings.distance_pairs))
    mass = np.asarray(spec_y.mass)
    centred = points - mass @ points / mass.sum()
    mean_square = 2 * mass @ (centred**2).sum(1) / mass.sum()
    images = [points[np.asarray(match.T_xy)] for match in matches]
    apart = np.array(
        [[np.linalg.norm(a - b, axis=1).mean() for b in images] for a in images]
    )
    differ = apart > settings.evidence.distinct * np.sqrt(mean_square)
    likely = np.nan_to_num([float(match.certificate.confidence) for match in matches])
    odds = likely / np.maximum(1 - likely, np.finfo(likely.dtype).eps)
    order = np.argsort(-odds, kind="stable")
    shares = []
    for i, own in enumerate(odds):
        rivals: list[int] = []
        for j in order:
            if differ[i, j] and all(differ[j, other] for other in rivals):
                rivals.append(j)
        total = own + odds[rivals].sum()
        shares.append(own / total if total > 0 else 1.0)
    return np.array(shares)

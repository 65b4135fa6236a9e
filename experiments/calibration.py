"""Does the gap tell right maps from wrong ones? From results of match_pairs.py.

It prints how many right and wrong maps the command line warns of. If some are wrong, it
prints the area under the ROC curve of `certificate.gap`, and for every wrong map its
gap and the share of right maps whose gap is no larger.

    python experiments/calibration.py RESULT.json [RESULT.json ...]
"""

import argparse
import json
from pathlib import Path

import numpy as np
from match_pairs import LOST
from scipy.stats import mannwhitneyu

from jfsf.cli import MIN_GAP


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("results", type=Path, nargs="+")
    args = parser.parse_args()
    rows = [
        row for path in args.results for row in json.loads(path.read_text())["pairs"]
    ]
    value = np.array([row["gap"] for row in rows])
    lost = np.array([row["error"] > LOST for row in rows])
    right = value[~lost]
    print(f"{len(rows)} pairs, {lost.sum()} wrong (error above {LOST})")
    print(
        f"gap below {MIN_GAP}: {(right < MIN_GAP).sum()} of {len(right)} right maps, "
        f"{(value[lost] < MIN_GAP).sum()} of {lost.sum()} wrong ones"
    )
    if not lost.any() or lost.all():
        return
    area = mannwhitneyu(right, value[lost]).statistic / (len(right) * lost.sum())
    print(f"area under the ROC curve of the gap: {area:.3f}")
    for i in np.flatnonzero(lost):
        below = np.mean(right <= value[i])
        print(
            f"{rows[i]['x']} {rows[i]['y']}: error {rows[i]['error']:.3f}, gap "
            f"{value[i]:.3f}, which {100 * below:.0f} % of the right maps do not pass"
        )


if __name__ == "__main__":
    main()

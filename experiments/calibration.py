"""Does the gap tell right maps from wrong ones? From results of match_pairs.py.

How many of either the command line warns of. Where some are wrong: area under the ROC
curve of `certificate.gap`, and every wrong map with its gap: the share of right maps
whose gap is no larger is what a user would check in vain.

    python experiments/calibration.py RESULT.json [RESULT.json ...]
"""

import argparse
import json
from pathlib import Path

import numpy as np
from match_pairs import LOST
from scipy.stats import mannwhitneyu

from jfsf.cli_report import UNSURE


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
        f"gap below {UNSURE}: {(right < UNSURE).sum()} of {len(right)} right maps, "
        f"{(value[lost] < UNSURE).sum()} of {lost.sum()} wrong ones"
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

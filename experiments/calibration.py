"""Does the confidence tell right maps from wrong ones? From results of match_pairs.py.

A file holds one data set: rows with error and certificate, as match_pairs.py writes
them; of meshes, since clouds are not bent. Printed are the area under the ROC
curve of `certificate.confidence`, the expected calibration error in ten bins, and how
many maps called very likely right are wrong; then the same for confidences fitted to
the other files, one file left out at a time, and the constants of a fit to all files
(`jfsf/evidence/_confidence.py`). For a fit, match with `Settings(retry_below=0)`: maps
chosen by the confidence would flatter it.

    python experiments/calibration.py RESULT.json [RESULT.json ...]
"""

import argparse
import json
from pathlib import Path

import numpy as np
from protocol import RIGHT
from scipy.optimize import minimize
from scipy.special import expit
from scipy.stats import mannwhitneyu

from jfsf.cli import LIKELY
from jfsf.evidence import LEAST_RESIDUAL

EVIDENCE = ("orientation", "log_stretch_std", "residual")
BINS = 10
RIDGE = 0.3  # on standardised columns: a few hundred pairs need little


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("results", type=Path, nargs="+")
    args = parser.parse_args()
    files = [json.loads(path.read_text())["pairs"] for path in args.results]
    source = np.repeat(np.arange(len(files)), [len(rows) for rows in files])
    rows = [row for file in files for row in file]
    right = np.array([row["error"] < RIGHT for row in rows])
    known = np.array([[row[name] for name in EVIDENCE] for row in rows])
    known[:, -1] = np.log(known[:, -1] + LEAST_RESIDUAL)
    print(f"{len(rows)} pairs, {(~right).sum()} wrong (error {RIGHT} or more)")
    _report("as they are", np.array([row["confidence"] for row in rows]), right)
    if len(files) > 1:
        left_out = np.empty(len(rows))
        for i in range(len(files)):
            others = source != i
            constants = fit(known[others], right[others])
            left_out[~others] = expit(constants[0] + known[~others] @ constants[1:])
        _report("fitted to the other files", left_out, right)
    constants = fit(known, right)
    for name, value in zip(("constant", *EVIDENCE), constants, strict=True):
        print(f"{name} {value:.2f}")


def fit(known: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Constant and factors of a logistic regression, (1 + e,)."""
    centre, spread = known.mean(0), known.std(0)
    columns = (known - centre) / spread
    side = np.where(right, 1, -1)

    def loss(w):
        margin = side * (w[0] + columns @ w[1:])
        return np.logaddexp(0, -margin).sum() + RIDGE * (w[1:] ** 2).sum() / 2

    found = minimize(loss, np.zeros(1 + len(spread))).x
    factors = found[1:] / spread
    return np.array([found[0] - factors @ centre, *factors])


def _report(name: str, confidence: np.ndarray, right: np.ndarray) -> None:
    bins = np.minimum((confidence * BINS).astype(int), BINS - 1)
    gap = sum(
        abs((confidence - right)[bins == i].sum()) / len(right) for i in range(BINS)
    )
    likely = confidence >= LIKELY
    print(
        f"{name}: calibration error {gap:.3f}; of {likely.sum()} maps very likely "
        f"right {(likely & ~right).sum()} are wrong"
    )
    if right.any() and not right.all():
        area = mannwhitneyu(confidence[right], confidence[~right]).statistic
        print(f"  area under the ROC curve {area / right.sum() / (~right).sum():.3f}")


if __name__ == "__main__":
    main()

"""Six pairs of bodies of different proportions: each Y, and X coloured by its map.

The pairs are evenly spread over a list, neither chosen nor sorted by how well they are
matched. Folders and list are as for `far.py`.

    python experiments/figure_far.py --data FOLDER --pairs FILE --out FIGURE.png
"""

import argparse
from pathlib import Path

import far
import jax
import matplotlib.pyplot as plt
import numpy as np
import results_file

import jfsf
from jfsf.evaluate import evaluate
from jfsf.plot import draw_maps, picture_of

ROWS, COLUMNS = 2, 3


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, action="append", required=True)
    parser.add_argument("--pairs", type=Path, required=True)
    parser.add_argument("--every", type=int, default=20, help="points of truth: 1 in N")
    parser.add_argument("--out", type=Path, required=True, help="PNG; JSON beside it")
    args = parser.parse_args()
    lines = [line.split() for line in args.pairs.read_text().splitlines() if line]
    spread = np.linspace(0, len(lines) - 1, ROWS * COLUMNS).round().astype(int)
    rows, pictures = [], []
    for name_x, name_y, *_ in (lines[i] for i in spread):
        x, y, truth = far.load_pair(args.data, name_x, name_y)
        found = jax.block_until_ready(jfsf.match(x, y))
        options = {"truth": truth, "every": args.every, "only": ("error",)}
        error = float(evaluate(found, x, y, **options).error_mean)
        confidence = float(found.certificate.confidence)
        label = f"error {error:.2f}, confidence {confidence:.2f}"
        drawn = draw_maps(x, y, {label: np.asarray(found.T_xy)})
        pictures.append(picture_of(drawn))
        rows.append(
            {"x": name_x, "y": name_y, "error": error, "confidence": confidence}
        )
        print(rows[-1], flush=True)

    figure, axes = plt.subplots(ROWS, COLUMNS, figsize=(12, 7))
    for axis, picture in zip(axes.flat, pictures, strict=True):
        axis.imshow(picture)
        axis.axis("off")
    figure.tight_layout(pad=0.3)
    figure.savefig(args.out, dpi=110)
    settings = {"every": args.every, "match_settings": jfsf.Settings().as_record()}
    results_file.write(args.out.with_suffix(".json"), settings=settings, rows=rows)


if __name__ == "__main__":
    main()

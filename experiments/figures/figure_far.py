"""Six pairs of bodies of different proportions: each Y, and X coloured by its map.

The pairs are evenly spread over the list of the set "creatures" of the protocol,
neither chosen nor sorted by how well they are matched.

    python -m experiments.figures.figure_far --data ROOT --out FIGURE.png
"""

import jax
import matplotlib.pyplot as plt
import numpy as np

import jfsf
from experiments import command_line, results_file
from experiments.accuracy import datasets, protocol
from jfsf.apps.plot._panels import picture_of
from jfsf.apps.plot._pictures import draw_maps
from jfsf.evaluate import evaluate

ROWS, COLUMNS = 2, 3


def main() -> None:
    parser = command_line.parser(__doc__, out="figure_far.png", data=True)
    parser.add_argument("--every", type=int, default=20, help="points of truth: 1 in N")
    args = command_line.parse(parser)
    creatures = protocol.below(protocol.SETS["creatures"], args.data)
    pairs = datasets.spread(datasets.pairs_of(creatures), ROWS * COLUMNS)
    rows, pictures = [], []
    for pair in pairs:
        (x, gt_x, _), (y, gt_y, _) = datasets.load_pair_of(creatures, pair)
        found = jax.block_until_ready(jfsf.match(x, y))
        options = {"truth": (gt_x, gt_y), "every": args.every, "only": ("error",)}
        error = float(evaluate(found, x, y, **options).error_mean)
        confidence = float(found.certificate.confidence)
        label = f"error {error:.2f}, confidence {confidence:.2f}"
        drawn = draw_maps(x, y, {label: np.asarray(found.T_xy)})
        pictures.append(picture_of(drawn))
        row = {"x": pair.x, "y": pair.y, "error": error, "confidence": confidence}
        rows.append(row)
        print(row, flush=True)

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

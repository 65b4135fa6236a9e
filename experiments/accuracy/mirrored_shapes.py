"""Collections with some shapes mirrored: which mirror images are found.

Each set is taken several times, each time with other shapes mirrored: every third one,
every other one, the first third, one, none. A pair is matched once for all times in
which both or one of its shapes are mirrored, since to mirror both makes the same map.
Cortices are left and right ones as they are.
Of each time: the mirror images that were found, those that were missed (joined as they
are), other shapes that were taken for mirror images, and shapes left out; `wrong` are
the joined shapes whose map from the template, by its way, is no right one by the
ground truth of the shapes as they were before.

The rule (jfsf/apps/collections/_sides.py) was made on hdm_molars and on the bodies of
`experiments.bench.bench_collection`. No constant was chosen on the other sets, but they
were looked at between two versions of it.

    python -m experiments.accuracy.mirrored_shapes --data ROOT [--sets calcanei ...]
"""

from collections.abc import Callable, Iterator

import numpy as np

import jfsf
from experiments import command_line, results_file
from experiments.accuracy import protocol
from experiments.accuracy.collection import Errors, shapes_of
from jfsf.apps.collections._cycles import sketch
from jfsf.apps.collections._grow import Matched, map_along, matched
from jfsf.apps.collections._mirror import grow_with_mirrors
from jfsf.mesh._edit import mirror_image

SETS = ["hdm_molars", "calcanei", "cortex_species"]
RIGHT_SIDE = "_R_"  # in the names of right cortices
MIRRORED: dict[str, Callable[[int, int], bool]] = {  # the i-th of s shapes
    "third, from the third": lambda i, s: i % 3 == 2,
    "third, from the second": lambda i, s: i % 3 == 1,
    "every other": lambda i, s: i % 2 == 1,
    "first third": lambda i, s: i < s / 3,
    "one": lambda i, s: i == s // 2,
    "none": lambda i, s: False,
}


def main() -> None:
    parser = command_line.parser(__doc__, data="required")
    parser.add_argument("--sets", nargs="+", default=SETS, choices=protocol.SETS)
    args = command_line.parse(parser)
    rows = []
    for name in args.sets:
        shapes = shapes_of(name, args.data)
        sides = np.array([RIGHT_SIDE in own for own in shapes])
        for row in measure(shapes, sides, protocol.SETS[name].right):
            rows.append({"set": name, **row})
            print(rows[-1], flush=True)
    out = args.out or command_line.RESULTS / "mirrored_shapes.json"
    results_file.write(out, settings={"sets": args.sets}, rows=rows)


def measure(shapes: dict, sides: np.ndarray, right: float) -> Iterator[dict]:
    """A row for each choice of the mirrored shapes.

    Args:
        shapes: of a set.
        sides: (s,) whether a shape is mirrored already.
        right: a map is right below this mean error.
    """
    names, error = list(shapes), Errors(shapes)
    meshes = [shapes[name].mesh for name in names]
    sketches = [sketch(jfsf.basis(mesh)) for mesh in meshes]
    known: dict = {}

    def match(pair, turned: bool) -> Matched:
        if (pair, turned) not in known:
            x, y = (meshes[i] for i in pair)
            own = jfsf.match(mirror_image(x) if turned else x, y)
            known[pair, turned] = matched(own)
        return known[pair, turned]

    for kind, of in MIRRORED.items():
        odd = np.array([of(i, len(names)) for i in range(len(names))])
        graph = grow_with_mirrors(
            sketches,
            lambda edges, turned, odd=odd: [
                match((a, b), bool(t ^ odd[a] ^ odd[b]))
                for (a, b), t in zip(edges, turned, strict=True)
            ],
        )
        template = graph.paths.template
        along = lambda i, graph=graph: map_along(graph.maps, graph.paths.way(i))
        side = odd ^ sides
        mirrored = set(np.flatnonzero(side != side[template]).tolist())
        joined = set(np.flatnonzero(graph.joined).tolist())
        wrong = [
            i
            for i in sorted(joined - {template})
            if not protocol.is_right(error(along(i), names[template], names[i]), right)
        ]
        yield {
            "kind": kind,
            "shapes": len(names),
            "mirrored": len(mirrored),
            "found": len(graph.mirrored & mirrored),
            "missed": [names[i] for i in sorted(mirrored & joined)],
            "taken for mirror images": [
                names[i] for i in sorted(graph.mirrored - mirrored)
            ],
            "left out": [
                names[i]
                for i in sorted(set(range(len(names))) - joined - graph.mirrored)
            ],
            "wrong": [names[i] for i in wrong],
            "pairs": len(graph.matched),
        }


if __name__ == "__main__":
    main()

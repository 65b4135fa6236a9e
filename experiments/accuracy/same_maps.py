"""Hashes of maps, to show that a change of the code leaves every map as it was.

    python -m experiments.accuracy.same_maps --data ROOT --out BEFORE.json
    python -m experiments.accuracy.same_maps --data ROOT --against BEFORE.json

The pairs are a ring of the embedded shapes and some pairs of four sets of the protocol,
whole and as views of a camera; then a collection of four shapes. JAX_ENABLE_X64=1 asks
for float64. Without data, the embedded shapes only. Hashes of two machines differ, and
so do those of two versions of jax.
"""

import hashlib
import json
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

import jfsf
from experiments import command_line, results_file
from experiments.accuracy import datasets, protocol
from jfsf import data

SETS = {"faust_r": 4, "tosca_iso_r": 4, "shrec07": 4, "creatures": 4, "becos_pf": 2}
MEMBERS = 4  # of the collection


def main() -> None:
    parser = command_line.parser(__doc__, data="optional")
    parser.add_argument("--against", type=Path, help="an earlier file of this script")
    parser.add_argument("--only", default="", help="jobs whose names have this in them")
    args = command_line.parse(parser)
    before = json.loads(args.against.read_text())["hashes"] if args.against else {}
    hashes: dict[str, str] = {}
    for name, job in jobs(args.data):
        if args.only in name:
            start = time.perf_counter()
            hashes[name] = digest(job())
            said = {None: "", hashes[name]: "same"}.get(before.get(name), "DIFFERENT")
            seconds = time.perf_counter() - start
            print(name, hashes[name], f"{seconds:.1f} s", said, flush=True)
            if args.out:
                results_file.write(args.out, hashes=hashes)
    different = [
        name for name in before.keys() & hashes if before[name] != hashes[name]
    ]
    if different:
        raise SystemExit(f"{len(different)} of {len(hashes)} differ: {different}")


def jobs(root: Path | None) -> Iterator[tuple[str, Callable[[], list]]]:
    """The name of each job, and what makes its arrays."""
    names = data.names()
    for x, y in zip(names, (*names[1:], names[0]), strict=True):
        yield f"embedded {x} {y}", partial(embedded, x, y)
    for name, number in SETS.items() if root else ():
        data_set = protocol.below(protocol.SETS[name], Path(root))  # type: ignore
        for pair in datasets.spread(datasets.pairs_of(data_set), number):
            yield f"{name} {pair.x} {pair.y}", partial(of_set, data_set, pair)
    yield "collection", collected


def embedded(x: str, y: str) -> list:
    match = jfsf.match(data.load(x).mesh, data.load(y).mesh)
    return [match.T_xy, match.T_yx]


def of_set(data_set: protocol.DataSet, pair: datasets.Pair) -> list:
    x, y = datasets.load_pair_of(data_set, pair)
    match = jfsf.match(x.mesh, y.mesh, partial=data_set.kind == "part")
    return [match.T_xy, match.T_yx]


def collected() -> list:
    names = data.names()[:MEMBERS]
    meshes = [data.load(name).mesh for name in names]
    found = jfsf.collection(meshes, names=names)
    maps = [side for m in found.members if m for side in (m.maps.T_xy, m.maps.T_yx)]
    return [*maps, found.registered]


def digest(arrays: list) -> str:
    """A hash of the bytes of arrays."""
    joined = b"".join(np.ascontiguousarray(array).tobytes() for array in arrays)
    return hashlib.sha256(joined).hexdigest()[:16]


if __name__ == "__main__":
    main()

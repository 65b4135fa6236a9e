"""`jfsf collection --onto`: more shapes, by a finished collection that stays as it is.

Each new shape is matched with the template and a few of the finished shapes, whose maps
from the template are data. So it joins by itself: what becomes of it does not depend on
which others are in its folder.
"""

import json
from collections import ChainMap
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jfsf.apps.cli._collection_frozen import Frozen, nearest_of
from jfsf.apps.cli._collection_jobs import Kept, file_of, kept, read_maps
from jfsf.apps.cli._collection_runner import OnFiles
from jfsf.apps.cli._print import said
from jfsf.batch._jobs import Job, is_done, timed

if TYPE_CHECKING:
    from jfsf.apps.collections._grow import Graph

STAGES_ONTO = "files", "shapes", "joining", "model"
JOINED = "joined"  # folder of what is known of each new shape


def join_onto(
    frozen: Frozen,
    out: Path,
    shapes: Mapping[str, Kept],
    run: Callable[..., dict[Path, str | None]],
    *,
    mirror: str,
    report: bool,
) -> "tuple[Mapping[str, Any], Graph, dict[int, str]]":
    """Put the template of a finished collection onto each new shape.

    Args:
        frozen: the collection.
        out: folder of the results.
        shapes: what is kept of each new shape, by name.
        run: `outcomes`, on some client.
        mirror: as `jfsf.collection`.
        report: whether each shape gets a page.

    Returns:
        The shapes: the new ones, the template, and without a mesh those that new ones
        were matched with; the graph of these, of which only pairs with new shapes
        count; and why the template could not be put on some.
    """
    (out / JOINED).mkdir(exist_ok=True)
    jobs = {}
    for name, near in nearest_of(frozen, shapes).items():
        names = (frozen.template, *near)
        options = str(frozen.folder), names, tuple(frozen.trust[n] for n in names)
        own = file_of(out, "shapes", name)
        jobs[name] = Job((own,), out / JOINED / f"{name}.json", (), options)
    how = {"orientation": frozen.orientation, "mirror": mirror, "report": report}
    # What is done within a job shows only there.
    again = run(
        list(jobs.values()),
        label="joining",
        work=partial(put_onto, **how),
        done=lambda _: False,
    )
    broken = {name: why for name, job in jobs.items() if (why := again[job.out])}
    records = {
        name: json.loads(job.out.read_text(encoding="utf-8"))
        for name, job in jobs.items()
        if name not in broken
    }
    return _together(frozen, shapes, records, broken)


def put_onto(job: Job, *, orientation, mirror, report: bool) -> None:
    """Join one shape to a finished collection, and write what is known of it.

    job: the kept shape is its input; its options are the folder of the collection, the
        names of its template and the most alike shapes, and the trust of each.
    """
    from jfsf.apps.collections._engine import join_shapes
    from jfsf.storage._atomic import write_text

    folder, old, trust = job.options
    model, out, name = Path(folder), job.out.parent.parent, job.out.stem
    sketches = [kept(file_of(model, "shapes", one)).sketch for one in old]
    own, names = len(old), [*old, name]
    ways = [
        read_maps(file_of(model, "maps", one))._replace(confidence=sure)
        for one, sure in list(zip(old, trust, strict=True))[1:]
    ]
    graph, failed = join_shapes(
        [*sketches, kept(job.inputs[0]).sketch],
        OnFiles(out, names, orientation, report, _run_here, model=model, old=own),
        orientation=orientation,
        mirror=mirror,
        frozen=ways,
    )
    before = int(graph.paths.before[own])
    known = {
        "trust": float(graph.paths.trust[own]),
        "joined": bool(graph.joined[own]),
        "mirrored": own in graph.mirrored,
        "failed": failed.get(own),
        "before": names[before] if before >= 0 else None,
        "pairs": [
            [names[a], one.confidence, graph.right[a, b]]
            for (a, b), one in sorted(graph.matched.items())
            if b == own
        ],
        "triangles": [
            [[names[i] for i in one.corners], one.apart] for one in graph.found
        ],
        "tests": [[names[test.partner], *test[2:]] for test in graph.tests],
    }
    write_text(job.out, json.dumps(known, indent=2) + "\n")


def _run_here(jobs, *, label: str, work, done=is_done) -> dict[Path, str | None]:
    """`outcomes`, in this process and silently."""
    do = lambda job: None if done(job) else timed(work, job, said)[0]
    return {job.out: do(job) for job in jobs}


def _together(frozen: Frozen, shapes, records, broken):
    """The graph of all new shapes and the finished ones they were matched with.

    Args:
        frozen: the collection.
        shapes: the new ones, by name.
        records: what `put_onto` wrote of each.
        broken: why it failed on the others.
    """
    from jfsf.apps.collections._cycles import Triangle, edge_of
    from jfsf.apps.collections._grow import Graph, Matched, MirrorTest, Paths
    from jfsf.types import Maps

    # Mirror images are tried with other shapes too than those of its pairs.
    used = {
        row[0] for own in records.values() for row in (*own["pairs"], *own["tests"])
    }
    names = [*shapes, frozen.template, *sorted(used - {frozen.template})]
    number = {name: i for i, name in enumerate(names)}
    trust = np.array([frozen.trust.get(name, 0.0) for name in names])
    before = np.full(len(names), number[frozen.template])
    before[number[frozen.template]] = -1
    joined = np.array([name in frozen.trust for name in names])
    empty: Any = np.zeros(0, np.int32)
    none = Maps(empty, empty)
    matched, right, found, tests, mirrored, failed = {}, {}, [], [], set(), {}
    for name, why in broken.items():
        before[number[name]], failed[number[name]] = -1, why
    for name, own in records.items():
        i = number[name]
        trust[i], joined[i] = own["trust"], own["joined"]
        before[i] = -1 if own["before"] is None else number[own["before"]]
        mirrored |= {i} if own["mirrored"] else set()
        failed |= {i: own["failed"]} if own["failed"] else {}
        for other, confidence, likely in own["pairs"]:
            edge = edge_of(i, number[other])
            matched[edge], right[edge] = Matched(none, confidence), likely
        for corners, apart in own["triangles"]:
            a, b, c = sorted(number[one] for one in corners)
            found.append(Triangle((a, b, c), apart))
        tests += [MirrorTest(i, number[one], *rest) for one, *rest in own["tests"]]
    paths = Paths(number[frozen.template], before, trust)
    base = kept(frozen.kept_template)
    old = {frozen.template: base, **dict.fromkeys(sorted(used - {frozen.template}))}
    graph = Graph(
        matched, found, right, paths, joined, tuple(tests), frozenset(mirrored)
    )
    return ChainMap(old, shapes), graph, failed


def write_scores_of(out: Path, rows, frozen: Frozen) -> tuple[list[Path], list[str]]:
    """Write the new shapes' scores in the finished model; the file, and what to say."""
    from jfsf.apps.model import read_model, scores_of, write_scores

    names = sorted(row["name"] for row in rows if not row["reason"])
    if not names:
        (out / "scores.csv").unlink(missing_ok=True)
        return [], ["no shape has joined, so there are no scores"]
    model = read_model(frozen.folder / "model.npz")
    found = []
    for name in names:
        with np.load(file_of(out, "registered", name)) as file:
            on_shape = file["vertices"]
        found.append(scores_of(model, on_shape - on_shape.mean(0)))
    write_scores(out / "scores.csv", names, model._replace(scores=np.stack(found)))
    return [out / "scores.csv"], []

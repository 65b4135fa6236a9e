"""`jfsf collection --onto`: more shapes, by a finished collection that stays as it is.

Each new shape is matched with the template and a few of the finished shapes, whose maps
from the template are data. So it joins by itself: what becomes of it does not depend on
which others are in its folder.
"""

import csv
import json
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from jfsf.apps.cli._collection_carried import Carried, carried_of
from jfsf.apps.cli._collection_jobs import Kept, file_of, kept, read_maps
from jfsf.apps.cli._collection_runner import OnFiles
from jfsf.apps.cli._collection_semilandmarks import sliders_in
from jfsf.apps.cli._collection_symmetry import pairs_in
from jfsf.apps.cli._look import doubts
from jfsf.apps.cli._print import said
from jfsf.apps.cli._runs import SETTINGS
from jfsf.batch._jobs import Job, is_done, timed

if TYPE_CHECKING:
    from jfsf.apps.collections._grow import Graph
    from jfsf.apps.landmarks import Landmarks

STAGES_ONTO = "files", "shapes", "registered", "model"
JOINED = "joined"  # folder of what is known of each new shape


class Frozen(NamedTuple):
    """A finished collection, which is only read.

    folder: of its results.
    template: the name of its template.
    trust: of each shape that joined as it is, by its name: a mirror image that was
        mirrored back is no partner of others.
    known: the names of all its shapes, those left out too.
    orientation: as `jfsf.collection`.
    """

    folder: Path
    template: str
    trust: Mapping[str, float]
    known: frozenset[str]
    orientation: str

    @property
    def kept_template(self) -> Path:
        """The file of what is kept of the template."""
        return file_of(self.folder, "shapes", self.template)


def frozen_of(model: Path) -> Frozen:
    """Read what a finished collection says of its shapes.

    Raises:
        ValueError: it is none; the message says what it lacks.
    """
    wrong = lambda why: ValueError(
        f"{model}: is no finished collection ({why}); name the --out of one that ended"
    )
    try:
        settings = json.loads((model / SETTINGS).read_text(encoding="utf-8"))
        with (model / "summary.csv").open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        joined = [row for row in rows if not row["reason"]]
        trust = {row["name"]: float(row["trust"]) for row in joined}
        plain = {
            row["name"]: trust[row["name"]] for row in joined if row["mirrored"] == "0"
        }
        orientation = settings["orientation"]
    except OSError as error:
        raise wrong(f"{Path(error.filename).name}: {error.strerror}") from None
    except (ValueError, KeyError, TypeError):
        raise wrong("settings.json or summary.csv is damaged") from None
    itself = [name for name in trust if not file_of(model, "maps", name).exists()]
    if len(itself) != 1:
        raise wrong(f"{len(itself)} shapes without maps from the template, not one")
    needed = [model / "model.npz"]
    needed += [
        file_of(model, part, n) for part in ("shapes", "registered") for n in trust
    ]
    if gone := [path for path in needed if not path.exists()]:
        raise wrong(f"{gone[0].relative_to(model)} is missing")
    names = frozenset(row["name"] for row in rows)
    return Frozen(model.absolute(), itself[0], plain, names, orientation)


def check_new(
    frozen: Frozen,
    paths: Mapping[str, Path],
    out: Path,
    template: Path | None,
    orientation: str,
) -> None:
    """ValueError if shapes or options do not fit the finished collection.

    Args:
        frozen: the collection.
        paths: the new files, by name.
        out: folder of the results.
        template: the file that is named as the template's.
        orientation: as `jfsf.collection`.
    """
    from jfsf.mesh import read

    for name in sorted(frozen.known & set(paths)):
        raise ValueError(
            f"{paths[name]}: {frozen.folder} has a shape of this name; rename yours"
        )
    if out.is_dir() and out.samefile(frozen.folder):
        raise ValueError(
            f"{out}: is the --onto, which stays as it is; name another one"
        )
    if orientation != frozen.orientation:
        raise ValueError(
            f"{frozen.folder}: was made with --orientation {frozen.orientation}; give "
            "the same"
        )
    if template is not None:
        own, file = (
            kept(frozen.kept_template),
            read(template),
        )
        there = np.max(own.at, initial=0) < len(file.vertices)
        if not there or not np.allclose(file.vertices[own.at], own.mesh.vertices):
            raise ValueError(
                f"{template}: is not the file of {frozen.template}, the template of "
                f"{frozen.folder}; name that, or leave --template out"
            )


def marks_of(frozen: Frozen) -> "tuple[Path, Landmarks, Any, Any] | None":
    """The template's landmarks and their file, `sliders_in` and `pairs_in`; or None."""
    from jfsf.apps.landmarks import read_landmarks

    path = frozen.folder / "landmarks" / f"{frozen.template}.mrk.json"
    if not path.exists():
        return None
    tables = sliders_in(frozen.folder), pairs_in(frozen.folder)
    return path, read_landmarks(path), *tables


def columns_of(frozen: Frozen) -> tuple[list[Carried], list[str]]:
    """Labels and values of the template, and what to say of those not to be used."""
    own, said_of = kept(frozen.kept_template).mesh, []
    found = []
    for what in ("labels", "values"):
        for path in sorted((frozen.folder / what).glob(f"{frozen.template}.*")):
            try:
                found += carried_of(own, **{what: path})
            except ValueError as error:
                said_of.append(
                    f"{path}: not carried ({error}); name it, and the template's file"
                )
    return found, said_of


def odd_beside(frozen: Frozen, paths, shapes: Mapping[str, Kept]) -> list[str]:
    """`doubts` of each new shape, beside the template and the most alike shape."""
    base = kept(frozen.kept_template)
    near, lines = _nearest(frozen, shapes), []
    for name, own in shapes.items():
        most = kept(file_of(frozen.folder, "shapes", [*near[name], frozen.template][0]))
        where = str(paths[name])
        beside = doubts([where, "", ""], [own, most, base])
        lines += [line for line in beside if line.startswith(f"{where}: ")]
    return lines


def _nearest(frozen: Frozen, shapes: Mapping[str, Kept]) -> dict[str, list[str]]:
    """The most alike finished shapes of each, the template aside, the first the most.

    Of those that are surely joined, if there are any.
    """
    from jfsf.apps.collections._cycles import unlikeness
    from jfsf.apps.collections._grow import MOST_OF_ONE, SURE

    others = [name for name in frozen.trust if name != frozen.template]
    sure = [name for name in others if frozen.trust[name] >= SURE] or others
    if not sure:
        return {name: [] for name in shapes}
    signatures = []
    for name in sorted(sure):
        with np.load(file_of(frozen.folder, "shapes", name)) as file:
            signatures.append(file["signature"])
    found = {}
    for name, own in shapes.items():
        unlike = unlikeness([own.sketch.signature, *signatures])[0, 1:]
        order = np.argsort(unlike, kind="stable")[: MOST_OF_ONE - 1]
        found[name] = [sorted(sure)[i] for i in order.tolist()]
    return found


def join_onto(
    frozen: Frozen,
    out: Path,
    shapes: Mapping[str, Kept],
    run: Callable[..., dict[Path, str | None]],
    *,
    mirror: str,
    report: bool,
) -> "tuple[dict[str, Any], Graph, dict[int, str]]":
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
    for name, near in _nearest(frozen, shapes).items():
        names = (frozen.template, *near)
        options = str(frozen.folder), names, tuple(frozen.trust[n] for n in names)
        own = file_of(out, "shapes", name)
        jobs[name] = Job((own,), out / JOINED / f"{name}.json", (), options)
    how = {"orientation": frozen.orientation, "mirror": mirror, "report": report}
    # What is done within a job shows only there.
    again = run(
        list(jobs.values()),
        label="registered",
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
        OnFiles(out, names, orientation, report, _run_here, model, own),
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
            [names[a], one.confidence, one.shear, graph.right[a, b]]
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

    used = {pair[0] for own in records.values() for pair in own["pairs"]}
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
        for other, confidence, shear, likely in own["pairs"]:
            edge = edge_of(i, number[other])
            matched[edge], right[edge] = Matched(none, confidence, shear), likely
        for corners, apart in own["triangles"]:
            a, b, c = sorted(number[one] for one in corners)
            found.append(Triangle((a, b, c), apart))
        tests += [MirrorTest(i, number[one], *rest) for one, *rest in own["tests"]]
    paths = Paths(number[frozen.template], before, trust)
    base = kept(frozen.kept_template)
    known = {
        **shapes,
        frozen.template: base,
        **dict.fromkeys(sorted(used - {frozen.template})),
    }
    graph = Graph(
        matched, found, right, paths, joined, tuple(tests), frozenset(mirrored)
    )
    return known, graph, failed


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

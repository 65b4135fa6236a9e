"""The steps of `jfsf collection`: each makes jobs, and reads what they wrote."""

from functools import partial
from pathlib import Path
from zipfile import is_zipfile

import numpy as np

from jfsf.apps.cli._collection_carried import carried_files
from jfsf.apps.cli._collection_jobs import (
    kept,
    match_pair,
    nothing,
    put_agreed,
    read_maps,
)
from jfsf.apps.cli._collection_pages import picture_of_shape
from jfsf.apps.cli._collection_results import registered
from jfsf.apps.cli._pages import pages_of
from jfsf.apps.cli._words import in_options
from jfsf.mesh._read import stem_of

PARTS = (  # of the results
    *("shapes", "pairs", "turned", "ways", "maps", "placed", "others", "registered"),
)
MIRRORED = "mirrored"  # folder of the shapes that were mirrored back


def outcomes(
    client, shown, jobs, *, label: str, work, done=None
) -> dict[Path, str | None]:
    """Do the jobs; why each failed, by its file, None for those that did not."""
    from jfsf.batch._jobs import run_jobs

    bar = shown.add_task(label, total=len(jobs))
    reasons = {}
    for outcome in run_jobs(jobs, client, prepare=nothing, work=work, done=done):
        why = outcome.reason
        reasons[outcome.job.out] = None if why is None else in_options(why)
        shown.advance(bar)
    return reasons


def kept_shapes(out, paths, run):
    """What is kept of each shape, and why some are not, by name."""
    from jfsf.batch._jobs import Job

    jobs = {name: Job((path,), _shape(out, name)) for name, path in paths.items()}
    found = run(list(jobs.values()), label="shapes")
    reasons = {name: found[job.out] for name, job in jobs.items()}
    bad = {name: why for name, why in reasons.items() if why is not None}
    good = {name: kept(jobs[name].out) for name in paths if name not in bad}
    if len(good) < 2:
        raise ValueError(
            f"collection: {len(good)} of {len(paths)} shapes can be matched, two are "
            f"needed: {'; '.join(bad.values()) or 'name a folder with more meshes'}"
        )
    return good, bad


def number_of(shapes, reasons, template: Path | None) -> int | None:
    """Of the template among the shapes."""
    if template is None:
        return None
    name = stem_of(template)
    if name in reasons:
        raise ValueError(f"{template}: {reasons[name]}")
    return list(shapes).index(name)


def grown(out, shapes, template, mirror, run, *, orientation: str):
    """The graph of matched pairs, and which shapes are mirror images."""
    from jfsf.apps.collections._mirror import grow_with_mirrors
    from jfsf.batch._jobs import Job

    names, known = list(shapes), {}

    def match(edges, turned):
        for turn in (False, True):
            folder = out / ("turned" if turn else "pairs")
            jobs = {
                (a, b): Job(
                    (_shape(out, names[a]), _shape(out, names[b])),
                    folder / f"{names[a]}__{names[b]}.npz",
                )
                for (a, b), own in zip(edges, turned, strict=True)
                if own == turn and ((a, b), turn) not in known
            }
            if not jobs:
                continue
            work = partial(match_pair, orientation=orientation, turned=turn)
            label = "mirror images" if turn else "pairs"
            failed = run(list(jobs.values()), label=label, work=work)
            for edge, job in jobs.items():
                known[edge, turn] = None if failed[job.out] else read_maps(job.out)
        return [known[pair] for pair in zip(edges, turned, strict=True)]

    sketches = [own.sketch for own in shapes.values()]
    return grow_with_mirrors(sketches, match, mirror=mirror, template=template)


def mirror_back(out: Path, shapes, graph):
    """The shapes, joined mirror images mirrored back; writes these as files too."""
    from jfsf.apps.export import export_mesh
    from jfsf.mesh import mirror_image

    shapes = dict(shapes)
    for i, (name, own) in enumerate(list(shapes.items())):
        if i in graph.mirrored and graph.joined[i]:
            (out / MIRRORED).mkdir(exist_ok=True)
            shapes[name] = own._replace(mesh=mirror_image(own.mesh))
            export_mesh(out / MIRRORED / f"{name}.ply", shapes[name].mesh)
    return shapes


def put(out, names, graph, run) -> dict[str, str]:
    """The template on each joined shape; why it could not be put on some, by name."""
    from jfsf.apps.collections._paths import map_along
    from jfsf.batch._jobs import Job

    base, jobs = graph.paths.template, {}
    for i in np.flatnonzero(graph.joined).tolist():
        # The template has a way too, to itself: what was made of it under another
        # template is older, and does not count.
        way = out / "ways" / f"{names[i]}.npz"
        if i == base:
            T = np.arange(len(kept(_shape(out, names[i])).mesh.vertices))
            (out / "maps" / f"{names[i]}.npz").unlink(missing_ok=True)
        else:
            T = map_along(graph.maps, graph.paths.way(i))
        _write_way(way, T_xy=T, turned=np.array(i in graph.mirrored))
        inputs = _shape(out, names[base]), _shape(out, names[i]), way
        jobs[names[i]] = Job(inputs, placed(out, names[i]))
    failed = run(list(jobs.values()), label="maps")
    return {name: failed[job.out] for name, job in jobs.items() if failed[job.out]}


def agree(out, names, graph, bad, run) -> dict[str, str]:
    """The template once more, by all trusted ways; why not, by name.

    bad: names of the shapes that it could not be put on.
    """
    from jfsf.batch._jobs import Job

    base, jobs = graph.paths.template, {}
    for i in np.flatnonzero(graph.joined).tolist():
        if names[i] in bad:
            continue
        known = graph.trusted_maps(i) if i != base else []
        known = [(j, T) for j, T in known if names[j] not in bad]
        turned = [n in graph.mirrored for n in (i, *(j for j, _ in known))]
        maps = {f"T_{number}": np.asarray(T) for number, (_, T) in enumerate(known)}
        others = _others(out, names[i])
        _write_way(others, turned=np.array(turned), **maps)
        inputs = *(_shape(out, names[j]) for j in (base, i)), placed(out, names[i])
        extras = [others]
        for j, _ in known:
            extras += [_shape(out, names[j]), placed(out, names[j])]
        jobs[names[i]] = Job(inputs, registered(out, names[i]), tuple(extras))
    failed = run(list(jobs.values()), label="registered", work=put_agreed)
    return {name: failed[job.out] for name, job in jobs.items() if failed[job.out]}


def _write_way(path: Path, **arrays) -> None:
    """Write a map; an equal one keeps its date, and what was made of it counts."""
    from jfsf.storage._atomic import write_atomically

    if is_zipfile(path):  # or it is not there, or cut short
        with np.load(path) as file:
            same = set(file.files) == set(arrays)
            if same and all(np.array_equal(file[n], own) for n, own in arrays.items()):
                return
    write_atomically(path, lambda file: np.savez(file, **arrays))


def known_before(out: Path) -> set[str]:
    """Names of the shapes that the template is on, also by an earlier run."""
    files = (out / "registered").glob("*.npz")
    return {path.name.removesuffix(".npz") for path in files}


def forget(out: Path, names) -> None:
    """Remove what an earlier run wrote of shapes that are left out now, or gone."""
    for name in names:
        maps = out / "maps" / f"{name}.npz"
        on_shape = registered(out, name)
        mesh, picture = on_shape.with_suffix(".ply"), picture_of_shape(out, name)
        own = [maps, *pages_of(maps), placed(out, name), on_shape, mesh, picture]
        own.append(_others(out, name))
        own += carried_files(out, name)
        for path in own:
            path.unlink(missing_ok=True)


def placed(out: Path, name: str) -> Path:
    """The file of the template on a shape by its own map."""
    return out / "placed" / f"{name}.npz"


def _others(out: Path, name: str) -> Path:
    return out / "others" / f"{name}.npz"


def _shape(out: Path, name: str) -> Path:
    return out / "shapes" / f"{name}.npz"

"""The work of `jfsf collection`: jobs are made, and what they wrote is read."""

from collections import ChainMap
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from shutil import rmtree
from zipfile import is_zipfile

import numpy as np

from jfsf.apps.cli._collection_carried import carried_files
from jfsf.apps.cli._collection_jobs import (
    KeptShapes,
    file_of,
    has_page,
    is_kept,
    is_put,
    keep,
    match_pair,
    nothing,
    picture_of_shape,
    put_agreed,
    put_template,
    read_maps,
)
from jfsf.apps.cli._look import unfit
from jfsf.apps.cli._pair import pages_of
from jfsf.apps.cli._print import counted, said
from jfsf.apps.cli._stages import Stages
from jfsf.batch._jobs import Job
from jfsf.mesh._read import stem_of

# What a run does, in order; pairs and their mirror images by turns.
STAGES = "files", "shapes", "pairs", "mirror images", "maps", "registered", "model"
# What is kept when it is stopped -> its files.
KEPT = {"shapes": "shapes/*.npz", "pairs": "pairs/*.npz", "maps": "maps/*.npz"}
# Folders of the results.
OF_TEMPLATE = "ways", "maps", "placed", "others", "registered"  # for each template
PARTS = "shapes", "pairs", "turned", *OF_TEMPLATE
TEMPLATES = "templates"  # a folder for each other template, with its own parts
MIRRORED = "mirrored"  # folder of the shapes that were mirrored back


def outcomes(
    client, shown: Stages, jobs, *, label: str, work, done=None
) -> dict[Path, str | None]:
    """Do the jobs; why each failed, by its file, None for those that did not."""
    from jfsf.batch._jobs import run_jobs

    shown.begin(label, len(jobs))
    reasons = {}
    given = {"prepare": nothing, "work": work, "done": done, "say": said}
    for outcome in run_jobs(jobs, client, **given):
        reasons[outcome.job.out] = outcome.reason
        shown.outcome(label, outcome)
    shown.end(label)
    return reasons


def jobs_of_shapes(out: Path, paths) -> dict[str, Job]:
    """The job that keeps each shape, by name."""
    return {
        name: Job((path,), file_of(out, "shapes", name)) for name, path in paths.items()
    }


def look(
    jobs, shown: Stages, largest: bool, mend: bool, *, least: int = 2
) -> dict[str, str]:
    """Look at the files, and say what is unfit; the reasons, by name.

    Args:
        jobs: of `jobs_of_shapes`.
        shown: the stages.
        largest, mend: as `matchable`.
        least: how many are needed.

    Raises:
        ValueError: fewer can be matched.
    """
    bad = {}
    shown.begin("files", len(jobs))
    for name, job in jobs.items():
        fit = is_kept(job, largest, mend)
        found = None if fit else unfit(job.inputs[0], largest, mend)
        if found is not None:
            bad[name] = found
        shown.advance("files", quiet=True)
    shown.end("files")
    good = len(jobs) - len(bad)
    meshes = counted(len(jobs), "mesh", "meshes")
    shown.say(f"looked at {meshes}: {good} can be matched")
    for one in bad.values():
        shown.say(one.why)
    if options := sorted({option for one in bad.values() for option in one.options}):
        shown.say(
            f"the others are left out, until {' '.join(options)} is added to the "
            "command; the folder may be the same, and what was made counts"
        )
    check_enough(good, len(jobs), [one.why for one in bad.values()], least)
    return {name: one.why for name, one in bad.items()}


def check_enough(good: int, of: int, reasons, least: int) -> None:
    """ValueError if fewer than `least` shapes of so many can be matched."""
    if good < least:
        needed = "one is needed" if least == 1 else "two are needed"
        raise ValueError(
            f"collection: {good} of {of} shapes can be matched, {needed}: "
            f"{'; '.join(reasons) or 'name a folder with more meshes'}"
        )


def kept_shapes(jobs, run, reasons, largest: bool, mend: bool, *, least: int = 2):
    """What is kept of each shape, and why some are not, by name.

    Args:
        jobs: of `jobs_of_shapes`.
        run: `outcomes`, on some client.
        reasons: of `look`.
        largest, mend: as `matchable`.
        least: as `look`.
    """
    options = {"largest": largest, "mend": mend}
    fit = {name: job for name, job in jobs.items() if name not in reasons}
    found = run(
        list(fit.values()),
        label="shapes",
        work=partial(keep, **options),
        done=partial(is_kept, **options),
    )
    failed = {name: found[job.out] for name, job in fit.items()}
    bad = reasons | {name: why for name, why in failed.items() if why is not None}
    good = KeptShapes({name: jobs[name].out for name in jobs if name not in bad})
    check_enough(len(good), len(jobs), bad.values(), least)
    return good, bad


def number_of(shapes, reasons, template: Path | None) -> int | None:
    """Of the template among the shapes."""
    if template is None:
        return None
    name = stem_of(template)
    if name in reasons:
        raise ValueError(f"{template}: {reasons[name]}")
    return list(shapes).index(name)


@dataclass(frozen=True)
class OnFiles:
    """Does the work of a collection by jobs (`Runner`).

    A file that is not older than what it is made from stays as it is.

    out: folder of the results.
    names: of the shapes.
    orientation: as `jfsf.collection`.
    report: whether each shape gets a page.
    run: `outcomes`, on some client.
    home: folder of the results that has the kept shapes; `out` if None.
    model: folder of a finished collection, whose files are read only.
    old: so many shapes, the first, are in it.
    """

    out: Path
    names: list[str]
    orientation: str
    report: bool
    run: Callable[..., dict[Path, str | None]]
    home: Path | None = None
    model: Path | None = None
    old: int = 0

    def match(self, edges, turned: bool):
        folder = self.out / ("turned" if turned else "pairs")
        jobs = [
            Job(
                (self._file("shapes", a), self._file("shapes", b)),
                folder / f"{self.names[a]}__{self.names[b]}.npz",
            )
            for a, b in edges
        ]
        work = partial(match_pair, orientation=self.orientation, turned=turned)
        label = "mirror images" if turned else "pairs"
        failed = self.run(jobs, label=label, work=work)
        return [None if failed[job.out] else read_maps(job.out) for job in jobs]

    def place(self, graph, ways) -> dict[int, str]:
        base, jobs = graph.paths.template, {}
        for i, T in ways.items():
            # The template has a way too, to itself: what was made of it under another
            # template is older, and does not count.
            way = self._file("ways", i)
            if i == base:
                self._file("maps", i).unlink(missing_ok=True)
            _write_way(way, T_xy=T, turned=np.array(i in graph.mirrored_back))
            inputs = self._file("shapes", base), self._file("shapes", i), way
            jobs[i] = Job(inputs, self._file("placed", i))
        work = partial(put_template, report=self.report)
        done = has_page if self.report else is_put
        failed = self.run(list(jobs.values()), label="maps", work=work, done=done)
        return {i: why for i, job in jobs.items() if (why := failed[job.out])}

    def agree(self, graph, maps) -> dict[int, str]:
        base, jobs = graph.paths.template, {}
        for i, known in maps.items():
            others = self._file("others", i)
            turned = [n in graph.mirrored_back for n in (i, *(j for j, _ in known))]
            arrays = {
                f"T_{number}": np.asarray(T) for number, (_, T) in enumerate(known)
            }
            _write_way(others, turned=np.array(turned), **arrays)
            inputs = (
                *(self._file("shapes", j) for j in (base, i)),
                self._file("placed", i),
            )
            extras = [others]
            for j, _ in known:
                extras += [self._file("shapes", j), self._file("placed", j)]
            jobs[i] = Job(inputs, self._file("registered", i), tuple(extras))
        failed = self.run(list(jobs.values()), label="registered", work=put_agreed)
        return {i: why for i, job in jobs.items() if (why := failed[job.out])}

    def _file(self, part: str, shape: int) -> Path:
        name = self.names[shape]
        if self.model is not None and shape < self.old:
            # There the template is on it by all ways already.
            part = "registered" if part == "placed" else part
            return file_of(self.model, part, name)
        home = self.home if part == "shapes" and self.home else self.out
        return file_of(home, part, name)


def _write_way(path: Path, **arrays) -> None:
    """Write a map; an equal one keeps its date, and what was made of it counts."""
    from jfsf.storage._atomic import write_atomically

    if is_zipfile(path):  # or it is not there, or cut short
        with np.load(path) as file:
            same = set(file.files) == set(arrays)
            if same and all(np.array_equal(file[n], own) for n, own in arrays.items()):
                return
    write_atomically(path, lambda file: np.savez(file, **arrays))


def mirror_back(out: Path, shapes, graph):
    """The shapes, joined mirror images mirrored back; writes these as files too."""
    from jfsf.apps.export import export_mesh
    from jfsf.mesh._edit import mirror_image

    turned, names = {}, list(shapes)
    for name in (names[i] for i in graph.mirrored_back):
        (out / MIRRORED).mkdir(exist_ok=True)
        own = shapes[name]
        turned[name] = own._replace(mesh=mirror_image(own.mesh))
        export_mesh(out / MIRRORED / f"{name}.ply", turned[name].mesh)
    return ChainMap(turned, shapes)


def known_before(out: Path) -> set[str]:
    """Names of the shapes that the template is on, also by an earlier run."""
    files = (out / "registered").glob("*.npz")
    return {path.name.removesuffix(".npz") for path in files}


def forget(out: Path, names) -> None:
    """Remove what an earlier run wrote of shapes that are left out now, or gone."""
    for name in names:
        maps, on_shape = (file_of(out, part, name) for part in ("maps", "registered"))
        own = [maps, *pages_of(maps), file_of(out, "placed", name), on_shape]
        own += [on_shape.with_suffix(".ply"), picture_of_shape(out, name)]
        own += [file_of(out, "others", name), *carried_files(out, name)]
        rmtree(out / TEMPLATES / name, ignore_errors=True)
        for folder in (out / TEMPLATES).glob("*/"):
            own += [file_of(folder, part, name) for part in OF_TEMPLATE]
            own.append(file_of(folder, "registered", name).with_suffix(".ply"))
        for path in own:
            path.unlink(missing_ok=True)

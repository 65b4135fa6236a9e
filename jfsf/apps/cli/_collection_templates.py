"""Other templates of `jfsf collection`: more shapes that are put on all."""

from dataclasses import replace

import numpy as np

from jfsf.apps.cli._collection_jobs import Sketches, file_of
from jfsf.apps.cli._collection_runner import OF_TEMPLATE, TEMPLATES, OnFiles

OTHERS = "other templates"  # a stage before the last one


def put_others(shapes, graph, runner: OnFiles, most: int, named=()) -> list[str]:
    """Put other shapes than the template on all.

    What is made of each is in a folder of its own, a part of `TEMPLATES`. A mirror
    image that was mirrored back is none of them: its kept mesh is not mirrored.

    Args:
        shapes: what was kept of each, by name.
        graph: of these.
        runner: that has put the template on all.
        most: so many are put on all, those of `named` first, then the most central
            ones; more if more are named, and fewer if there are no more.
        named: names of shapes that are put on all in any case.

    Returns:
        The names of these shapes.
    """
    from jfsf.apps.collections._engine import put_on_all

    used = {graph.paths.template, *graph.mirrored_back}
    found = [i for i in graph.central if i not in used]
    # The sort is stable: those that are named, and then by centrality.
    found.sort(key=lambda i: runner.names[i] not in named)
    found = found[: max(most, sum(runner.names[i] in named for i in found))]
    sketches = Sketches(shapes)
    run = lambda jobs, **given: runner.run(jobs, **{**given, "label": OTHERS})
    for i in found:
        out = runner.out / TEMPLATES / runner.names[i]
        for part in OF_TEMPLATE:
            (out / part).mkdir(parents=True, exist_ok=True)
        own = replace(runner, out=out, report=False, run=run, home=runner.out)
        by_way = graph.with_template(i)
        failed = put_on_all(sketches, by_way, own)
        for j in {*failed, *np.flatnonzero(~by_way.joined).tolist()}:
            # That of an earlier run, with other shapes, does not count.
            file_of(out, "registered", runner.names[j]).unlink(missing_ok=True)
    return [runner.names[i] for i in found]

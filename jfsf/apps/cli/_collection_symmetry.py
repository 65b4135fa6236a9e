"""`jfsf collection --symmetric`: pairs of landmarks by the template's own mirror."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jfsf.apps.cli._collection_jobs import file_of, kept
from jfsf.apps.cli._print import counted
from jfsf.batch._jobs import Job

if TYPE_CHECKING:
    from jfsf.apps.landmarks import Landmarks

# A stage before the pairs, and the folder of the template's map to itself.
SYMMETRY = "symmetry"


def keep_symmetry(job: Job) -> None:
    """Write the map of a kept shape to itself that exchanges left and right."""
    from jfsf.matching import symmetry
    from jfsf.storage._atomic import write_atomically

    found = symmetry(kept(job.inputs[0]).mesh)
    arrays: dict[str, Any] = {
        "T_xy": np.asarray(found.T_xy),
        "confidence": np.asarray(found.certificate.confidence),
    }
    write_atomically(job.out, lambda file: np.savez(file, **arrays))


def pairs_of(
    out: Path,
    template: Path,
    points: "Landmarks",
    run: Callable[..., dict[Path, str | None]],
) -> tuple[np.ndarray, str]:
    """The pairs of landmarks, as `read_list` has them, and a sentence on them.

    Args:
        out: folder of the results.
        template: what is kept of it.
        points: its landmarks.
        run: `outcomes`, on some client.

    Raises:
        ValueError: it has no symmetry to be found.
    """
    from jfsf.apps.landmarks._pairs import _listed
    from jfsf.apps.landmarks._place import on_surface
    from jfsf.apps.landmarks._symmetric import WITHIN, mirror_pairs
    from jfsf.apps.morphometrics._tables import ALONE, LISTS

    (out / SYMMETRY).mkdir(exist_ok=True)
    job = Job((template,), file_of(out, SYMMETRY, template.stem))
    if why := run([job], label=SYMMETRY, work=keep_symmetry)[job.out]:
        raise ValueError(f"{template.stem}: --symmetric: {why}")
    with np.load(job.out) as file:
        T, sure = file["T_xy"], float(file["confidence"])
    mesh = kept(template).mesh
    placed = on_surface(points, mesh)
    found = mirror_pairs(mesh, placed, T, system=points.system)
    said = (
        f"symmetry of the template, confidence {sure:.2f}: "
        f"{counted(len(found.pairs), 'pair', 'pairs')} of landmarks, "
        f"{len(found.midline)} on the midline"
    )
    if len(found.alone):
        alone = [points.names[at] or str(at + 1) for at in found.alone.tolist()]
        said += (
            f", {len(alone)} without a partner within {WITHIN:.0%} of sqrt(area): "
            f"{_listed(alone)}; write their partners in {LISTS['pairs'].file}, or take "
            "out the lines of those on the midline; jfsf morphometrics leaves out the "
            "others"
        )
    alone = np.stack([found.alone, np.full_like(found.alone, ALONE)], 1)
    rows = np.concatenate([found.pairs, alone])
    return rows[np.argsort(rows[:, 0])], said

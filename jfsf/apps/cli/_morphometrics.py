"""jfsf morphometrics: the landmarks of many specimens, compared."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from jfsf.apps.cli._files import can_write_in, need_matplotlib
from jfsf.apps.cli._print import counted, say_result

MOST_SHOWN = 3  # components, and specimens far from the mean, on the screen
MOST_ESTIMATED = 10  # specimens whose missing landmarks are named
# A landmark without a partner is not on the midline if in the mean it is so far from
# it, in root mean square distances of landmarks from the centroid. By hand: of walking
# bodies those on the midline are within 0.05, those that lack a partner beyond 0.13.
OFF_MIDLINE = 0.1


class Slide(StrEnum):
    """`procrustes`'s slide, as choices of an option."""

    bending = "bending"
    procrustes = "procrustes"


def morphometrics(
    landmarks: Annotated[
        Path,
        typer.Argument(
            metavar="LANDMARKS",
            help="Landmarks of all specimens: landmarks.csv or landmarks.tps of jfsf "
            "collection, or any .tps, .csv, .tsv or .txt like them. Missing ones are "
            "estimated by thin-plate spline.",
        ),
    ],
    out: Annotated[
        Path, typer.Option(metavar="FOLDER", help="Folder for the results.")
    ],
    curves: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Semilandmarks of curves, as geomorph's curveslide.csv: before, slide "
            "and after, numbers of landmarks from 1.",
        ),
    ] = None,
    surfaces: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Semilandmarks of surfaces, as geomorph's surfslide.csv: a number of "
            "a landmark, from 1, on each line.",
        ),
    ] = None,
    slide: Annotated[
        Slide,
        typer.Option(
            help="Semilandmarks slide by least bending energy, or least Procrustes "
            "distance."
        ),
    ] = Slide.bending,
    pairs: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Paired landmarks, left and right, numbers from 1; the others are on "
            "the midline. Components and allometry then are those of the symmetric "
            "part of each specimen, and the asymmetric part is written too.",
        ),
    ] = None,
    groups: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="A table with titles: names of specimens, and columns of your own.",
        ),
    ] = None,
    group: Annotated[
        str | None,
        typer.Option(
            metavar="COLUMN",
            help="The column of --groups that is shown in colours; by default the "
            "second.",
        ),
    ] = None,
    template: Annotated[
        Path | None,
        typer.Option(
            metavar="MESH",
            help="A mesh to warp to the ends of the components, in its own place and "
            "size: that of a specimen, NAME.ply, or another with "
            "--template-landmarks. Without it the ends are landmarks (.fcsv).",
        ),
    ] = None,
    template_landmarks: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="The landmarks on --template, in any format that is read; paired by "
            "name or by order.",
        ),
    ] = None,
) -> None:
    """Superimpose the landmarks of many specimens, and compare their shapes.

    Procrustes analysis, sliding semilandmarks, principal components with a picture,
    the regression of shape on size, and specimens that are far from the others. The
    numbers are those of geomorph's gpagen.

    Example: jfsf morphometrics model/landmarks.csv --out shape --groups species.csv
    """
    from jfsf.apps.cli._morphometrics_compared import compare, template_of, two_sided
    from jfsf.apps.cli._morphometrics_results import write_results
    from jfsf.apps.landmarks import read_specimens
    from jfsf.apps.morphometrics._checks import PointsError
    from jfsf.apps.morphometrics._tables import read_groups

    need_matplotlib()
    can_write_in(out)
    inputs = landmarks, curves, surfaces, pairs, groups, template, template_landmarks
    for path in inputs:
        if path is not None and out.resolve() in path.resolve().parents:
            raise ValueError(f"--out {out}: {path} is in it; name another folder")
    if slide is Slide.procrustes and curves is None and surfaces is None:
        raise ValueError("--slide is for semilandmarks; give --curves or --surfaces")
    if group is not None and groups is None:
        raise ValueError("--group names a column of --groups; give that table too")
    if template_landmarks is not None and template is None:
        raise ValueError("--template-landmarks lie on a mesh; give --template too")
    found = read_specimens(landmarks)
    given = {"curves": curves, "surfaces": surfaces, "pairs": pairs}
    lists, doubts = _lists_of(given, len(found.landmarks), landmarks.parent)
    title, own = "", [""] * len(found.specimens)
    if groups is not None:
        title, own = read_groups(groups, found.specimens, group)
    two = two_sided(found, lists.pop("pairs", None))
    mesh = template and template_of(template, template_landmarks, two.found)
    try:
        compared = compare(found, two, mesh, slide=slide.value, **lists)
    except PointsError as error:
        why = error.named(found.specimens, found.landmarks)
        raise ValueError(f"{landmarks}: {why}") from None
    written = write_results(out, found, two.found, compared, title, own)
    if two.alone:
        doubts.append(
            f"{pairs}: left out of the symmetric shapes, as they have no partner: "
            f"{', '.join(two.alone)}"
        )
    if not compared.aligned.rested:
        doubts.append(
            "the shapes still moved when it ended, as gpagen does: they are far apart"
        )
    if beside := _beside(two, compared.parts):
        doubts.append(
            f"{pairs}: {beside} have no partner, so they count as on the midline, but "
            "are far from it; write their partners, or leave them out of "
            f"{landmarks.name}"
        )
    if groups is not None and (alone := _without(found.specimens, own)):
        doubts.append(f"{groups}: has no {title} of {alone}")
    lines = [*_read(found, lists, slide), *_summary(found.specimens, compared)]
    say_result([], lines, doubts, written)


def _lists_of(given, landmarks: int, folder: Path) -> tuple[dict, list[str]]:
    """The lists that are given, and what to say of others in the folder.

    Args:
        given: the file of each option, or None.
        landmarks: how many there are.
        folder: where these are.
    """
    from jfsf.apps.morphometrics._tables import LISTS, has_rows, read_list

    lists, unused = {}, []
    for option, path in given.items():
        beside = folder / LISTS[option].file
        if path is not None:
            lists[option] = read_list(path, LISTS[option], landmarks)
        elif has_rows(beside):
            unused.append(
                f"{beside} is there and was not used; add --{option} {beside}"
            )
    return lists, unused


def _read(found, lists, slide) -> list[str]:
    """What was read, which landmarks slide and which are estimated, in words."""
    from jfsf.apps.landmarks._record import titles_of

    line = f"{len(found.specimens)} specimens, {len(found.landmarks)} landmarks"
    if lists:
        slid = (f"{len(rows)} on {option}" for option, rows in lists.items())
        by = "bending energy" if slide is Slide.bending else "Procrustes distance"
        line += f"; {' and '.join(slid)} slide by {by}"
    lost = np.isnan(found.points).all(2)
    specimens = np.flatnonzero(lost.any(1))
    if not len(specimens):
        return [line]
    number = counted(int(lost.sum()), "landmark is", "landmarks are")
    lines = [line, f"{number} missing: estimated by thin-plate spline, from the others"]
    titles = np.array(titles_of(found.landmarks))
    for i in specimens[:MOST_ESTIMATED]:
        lines.append(f"  {found.specimens[i]}: {', '.join(titles[lost[i]])}")
    if (more := len(specimens) - MOST_ESTIMATED) > 0:
        lines.append(f"  and {more} specimens: the column estimated of sizes.csv")
    return lines


def _summary(specimens, compared) -> list[str]:
    """What was found, in words."""
    lines = []
    modes, allometry, parts = compared.modes, compared.allometry, compared.parts
    if parts is not None:
        directional = np.linalg.norm(parts.asymmetric.mean(0))
        lines.append(
            "asymmetry: mean Procrustes distance from the symmetric part "
            f"{parts.distances.mean():.3g}, of it directional {directional:.3g}"
        )
    shares = enumerate(modes.share[:MOST_SHOWN], 1)
    shown = ", ".join(f"PC{k} {share:.1%}" for k, share in shares)
    of = "" if parts is None else " of the symmetric part"
    lines.append(f"variance{of}: {shown or 'none'}")
    if isinstance(allometry, str):
        lines.append(f"no {allometry}")
    else:
        lines.append(
            f"allometry{of}: R2 {allometry.share:.1%}, F {allometry.F:.3g}, p "
            f"{allometry.p:.3g} ({allometry.orders} orders of the specimens, seed 0)"
        )
    return [*lines, *_unusual(specimens, compared.aligned)]


def _unusual(names, aligned) -> list[str]:
    """The specimens farthest from the mean, outliers, and likely mirror images."""
    from jfsf.apps.morphometrics._procrustes import turned

    distances = aligned.distances
    order = np.argsort(-distances)
    shown = ", ".join(f"{names[i]} {distances[i]:.3g}" for i in order[:MOST_SHOWN])
    line = f"farthest from the mean: {shown}; median {np.median(distances):.3g}"
    low, high = np.quantile(distances, [0.25, 0.75])
    # Tukey's fence, as geomorph's plotOutliers has it.
    far = [names[i] for i in order if distances[i] > high + 1.5 * (high - low)]
    images = turned(aligned.shapes * [-1, 1, 1], aligned.mean)
    nearer = np.linalg.norm(images - aligned.mean, axis=(1, 2)) < distances / 2
    mirrored = [names[i] for i in order if nearer[i]]
    lines = [line]
    if far:
        lines.append(f"outliers: {', '.join(far)}; look for misplaced landmarks")
    if mirrored:
        lines.append(
            f"mirror images of the others: {', '.join(mirrored)}? Nothing is mirrored; "
            "give all as left or all as right"
        )
    return lines


def _beside(two, parts) -> str:
    """Landmarks that no pair has, and that are not on the midline either."""
    from jfsf.apps.landmarks._record import titles_of

    if parts is None:
        return ""
    away = np.linalg.norm(parts.asymmetric.mean(0), axis=1)
    far = np.flatnonzero(away > OFF_MIDLINE / np.sqrt(len(away)))
    titles = titles_of(two.found.landmarks)
    names = [titles[i] for i in far if i not in two.pairs]
    return ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")


def _without(names, groups) -> str:
    """Names of specimens without a group."""
    alone = [name for name, own in zip(names, groups, strict=True) if not own]
    return ", ".join(alone[:5]) + (", ..." if len(alone) > 5 else "")

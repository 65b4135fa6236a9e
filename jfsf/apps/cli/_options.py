"""Options that several commands have, each declared once, and checks of them.

The texts are what `--help` shows.
"""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from jfsf.mesh._read import COMPRESSED, SUFFIXES


class Orientation(StrEnum):
    """`jfsf.match`'s orientation, as choices of an option."""

    preserve = "preserve"
    reverse = "reverse"
    any = "any"


class Up(StrEnum):
    """The axis that points up, as choices of an option."""

    x = "x"
    y = "y"
    z = "z"
    minus_x = "-x"
    minus_y = "-y"
    minus_z = "-z"


FORMATS = f"{', '.join(SUFFIXES)}; also packed, {', '.join(COMPRESSED)}."
MeshX = Annotated[Path, typer.Argument(metavar="X", help=FORMATS)]
MeshY = Annotated[Path, typer.Argument(metavar="Y", help=FORMATS)]
MapFile = Annotated[
    Path,
    typer.Argument(
        metavar="MAP", help="A file of match X Y, or T_xy as .npz, .mat, .map or .vts."
    ),
]
OrientationOption = Annotated[
    Orientation,
    typer.Option(help="Keep left and right, swap them, or take the better map."),
]
LandmarksOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Text file of known pairs: a line holds a vertex of X and one of Y, "
        "counted from 0.",
    ),
]
LandmarksXOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Landmarks of X: .mrk.json or .fcsv (3D Slicer), .pp (MeshLab), "
        ".particles (ShapeWorks), or a table of name,x,y,z or name,vertex (.csv, "
        ".tsv, .txt). Goes with those of Y, of --landmarks-y or of a line of a batch; "
        "they are paired by name, or by order.",
    ),
]
LandmarksYOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="The same for Y; in a batch, those of one template for all pairs.",
    ),
]
LargestOption = Annotated[
    bool,
    typer.Option(
        "--largest-component",
        help="Match the largest pieces only. Maps then count kept vertices; "
        "index_x and index_y in the file hold their numbers in X and Y.",
    ),
]
PartialOption = Annotated[
    bool,
    typer.Option(
        "--partial",
        help="One shape is a part of the other, or both overlap. "
        "The file then has matched_x and matched_y, the vertices that both have, "
        "membership_x and membership_y, how clearly, and the shares of the areas. "
        "Pictures, pages and exported meshes show the others in grey.",
    ),
]
AnyUnitOption = Annotated[
    bool,
    typer.Option(
        "--any-unit/--same-unit",
        help="With --partial: the files may have different units. The first is made as "
        "long as the second, and 0.4 to 2.5 times that is tried.",
    ),
]
RepairOption = Annotated[
    bool,
    typer.Option(
        "--repair",
        help="Repair the meshes first, see info. Maps still count the vertices of "
        "the files: one that was removed goes where the nearest goes. With "
        "--largest-component all other pieces are removed.",
    ),
]
MapRepairOption = Annotated[
    bool,
    typer.Option(
        "--repair",
        help="Repair the meshes first, for a map of match --repair. What transfer "
        "carries is that of the files all the same.",
    ),
]
CheckerOption = Annotated[
    bool,
    typer.Option(
        "--checker", help="Export a checker carried from Y too (.obj and .glb)."
    ),
]
ByPlaceOption = Annotated[
    bool,
    typer.Option(
        "--by-place",
        help="Export Y coloured by place, even if its file has colours of vertices.",
    ),
]
GroundTruthX = Annotated[
    Path | None,
    typer.Option(help="Ground truth: line i is the vertex of X at point i."),
]
GroundTruthY = Annotated[
    Path | None, typer.Option(help="The same for Y; text files count from 1.")
]
BaseOption = Annotated[
    int | None,
    typer.Option(
        min=0, max=1, help="First index in text files that break the convention."
    ),
]
UpOption = Annotated[
    Up,
    typer.Option(
        help="Axis of the file of X that points up, for pictures, the page and colours."
    ),
]
NoCacheOption = Annotated[
    bool,
    typer.Option(
        "--no-cache", help="Leave the cache folder alone: spectra are made anew."
    ),
]
SchedulerOption = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="A dask scheduler, host:port; its workers must see the same files. "
        "Without it, processes on this machine.",
    ),
]
WorkersOption = Annotated[
    int | None,
    typer.Option(
        min=1, help="Local processes, one a core by default. Give 1 for one GPU."
    ),
]


def check_pair(given, *, report: bool) -> None:
    """ValueError if options of a pair do not go together.

    Args:
        given: `jfsf.batch._pair_list.PairOptions` of the pair.
        report: whether a page is written, for which ground truth is.
    """
    if (given.landmarks_x is None) != (given.landmarks_y is None):
        raise ValueError("--landmarks-x and --landmarks-y go together; give both")
    if given.landmarks is not None and given.landmarks_x is not None:
        raise ValueError(
            "--landmarks holds pairs of vertices, --landmarks-x and --landmarks-y the "
            "landmarks of each shape; give one or the other"
        )
    check_truth(given.gt_x, given.gt_y)
    if given.gt_x is not None and not report:
        raise ValueError(f"{given.gt_x}: ground truth is for the report; add --report")


def check_truth(gt_x: Path | None, gt_y: Path | None) -> None:
    """ValueError if one file of ground truth is missing."""
    if (gt_x is None) != (gt_y is None):
        raise ValueError("ground truth takes both --gt-x and --gt-y")


def check_any_unit(any_unit: bool, partial: bool) -> None:
    """ValueError if units are said of shapes of which none is a part."""
    if any_unit and not partial:
        raise ValueError("--any-unit goes with --partial; sizes of wholes never matter")

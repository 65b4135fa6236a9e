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


FORMATS = f"{', '.join(SUFFIXES)}; also compressed, {', '.join(COMPRESSED)}."
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
    typer.Option(
        help="Preserve left and right, exchange them, or take the better map."
    ),
]
LandmarksOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Text file of known pairs: each line holds a vertex of X and a vertex of "
        "Y, counted from 0.",
    ),
]
LandmarksXOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Landmarks of X: .mrk.json or .fcsv (3D Slicer), .pp (MeshLab), "
        ".particles (ShapeWorks), or a table of name,x,y,z or name,vertex (.csv, "
        ".tsv, .txt). They are paired with those of Y (--landmarks-y, or a column of a "
        "batch) by name, or by order.",
    ),
]
LandmarksYOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Landmarks of Y, in any format of --landmarks-x; in a batch, those of one "
        "template for all pairs.",
    ),
]
LargestOption = Annotated[
    bool,
    typer.Option(
        "--largest-component",
        help="Match only the connected component with the largest area of each shape. "
        "Maps then count the kept vertices; index_x and index_y in the file hold their "
        "numbers in the files of X and Y.",
    ),
]
PartialOption = Annotated[
    bool,
    typer.Option(
        "--partial",
        help="One shape is a part of the other, or both overlap. "
        "The file then also has matched_x and matched_y (whether a vertex is in the "
        "shared region), membership_x and membership_y (how clearly it is) and the "
        "shares of the areas. Pictures, reports and exported meshes show all other "
        "vertices in grey.",
    ),
]
AnyUnitOption = Annotated[
    bool,
    typer.Option(
        "--any-unit/--same-unit",
        help="With --partial: the files may have different units. X is scaled to the "
        "length of Y, and 0.4 to 2.5 times that is tried.",
    ),
]
RepairOption = Annotated[
    bool,
    typer.Option(
        "--repair",
        help="Repair the meshes first, as jfsf info --help says. Maps still count the "
        "vertices of the files: a removed vertex maps where the nearest one left does. "
        "With --largest-component all other components are removed.",
    ),
]
MapRepairOption = Annotated[
    bool,
    typer.Option(
        "--repair",
        help="Repair the meshes first, for a map of match --repair. Data and results "
        "of jfsf transfer still count the vertices and faces of the files.",
    ),
]
CheckerOption = Annotated[
    bool,
    typer.Option(
        "--checker",
        help="Add to the exported mesh a checker that is carried from Y (.obj, .glb).",
    ),
]
ByPlaceOption = Annotated[
    bool,
    typer.Option(
        "--by-place",
        help="Colour Y by place, even if its file has vertex colours.",
    ),
]
GroundTruthX = Annotated[
    Path | None,
    typer.Option(
        help="Ground truth of X: line i is the vertex of X at point i, counted from 1 "
        "in text files."
    ),
]
GroundTruthY = Annotated[
    Path | None,
    typer.Option(
        help="Ground truth of Y: line i is the vertex of Y at point i, counted from 1 "
        "in text files."
    ),
]
BaseOption = Annotated[
    int | None,
    typer.Option(
        min=0,
        max=1,
        help="First index in text files of maps and ground truth, if it is not 1.",
    ),
]
UpOption = Annotated[
    Up,
    typer.Option(
        help="Axis that points up in the file of X, for pictures, the report and "
        "colours."
    ),
]
NoCacheOption = Annotated[
    bool,
    typer.Option(
        "--no-cache",
        help="Neither read nor write the cache folder: spectra are computed again.",
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
        min=1,
        help="Local processes, by default one for each core, as far as memory allows. "
        "Give 1 for one GPU.",
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

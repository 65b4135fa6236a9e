"""The data sets, what each is for, and when a map is right. The one place for both.

Numbers on shapes that a method was tuned on say little about others, so every set, or
every pair of it, has a role:

- "fit": constants are fitted to it, such as those of the confidence (`calibration.py`)
- "choose": settings, and what is kept of several ideas, are chosen on it
- "report": it is only looked at to report numbers

`guard.py` watches all of them, so what it says of a set for reporting may stop a
change, but nothing is chosen by it.

A table says of each of its rows which it is. Change a role in its line of `SETS`.
`roles=("fit", "fit", "fit", "choose")` gives every fourth pair of a list to another
role; but pairs of one list share shapes, so a set of its own says more. Sets may share
bodies too: those of BeCoS (`becos_*`) are FAUST's, TOSCA's and others', on other
meshes.

Data other than the package's are licensed for research, and not in here: they are
folders below one root, `--data ROOT` or `JFSF_DATA`. `datasets.py` reads them.
"""

from pathlib import Path
from typing import NamedTuple

# A map is right if its mean geodesic error, in sqrt(area of Y), is below this, or below
# what the set says (`DataSet.right`).
RIGHT = 0.1

ROLES = ("fit", "choose", "report")
KINDS = ("near", "far", "part")
TRUTHS = ("template", "landmarks", "listed", "identity", "package")


class DataSet(NamedTuple):
    """A set of pairs, and what it is for.

    name: of the set, and of its results: match_NAME.json.
    folders: below the root; a shape is NAME.off, off/NAME.off or NAME.ply in the first
        that has it. Lists are in the first. Empty for shapes of the package.
    truth: "template": corres/NAME.vts, a 1-based vertex for each template point, and
        corres/NAME.sym.vts, where there is one, of its mirror image. "landmarks":
        vts/NAME.vts, rows (0-based vertex, x, y, z), of which a pair has as many as the
        shorter file. "listed": two files of 1-based vertices, named in the list.
        "identity": one connectivity. "package": embedded shapes.
    roles: the role of all pairs, or of each in turn.
    kind: "near": poses of one body, or of bodies alike, or the same with small
        damage. "far": other proportions. "part": one is, or both are, a part of a whole
        (`match(partial=True)`).
    pairs: the list in the first folder: lines `X Y`, `X Y error seconds` (a rival's)
        or `X Y gt_x gt_y`. Empty: all ordered pairs of the shapes.
    number: so many of them, spread evenly; 0 for all.
    largest: keep the largest component of each mesh, and the truth that is on it.
    same_unit: whether both shapes of a part's pair are in one unit.
    right: a map is right below this mean error. More than `RIGHT` where the truth
        itself is not known so well.
    """

    name: str
    folders: tuple[str | Path, ...]
    truth: str
    roles: tuple[str, ...]
    kind: str
    pairs: str | Path = "pairs.txt"
    number: int = 0
    largest: bool = False
    same_unit: bool = True
    right: float = RIGHT

    def role(self, i: int) -> str:
        """The role of pair i."""
        return self.roles[i % len(self.roles)]


def _external(name: str, role: str, kind: str, **others) -> DataSet:
    return DataSet(name, (f"external/{name}",), "listed", (role,), kind, **others)


_CREATURES = "makehuman_cc0/creatures", "makehuman_cc0/remeshed"
_FIT, _CHOOSE, _REPORT = ("fit",), ("choose",), ("report",)
_ROWS = (
    # Poses of people, remeshed; other poses of TOSCA's animals and people.
    DataSet("faust_r", ("faust_r",), "template", _FIT, "near", "dev_pairs.txt"),
    DataSet(
        "tosca_iso_r", ("tosca_iso_r",), "template", _FIT, "near", "test_pairs.txt", 100
    ),
    DataSet("embedded", (), "package", _CHOOSE, "near", "", 48),
    # Bodies with other limbs, to people and to each other.
    DataSet("creatures", _CREATURES, "template", _FIT, "far", "dev_pairs.txt"),
    # Classes of SHREC'07 with the errors of Blended Intrinsic Maps; then other models.
    DataSet("shrec07", ("shrec07",), "landmarks", _FIT, "far", "dev_pairs_bim.txt"),
    DataSet(
        *("shrec07_more", ("shrec07",), "landmarks", _REPORT, "far"),
        pairs="dev_pairs_bim_more.txt",
    ),
    _external("becos_ff", "fit", "far"),  # whole animals and people
    _external("smal_whole", "report", "far"),  # animals of different species
    _external("gorilla", "choose", "far"),  # an ape to people
    # Animals of different species, scanned or modelled: landmarks by several people.
    _external("shrec20_full", "choose", "far"),
    _external("calcanei", "choose", "near"),  # heel bones, 13 landmarks by an expert
    # Macaque to human, centres of 27 areas; the authors' own registration is 0.05 to
    # 0.07 off. The human ones mirrored at a principal plane are at least 0.24 off,
    # turned by half 0.40: right is what is neither.
    _external("cortex_species", "choose", "far", right=0.2),
    _external("topkids_low", "choose", "near"),  # children with glued limbs
    # Tunnels through the bone; decimated, which leaves loose pieces.
    _external("mouse_skulls", "report", "near", largest=True),
    _external("hdm_molars", "fit", "far"),  # four landmarks: for gross errors only
    _external("becos_pf", "fit", "part"),  # one camera's view, to a whole template
    _external("becos_pp", "fit", "part"),  # view to view
    _external("psmal", "choose", "part"),  # parts of different animals
    # Scans with holes, each to an animal of another species and size.
    _external("shrec20_partial", "choose", "part", same_unit=False),
)
SETS = {row.name: row for row in _ROWS}


def named(names: list[str]) -> list[DataSet]:
    """The sets that are named: by their own names, by a role, or "all"; each once."""
    found = []
    for name in names:
        if name in SETS:
            found.append(SETS[name])
        elif name in (*ROLES, "all"):
            found += [s for s in SETS.values() if name == "all" or name in s.roles]
        else:
            known = ", ".join((*SETS, *ROLES, "all"))
            raise ValueError(f"no data set {name!r}; there are {known}")
    return list(dict.fromkeys(found))


def below(data: DataSet, root: Path) -> DataSet:
    """The set with the paths of its folders."""
    return data._replace(folders=tuple(root / folder for folder in data.folders))


def is_right(error: float, right: float = RIGHT) -> bool:
    """Whether a map with this mean error is right; `right` is that of its set."""
    return bool(error < right)

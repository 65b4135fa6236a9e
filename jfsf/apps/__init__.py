"""What people do with maps once they are there. The library never imports this.

In this order: a room imports from the library, and from those above its own.

- `registration`: a template mesh deformed onto a scan
- `mapfiles`: maps, ground truth and matches on disk
- `landmarks`: landmark files of other programs: read, written, paired, carried
- `interop`: to and from other packages: pyFM, MATLAB
- `plot`: pictures by colour transfer, and charts
- `export`: meshes in the colours of a map, for other programs
- `transfer`: values, labels, landmarks and textures carried along a map
- `model`: statistical shape models of meshes in correspondence
- `morphometrics`: landmarks of many specimens: superimposed, slid, compared
- `collections`: many shapes at once: maps that agree, and one topology for all
- `pieces`: shapes of several connected pieces, matched piece to piece
- `report`: pages to look at a map in a browser, and the confidence in words
- `cli`: the command line
- `guide`: the guides of the manual, a page each
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jfsf.apps import cli as cli
    from jfsf.apps import collections as collections
    from jfsf.apps import export as export
    from jfsf.apps import guide as guide
    from jfsf.apps import interop as interop
    from jfsf.apps import landmarks as landmarks
    from jfsf.apps import mapfiles as mapfiles
    from jfsf.apps import model as model
    from jfsf.apps import morphometrics as morphometrics
    from jfsf.apps import pieces as pieces
    from jfsf.apps import plot as plot
    from jfsf.apps import registration as registration
    from jfsf.apps import report as report
    from jfsf.apps import transfer as transfer

_ROOMS = (
    "registration mapfiles landmarks interop plot export transfer model morphometrics "
    "collections pieces report cli guide"
).split()


def __getattr__(name: str) -> Any:
    if name in _ROOMS:
        return import_module(f"jfsf.apps.{name}")
    raise AttributeError(f"module 'jfsf.apps' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_ROOMS})

"""Converters: (emb_x, emb_y) -> maps."""

from jfsf.convert.nn import brief_nearest, nearest
from jfsf.convert.precise import (
    functional_map_precise,
    precise,
    pull_back_precise,
    to_vertex,
)
from jfsf.convert.sinkhorn import (
    brief,
    plan_entries,
    pull_back,
    scale_kernel,
    sinkhorn,
)

__all__ = [
    "brief",
    "brief_nearest",
    "functional_map_precise",
    "nearest",
    "plan_entries",
    "precise",
    "pull_back",
    "pull_back_precise",
    "scale_kernel",
    "sinkhorn",
    "to_vertex",
]

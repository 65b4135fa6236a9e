"""Converters: (emb_x, emb_y) -> maps both ways."""

from jfsf.convert.nn import nearest
from jfsf.convert.sinkhorn import plan_entries, pull_back, scale_kernel, sinkhorn

__all__ = ["nearest", "plan_entries", "pull_back", "scale_kernel", "sinkhorn"]

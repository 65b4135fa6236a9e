"""Refinement: scans that alternate map and functional map, over any converter."""

from jfsf.refine.icp import icp
from jfsf.refine.zoomout import Converter, zoomout

__all__ = ["Converter", "icp", "zoomout"]

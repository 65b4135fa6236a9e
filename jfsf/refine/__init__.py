"""Refinement over any converter: of functional maps, and of maps by bending shapes."""

from jfsf.refine.arap import arap
from jfsf.refine.icp import icp
from jfsf.refine.zoomout import Converter, zoomout

__all__ = ["Converter", "arap", "icp", "zoomout"]

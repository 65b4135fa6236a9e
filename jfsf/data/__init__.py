"""Twelve posed people under CC0, to try the library on.

Read in this order:

- `_shapes`: the names of the shapes, and a shape with its ground truth
"""

from jfsf.data._shapes import Sample, load, names

__all__ = ["Sample", "load", "names"]

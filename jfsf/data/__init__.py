"""Posed people under CC0, to try the library on."""

from jfsf.data.shapes import Sample, load, names

__all__ = ["Sample", "load", "names"]

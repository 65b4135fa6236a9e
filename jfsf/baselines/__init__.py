"""The rivals of the paper's tables, to be measured against; on the host, not jitted."""

from jfsf.baselines.auction import auction
from jfsf.baselines.bcicp import bcicp
from jfsf.baselines.cpd import cpd
from jfsf.baselines.deblur import deblur
from jfsf.baselines.pmf import pmf
from jfsf.baselines.rhm import rhm

__all__ = ["auction", "bcicp", "cpd", "deblur", "pmf", "rhm"]

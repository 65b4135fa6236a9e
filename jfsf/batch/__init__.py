"""Many pairs: from few compiled programs in Python, or from files through dask.

In Python `convert`, `refine`, `search` and `match_spectra` take lists of shapes of any
sizes and use all devices of the process. With several processes each takes its shard of
the pairs (`join`, `local_shard`). From files, `run_jobs` runs a resumable list of jobs
on a dask cluster.

Read in this order:

- `_pairs`: conversion, refinement, search and matching of many pairs
- `_cluster`: several processes or machines: shards of the pairs, or a dask cluster
- `_jobs`: jobs from files to files, resumable
- `_pair_list`: lists of pairs in CSV files
"""

from jfsf.batch._cluster import join, local_shard
from jfsf.batch._pairs import convert, match_spectra, refine, search
from jfsf.runtime import map_pairs

__all__ = [
    "convert",
    "join",
    "local_shard",
    "map_pairs",
    "match_spectra",
    "refine",
    "search",
]

"""Statistical shape models of meshes in correspondence, which share their faces.

Align the shapes, take their mean and the modes in which they vary, ask how good the
model is, and keep it.

Read in this order:

- `_checks`: arguments, checked
- `_align`: shapes onto their mean: generalised Procrustes analysis
- `_model`: shapes to a model, scores to shapes, and shapes to scores
- `_quality`: compactness, generality and specificity
- `_files`: models, scores and modes on disk
"""

from jfsf.apps.model._align import align
from jfsf.apps.model._files import read_model, write_model, write_modes, write_scores
from jfsf.apps.model._model import ShapeModel, fit_model, scores_of, shape_at
from jfsf.apps.model._quality import compactness, generality, specificity

__all__ = [
    "ShapeModel",
    "align",
    "compactness",
    "fit_model",
    "generality",
    "read_model",
    "scores_of",
    "shape_at",
    "specificity",
    "write_model",
    "write_modes",
    "write_scores",
]

"""Statistical shape models of meshes in correspondence, which share their faces.

Align the shapes, take their mean and the modes in which they vary, ask how good the
model is, and keep it. All of it is traced, but for batches, files and sentences.

Read in this order:

- `_checks`: arguments, checked
- `_rotations`: rotations of matrices, and their logarithms
- `_align`: shapes onto their mean: generalised Procrustes analysis
- `_gradients`: positions to deformation gradients, and back
- `_records`: the two kinds of models, of positions and of gradients
- `_fit`: shapes to a model
- `_batches`: a model of more shapes than memory holds
- `_shapes`: scores to shapes, and shapes to scores
- `_quality`: compactness, generality and specificity
- `_bending`: whether shapes bend too far for modes of positions
- `_files`: models, scores and modes on disk
"""

from jfsf.apps.model._align import AlignedShapes, align, align_onto
from jfsf.apps.model._batches import fit_model_in_batches
from jfsf.apps.model._bending import MOST_TURN, bending_warning, local_rotation
from jfsf.apps.model._checks import centred
from jfsf.apps.model._files import read_model, write_model, write_modes, write_scores
from jfsf.apps.model._fit import fit_gradient_model, fit_model
from jfsf.apps.model._gradients import from_gradients, gradients_of
from jfsf.apps.model._quality import (
    Compactness,
    Distances,
    compactness,
    generality,
    specificity,
)
from jfsf.apps.model._records import GradientModel, Model, ShapeModel
from jfsf.apps.model._shapes import moved_onto, scores_of, shape_at

__all__ = [
    "AlignedShapes",
    "Compactness",
    "Distances",
    "GradientModel",
    "MOST_TURN",
    "Model",
    "ShapeModel",
    "align",
    "align_onto",
    "bending_warning",
    "centred",
    "compactness",
    "fit_gradient_model",
    "fit_model",
    "fit_model_in_batches",
    "from_gradients",
    "generality",
    "gradients_of",
    "local_rotation",
    "moved_onto",
    "read_model",
    "scores_of",
    "shape_at",
    "specificity",
    "write_model",
    "write_modes",
    "write_scores",
]

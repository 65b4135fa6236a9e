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

from jfsf.model._align import AlignedShapes, align, align_onto
from jfsf.model._batches import fit_model_in_batches
from jfsf.model._bending import MOST_TURN, bending_warning, local_rotation
from jfsf.model._checks import centred
from jfsf.model._files import read_model, write_model, write_modes, write_scores
from jfsf.model._fit import fit_gradient_model, fit_model
from jfsf.model._gradients import from_gradients, gradients_of
from jfsf.model._quality import (
    Compactness,
    Distances,
    compactness,
    generality,
    specificity,
)
from jfsf.model._records import GradientModel, Model, ShapeModel
from jfsf.model._shapes import moved_onto, scores_of, shape_at

__all__ = [
    "MOST_TURN",
    "AlignedShapes",
    "Compactness",
    "Distances",
    "GradientModel",
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

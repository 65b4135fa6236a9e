"""Models on disk: all of one, scores as a table, and modes as meshes."""

import csv
import io
import os
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from jfsf.apps.export import export_mesh
from jfsf.apps.model._model import ShapeModel, shape_at
from jfsf.storage._atomic import read_npz_array, write_atomically, write_text
from jfsf.types import Mesh

KIND = "positions"  # older versions wrote models of deformation gradients too
DEVIATIONS = 3  # of the meshes of a mode, to either side


def write_model(path: str | os.PathLike[str], model: ShapeModel) -> None:
    """Write a model as `.npz`: an array for each field, and `kind`, "positions".

    The file appears complete or not at all.

    Raises:
        ValueError: another suffix.
        OSError: the folder cannot be written.
    """
    path = _with_suffix(path, ".npz", "a model")
    arrays: dict[str, Any] = {"kind": np.array(KIND)}
    arrays |= {name: np.asarray(value) for name, value in model._asdict().items()}
    write_atomically(path, lambda file: np.savez(file, **arrays))


def read_model(path: str | os.PathLike[str]) -> ShapeModel:
    """Read a model that `write_model` wrote, in numpy arrays.

    Raises:
        ValueError: missing, damaged, or no model; the message says what to do.
    """
    path = Path(path)
    try:
        with zipfile.ZipFile(path) as file:
            if str(read_npz_array(file, "kind")) != KIND:
                raise ValueError("it is of a kind that this version does not know")
            fields: Any = [read_npz_array(file, name) for name in ShapeModel._fields]
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror}; check the path") from None
    except Exception as error:  # numpy and zipfile raise nearly any
        raise ValueError(
            f"{path}: damaged, or no model ({error}); write it again with write_model"
        ) from None
    model = ShapeModel(*fields)
    _check_fields(path, model)
    return model


def write_scores(
    path: str | os.PathLike[str], names: Sequence[str], model: ShapeModel
) -> None:
    """Write scores as CSV: a line for each shape, a column for each mode.

    The first line has the titles `name`, `score_1` and so on. The file appears complete
    or not at all.

    Args:
        path: `.csv`.
        names: a name for each shape that the model was fitted to, in that order.
        model: a shape model.

    Raises:
        ValueError: another suffix, or more or fewer names than shapes.
        OSError: the folder cannot be written.
    """
    path = _with_suffix(path, ".csv", "a table of scores")
    scores = np.asarray(model.scores)
    if len(names) != len(scores):
        raise ValueError(
            f"write_scores: {len(names)} names for the scores of {len(scores)} shapes"
        )
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["name", *(f"score_{k + 1}" for k in range(scores.shape[1]))])
    for name, row in zip(names, scores, strict=True):
        table.writerow([name, *(float(value) for value in row)])
    write_text(path, text.getvalue())


def write_modes(
    folder: str | os.PathLike[str], model: ShapeModel, *, modes: int = 3
) -> list[Path]:
    """Write the mean and the first modes as PLY, in the unit of the shapes.

    `mean.ply`, and of each mode k from 1 `mode_k_minus.ply` and `mode_k_plus.ply`, at
    three standard deviations to either side. Each file appears complete or not at all.

    Args:
        folder: is made if need be.
        model: a shape model.
        modes: how many; all that there are, if these are fewer.

    Returns:
        The files, in that order.

    Raises:
        ValueError: modes is negative.
        OSError: the folder cannot be written.
    """
    if modes < 0:
        raise ValueError(f"write_modes: modes is {modes}, it cannot be negative")
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    shapes = {"mean": np.asarray(model.mean)}
    for k in range(min(modes, len(model.modes))):
        reach = DEVIATIONS * np.sqrt(np.asarray(model.variance)[k])
        for side, sign in (("minus", -1), ("plus", 1)):
            scores = jnp.zeros(len(model.modes), model.mean.dtype).at[k]
            name = f"mode_{k + 1}_{side}"
            shapes[name] = np.asarray(shape_at(model, scores.set(sign * reach)))
    written = [folder / f"{name}.ply" for name in shapes]
    for path, points in zip(written, shapes.values(), strict=True):
        export_mesh(path, Mesh(points, np.asarray(model.faces)))
    return written


def _check_fields(path, model):
    """ValueError unless the arrays are finite and of one model."""
    n, k = len(model.mean), len(model.modes)
    shapes = {
        "mean": (n, 3),
        "modes": (k, n, 3),
        "variance": (k,),
        "scores": (len(model.scores), k),
        "faces": (len(model.faces), 3),
        "weights": (n,),
        "total_variance": (),
        "size": (),
    }
    for name, values in model._asdict().items():
        if values.shape != shapes[name]:
            raise ValueError(
                f"{path}[{name}]: is {values.shape}, expected {shapes[name]}; write it "
                "again with write_model"
            )
        kinds = "iu" if name == "faces" else "f"
        if values.dtype.kind not in kinds or not np.isfinite(values).all():
            raise ValueError(
                f"{path}[{name}]: holds {values.dtype}, or what is not finite; write "
                "it again with write_model"
            )
    faces = model.faces
    if len(faces) and not (0 <= faces.min() and faces.max() < n):
        raise ValueError(
            f"{path}[faces]: name vertices {faces.min()} to {faces.max()} of {n}; "
            "write it again with write_model"
        )


def _with_suffix(path, suffix, what):
    path = Path(path)
    if path.suffix.lower() != suffix:
        raise ValueError(f"{path}: {what} is written as {suffix}, not {path.suffix!r}")
    return path

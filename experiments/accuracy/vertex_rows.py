"""Evidence and errors of vertices: what the radius of a vertex is fitted to.

Some pairs of each set of whole shapes are matched. Written is, for some points of the
ground truth and both directions, the error and what the map knew there
(`jfsf.matching._vertices.vertex_evidence`). The evidence is that of the attempt that
won, whose last steps are done again.

    python -m experiments.accuracy.vertex_rows --data ROOT [SET ...] [--out RESULT.json]

A column is one string of numbers: a number a line would make the file long.
"""

from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Float, Int

import jfsf
from experiments import command_line, results_file
from experiments.accuracy import datasets, protocol
from jfsf.geometry import geodesics
from jfsf.matching._bent_copies import bent_as_copies
from jfsf.matching._match import attempted_pair
from jfsf.matching._pairs import PairState
from jfsf.matching._stages import pair_search
from jfsf.matching._steps import FINISH, steps_of
from jfsf.matching._vertices import VERTEX_EVIDENCE, vertex_evidence
from jfsf.mesh import surface_area
from jfsf.runtime._runners import OneByOne
from jfsf.types import Aligned, ArrayLike, Maps

# Pairs of each set, spread over its list.
PAIRS = {
    **{"faust_r": 3, "tosca_iso_r": 4, "embedded": 3, "creatures": 4, "shrec07": 5},
    **{"becos_ff": 3, "smal_whole": 3, "topkids_low": 3, "mouse_skulls": 2},
    **{"calcanei": 3, "shrec20_full": 4},
}
NUMBER = 80  # points of a pair: they are not independent
ERROR = "error"


def main() -> None:
    parser = command_line.parser(__doc__, out="vertex_rows.json", data=True)
    parser.add_argument("sets", nargs="*", help=f"default: {', '.join(PAIRS)}")
    args = command_line.parse(parser)
    rows = []
    for name in args.sets or PAIRS:
        data_set = protocol.below(protocol.SETS[name], Path(args.data))
        for pair in datasets.spread(datasets.pairs_of(data_set), PAIRS[name]):
            x, y = datasets.load_pair_of(data_set, pair)
            rows.append({"set": name, "x": pair.x, "y": pair.y} | measured(x, y))
            print(name, pair.x, pair.y, f"{rows[-1]['error']:.4f}", flush=True)
            results_file.write(args.out, settings={"points": NUMBER}, pairs=rows)


def measured(x: datasets.Shape, y: datasets.Shape) -> dict[str, Any]:
    """One row: mean error and confidence of the map, and both sides of the pair."""
    settings = jfsf.Settings()
    state = attempted_pair(x.mesh, y.mesh, settings=settings)
    match = state.result(settings)  # without padding
    at = chosen(len(x.truth))
    on = x.truth[at], y.truth[at]
    roots = [np.sqrt(surface_area(shape.mesh)) for shape in (x, y)]
    errors = [
        np.asarray(geodesics(goal.mesh, there))[range(len(at)), np.asarray(T)[here]]
        / root
        for goal, here, there, T, root in (
            (y, *on, match.T_xy, roots[1]),
            (x, *on[::-1], match.T_yx, roots[0]),
        )
    ]
    sides = zip("xy", evidence_of(state), on, errors, strict=True)
    return {
        "error": round(float(errors[0].mean()), 5),
        "confidence": round(float(match.certificate.confidence), 4),
        "vertices": {name: to_row(*side) for name, *side in sides},
    }


def evidence_of(state: PairState) -> tuple[jax.Array, jax.Array]:
    """Of the vertices of both shapes, padded, by the attempt that won."""
    settings = jfsf.Settings()
    attempt, runner = state.attempts[state.won], OneByOne(True, None)
    work = state.begin(attempt.start)
    if attempt.source in ("coarse copies", "motion"):  # it was refined already
        work = work._replace(C_yx=attempt.start.C_yx)
    else:
        for step in steps_of(None):
            if step is not FINISH:
                stage = partial(step.run, settings=settings.of_stages())
                [made] = runner.map(step.name, stage, [step.reads(work)])
                work = step.done(work, made)
    [work] = bent_as_copies([state], [work], runner, settings)
    aligned = _aligned(state.spectra, work.C_yx, attempt.start.sign, settings=settings)
    maps = Maps(attempt.match.T_xy, attempt.match.T_yx)
    return vertex_evidence(maps, aligned, state.spectra)


@partial(jax.jit, static_argnames="settings")
def _aligned(spectra, C_yx, sign, *, settings) -> Aligned:
    search = pair_search(*spectra, settings=settings)
    return settings.deform(*spectra, C_yx, sign, search, settings=settings)


def chosen(points: int, *, number: int = NUMBER, seed: int = 0) -> np.ndarray:
    """Which of the points of a ground truth are written."""
    return np.random.default_rng(seed).permutation(points)[:number]


def to_row(
    evidence: Float[ArrayLike, "n f"],
    vertices: Int[ArrayLike, " p"],
    errors: Float[ArrayLike, " p"],
) -> dict[str, str]:
    """The columns of one direction.

    Args:
        evidence: of all vertices, by `jfsf.matching._vertices.vertex_evidence`.
        vertices: those whose error is known.
        errors: theirs, geodesic, in sqrt(area) of the other shape.
    """
    columns = zip(VERTEX_EVIDENCE, np.asarray(evidence)[vertices].T, strict=True)
    text = {name: _text(values, "%.2f") for name, values in columns}
    return {ERROR: _text(errors, "%.4f"), **text}


def from_row(row: dict[str, str]) -> tuple[np.ndarray, np.ndarray]:
    """Evidence (p, f) and errors (p,)."""
    names = (*VERTEX_EVIDENCE, ERROR)
    *evidence, errors = (np.array(row[name].split(), float) for name in names)
    return np.stack(evidence, 1), errors


def _text(values, form):
    return " ".join(form % value for value in np.asarray(values))


if __name__ == "__main__":
    main()

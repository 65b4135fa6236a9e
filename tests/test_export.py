"""Every stage lowers for GPUs and TPUs, on a machine that has none."""

import re
from functools import partial

import jax
import jax.numpy as jnp
import pytest
from jax import export

from jfsf import Settings, pipeline
from jfsf.initial import orientation_sign
from jfsf.types import Spectrum

PLATFORMS = ("cuda", "rocm", "tpu")


def shape(n, k=128):
    faces = jnp.zeros((2 * n, 3), jnp.int32)
    number = partial(jnp.zeros, dtype=jnp.float32)
    return jax.eval_shape(
        lambda: Spectrum(number(k), number((n, k)), number(n), faces, number((n, 3)))
    )


def exported_stages(spec, landmarks, settings):
    """(name, program) of each stage, in the order in which `match` calls them."""
    programs = []

    def run(stage, *args):
        program = export.export(jax.jit(stage), platforms=PLATFORMS)(*args)
        programs.append((stage.func.__name__, program.mlir_module()))
        return jax.eval_shape(stage, *args)

    def run_sides(stage, x, y):
        del y  # of the same shape
        found = run(stage, *x)
        return found, found

    def all_starts(attempt, first, others, *_):
        found = attempt(first)
        others[-1]()  # the others run stages that have run already
        return found

    pipeline.run_stages(
        *(spec, spec, landmarks, None, None),
        *(orientation_sign("preserve"), False),
        settings=settings,
        run=run,
        run_sides=run_sides,
        most_confident=all_starts,
        most_promising=lambda promise, starts, num: starts,
    )
    return programs


@pytest.mark.parametrize("large", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_every_stage_lowers_for_accelerators(large):
    small = Settings(samples_above=1000, samples=512, exhaustive_up_to=1000)
    settings = small if large else Settings()
    at = jax.ShapeDtypeStruct((3,), jnp.int32)
    programs = exported_stages(shape(2304), (at, at), settings)
    names = {name for name, _ in programs}
    stages = {"shape_samples", "best_candidate", "other_starts", "kept_landmarks"}
    assert names == stages | {"_refined", "_finished"}
    for name, text in programs:
        # No way back to the host, where Python or LAPACK would run.
        assert "callback" not in text, name
        # GPUs multiply in TF32 unless told not to.
        products = re.findall(r"stablehlo\.dot_general.*", text)
        rough = [p for p in products if "precision = [HIGHEST, HIGHEST]" not in p]
        assert not [p for p in rough if "xf32>" in p], name


@pytest.mark.slow
def test_all_stages_in_one_lower_for_accelerators():
    match = partial(pipeline.match_spectra, orientation="any")
    program = export.export(jax.jit(match), platforms=PLATFORMS)(shape(400), shape(300))
    assert program.platforms == PLATFORMS

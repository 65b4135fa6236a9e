"""Every stage lowers for GPUs and TPUs, on a machine that has none."""

import re
from functools import partial

import jax
import jax.numpy as jnp
import pytest
from jax import export

from jfsf import Settings, match_spectra
from jfsf.convert import sinkhorn
from jfsf.initial._start import nonisometric_starts
from jfsf.matching import _policy
from jfsf.matching._arguments import MatchInputs
from jfsf.matching._pairs import PairState
from jfsf.matching._run_stages import search_inputs
from jfsf.types import Spectrum

PLATFORMS = ("cuda", "rocm", "tpu")


def shape(n, k=128):
    faces = jnp.zeros((2 * n, 3), jnp.int32)
    number = partial(jnp.zeros, dtype=jnp.float32)
    return jax.eval_shape(
        lambda: Spectrum(number(k), number((n, k)), number(n), faces, number((n, 3)))
    )


def test_a_function_of_the_package_is_exported_as_it_is():
    emb = jax.ShapeDtypeStruct((30, 4), jnp.float32)
    for options in ({}, {"k0": 8}):  # static ones too
        program = export.export(sinkhorn, platforms=PLATFORMS)(emb, emb, **options)
        assert program.platforms == PLATFORMS


class Exporting:
    """A runner that exports each stage once, and returns shapes.

    programs: (name, program) in the order in which `match` calls them.
    """

    def __init__(self):
        self.programs, self.known = [], {}

    def map(self, name, stage, inputs, at_a_time=1):
        return [self.one(stage, args) for args in inputs]

    def one(self, stage, args):
        asked = stage.func.__name__, str(jax.tree.map(jax.typeof, args))
        if asked not in self.known:
            program = export.export(jax.jit(stage), platforms=PLATFORMS)(*args)
            self.programs.append((stage.func.__name__, program.mlir_module()))
            self.known[asked] = jax.eval_shape(stage, *args)
        return self.known[asked]


def exported_stages(spec, landmarks, settings):
    """Programs of a pair in doubt."""
    runner = Exporting()
    pair = PairState((spec, spec), MatchInputs(landmarks=landmarks))
    _policy.compile_first_attempt(pair, runner, settings=settings)
    stage = partial(nonisometric_starts, settings=settings.search)
    runner.one(stage, search_inputs([pair], [pair.samples])[0])
    return runner.programs


@pytest.mark.slow
@pytest.mark.parametrize("large", [False, True])
def test_every_stage_lowers_for_accelerators(large):
    few = {"samples": 512, "exhaustive_up_to": 1000, "copies_above": 1000}
    settings = Settings(**few) if large else Settings()
    at = jax.ShapeDtypeStruct((3,), jnp.int32)
    programs = exported_stages(shape(2304), (at, at), settings)
    names = {name for name, _ in programs}
    stages = {"shape_samples", "search_starts", "nonisometric_starts"}
    of_large = {"bend"} if large else set()
    assert names == stages | {"kept_landmarks", "refine_start", "finish"} | of_large
    for name, text in programs:
        # No way back to the host, where Python or LAPACK would run.
        assert "callback" not in text, name
        # GPUs multiply in TF32 unless told not to.
        products = re.findall(r"stablehlo\.dot_general.*", text)
        rough = [p for p in products if "precision = [HIGHEST, HIGHEST]" not in p]
        assert not [p for p in rough if "xf32>" in p], name


@pytest.mark.slow
def test_all_stages_in_one_lower_for_accelerators():
    match = partial(match_spectra, orientation="any")
    program = export.export(jax.jit(match), platforms=PLATFORMS)(shape(400), shape(300))
    assert program.platforms == PLATFORMS

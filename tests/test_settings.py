"""Settings: hashable by content, printed as one would write them, checked."""

import copy
import json
import pickle
from dataclasses import fields, is_dataclass
from functools import partial

import cloudpickle
import distributed
import numpy as np
import pytest

import jfsf
from jfsf import (
    FeatureSettings,
    NeighbourSettings,
    PartSettings,
    SearchSettings,
)
from jfsf.array._jit import static, static_key, static_text
from jfsf.convert import authors_sinkhorn, sinkhorn
from jfsf.matching import Settings
from jfsf.refine import ArapSettings


def test_equal_content_is_one_key():
    make = lambda: Settings(converter=partial(sinkhorn, k0=40), ks=(30, 60, 100, 128))
    assert make() == make() and hash(make()) == hash(make())
    assert make() != Settings() and make() != "settings"
    assert Settings(ks=[30, 60]) == Settings(ks=(30, 60))  # type: ignore


@pytest.mark.parametrize(
    "kind", [Settings, SearchSettings, ArapSettings, FeatureSettings, PartSettings]
)
def test_numbers_of_numpy_and_lists_are_plain(kind):
    def numpy(value):
        if isinstance(value, bool) or not isinstance(value, int | float | tuple):
            return value
        return (
            np.asarray(value).tolist()
            if isinstance(value, tuple)
            else np.array(value)[()]
        )

    usual = kind()
    other = kind(**{f.name: numpy(getattr(usual, f.name)) for f in fields(kind)})
    assert other == usual and hash(other) == hash(usual) and repr(other) == repr(usual)


MINE = {
    "settings": Settings(converter=partial(sinkhorn, k0=40), retry_below=0.5),
    "sinkhorn": sinkhorn,
    "converter": authors_sinkhorn,
    "match": jfsf.match_spectra,
    "stage": jfsf.matching.refine_by_zoomout,
}
COPIES = {
    "pickle": lambda value: pickle.loads(pickle.dumps(value)),
    "cloudpickle": lambda value: cloudpickle.loads(cloudpickle.dumps(value)),
    "deepcopy": copy.deepcopy,
}


@pytest.mark.parametrize("name", MINE)
@pytest.mark.parametrize("way", COPIES)
def test_a_copy_is_equal_and_has_the_same_hash(name, way):
    mine = MINE[name]
    copied = COPIES[way](mine)
    assert static_key(copied) == static_key(mine)
    assert hash(static_key(copied)) == hash(static_key(mine))
    assert static(copied) == static(mine)


def of_another_process(value):
    """A key of a value that was sent, made where it arrives; and the value."""
    return static_text(value), value


@pytest.mark.slow
@pytest.mark.parametrize("name", MINE)
def test_a_value_that_was_sent_to_a_worker_comes_back_equal(name):
    with distributed.Client(n_workers=1, dashboard_address=None) as client:
        said, back = client.submit(of_another_process, MINE[name]).result()
    assert said == static_text(MINE[name])
    assert static_key(back) == static_key(MINE[name])


def test_stages_are_compiled_with_what_they_read():
    host = {"retry_below": 0.0, "copies_above": 1, "nonisometric_attempts": 1}
    host |= {"rigid_below": 0.0, "coarse_vertices": 500, "people": False}
    parts = PartSettings(anchors=12)
    mine = Settings(**host, parts=parts, bend_rounds=3)
    assert (
        mine.of_stages()
        == Settings(bend_rounds=3)
        == Settings(bend_rounds=3).of_stages()
    )
    wide = SearchSettings(final_ks=(30, 400))  # of which fewer vertices have too few
    assert Settings(search=wide, coarse_vertices=1600, k=400).of_stages().search == wide


@pytest.mark.parametrize("name", [f.name for f in fields(Settings)])
def test_each_field_counts(name):
    other = {
        "features": FeatureSettings(wks_step=4),
        "search": SearchSettings(samples=200),
        "ks": (30, 60),
        "samples": 512,
        "bend": ArapSettings(reach=0.1),
        "neighbours": NeighbourSettings(tiles=32),
        "parts": jfsf.PartSettings(anchors=12),
        "people": False,
    }
    value = getattr(Settings(), name)
    if name in other:
        changed = other[name]
    elif callable(value):
        changed = authors_sinkhorn
    else:
        changed = value + 1 if isinstance(value, int) else value / 2
    assert Settings(**{name: changed}) != Settings()


def test_repr_is_what_one_would_write():
    mine = Settings(converter=partial(sinkhorn, k0=40), bend_rounds=0)
    text = repr(mine)
    assert "converter=partial(sinkhorn, k0=40)" in text and "bend_rounds=0" in text
    assert "0x" not in text  # no address: the same text in every process
    names = {"partial": partial, **vars(jfsf.convert)}
    names |= {"Weights": jfsf.initial.Weights, "features": jfsf.spectral.features}
    names |= vars(jfsf.matching) | vars(jfsf.refine)
    names |= {name: getattr(jfsf, name) for name in jfsf.__all__}
    assert eval(text, names) == mine


def test_as_record_is_plain():
    record = Settings().as_record()
    assert json.loads(json.dumps(record)) == record
    assert set(record) == {f.name for f in fields(Settings)}


def test_every_number_is_explained():
    def walk(settings):
        kind = type(settings)
        for f in fields(settings):
            assert f"\n    {f.name}: " in kind.__doc__, f"{kind.__name__}.{f.name}"
            value = getattr(settings, f.name)
            if is_dataclass(value):
                walk(value)

    walk(Settings())


@pytest.mark.parametrize(
    "wrong, message",
    [
        ({"ks": ()}, r"ks is \(\)"),
        ({"ks": (40, 30)}, r"ks is \(40, 30\)"),
        ({"k": 100}, "k is 100, but ks ends at 128"),
        ({"bend_rounds": -1}, "bend_rounds is -1"),
        ({"nonisometric_attempts": 0}, "nonisometric_attempts is 0; give 1 or more"),
        ({"coarse_vertices": 0}, "coarse_vertices is 0; give 160 or more"),
        ({"samples": 0}, "samples is 0"),
        ({"samples": 4000}, "samples is 4000; give a power of two"),
        ({"k": "128"}, "k is '128'; give a whole number"),
        ({"k": 128.5}, "k is 128.5; give a whole number"),
        ({"k": True}, "k is True; give a whole number"),
        ({"rigid_below": "0.015"}, "rigid_below is '0.015'; give a number"),
        ({"ks": 30}, "ks is 30; give a tuple"),
        ({"bend": 0.05}, "bend is 0.05; give an? ArapSettings"),
        ({"converter": "sinkhorn"}, "converter is 'sinkhorn'; give a function"),
        ({"refine": "zoomout"}, "refine is 'zoomout'; give .* jfsf.matching"),
    ],
)
def test_bad_values_are_errors(wrong, message):
    with pytest.raises(ValueError, match="Settings: .*" + message):
        Settings(**wrong)


def test_descriptions():
    assert static_text((1,)) == "(1,)" and static_text((1, "a")) == "(1, 'a')"
    assert static_text(partial(max, 3)) == "partial(max, 3)"
    same = [static_key(partial(max, 3, key=abs)) for _ in range(2)]
    assert same[0] == same[1] != static_key(partial(max, 4, key=abs))
    # What cannot be hashed is told apart by identity.
    held = partial(max, [3])
    assert static_key(held) == static_key(held) != static_key(partial(max, [3]))


def test_a_static_argument_is_compared_by_its_content():
    same = [static(partial(sinkhorn, k0=np.int64(5), lam=2.0)) for _ in range(2)]
    assert same[0] is same[1] is not static(partial(sinkhorn, k0=5, lam=3.0))
    assert static([1, [2, np.int32(3)]]) == (1, (2, 3))
    assert type(static(np.float32(0.5))) is float and static("max") == "max"
    assert static(jfsf.types.Maps(1, 2)) == jfsf.types.Maps(1, 2)


@pytest.mark.parametrize("refine", [jfsf.refine.icp, jfsf.refine.zoomout])
def test_partials_of_equal_content_share_a_program(refine):
    spec, C = jfsf.testing.blob_spectrum(1, 8), np.eye(4)
    sizes = {"num_iters": 1} if refine is jfsf.refine.icp else {"ks": [4, 8]}
    known = refine._jitted._cache_size()
    for _ in range(3):
        refine(spec, spec, C, converter=partial(sinkhorn, k0=np.int64(3)), **sizes)
    assert refine._jitted._cache_size() == known + 1

"""Settings: hashable by content, printed as one would write them, checked."""

import json
from dataclasses import fields, is_dataclass
from functools import partial

import pytest

import jfsf
from jfsf import ArapSettings, FeatureSettings, NeighbourSettings, SearchSettings
from jfsf.array._static import static_key, static_text
from jfsf.convert import authors_sinkhorn, sinkhorn
from jfsf.matching import Settings


def test_equal_content_is_one_key():
    make = lambda: Settings(converter=partial(sinkhorn, k0=40), ks=(30, 60, 100, 128))
    assert make() == make() and hash(make()) == hash(make())
    assert make() != Settings() and make() != "settings"
    assert Settings(ks=[30, 60]) == Settings(ks=(30, 60))  # type: ignore


@pytest.mark.parametrize("name", [f.name for f in fields(Settings)])
def test_each_field_counts(name):
    other = {
        "features": FeatureSettings(wks_step=4),
        "search": SearchSettings(samples=200),
        "ks": (30, 60),
        "samples": 512,
        "zoomout": jfsf.ZoomOutSettings(slack=0.1),
        "bend": ArapSettings(reach=0.1),
        "neighbours": NeighbourSettings(tiles=32),
        "bend_converter": sinkhorn,
        "parts": jfsf.PartSettings(anchors=12),
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
    names |= vars(jfsf.matching)
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
        ({"samples": 0}, "samples 0"),
        ({"samples": 4000}, "samples is 4000; give a power of two"),
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

"""Names of before 0.3.0: an import of each says what to use instead."""

import importlib

import pytest

import jfsf
from jfsf._moved import GONE, INSIDE, MODULES, NAMES

OLD = [(module, name) for module, names in NAMES.items() for name in names]


@pytest.mark.parametrize("old", MODULES)
def test_a_module_that_moved_names_its_new_place(old):
    new = f"jfsf.{MODULES[old]}"
    importlib.import_module(new)
    for call in (
        lambda: importlib.import_module(f"jfsf.{old}"),
        lambda: importlib.import_module(f"jfsf.{old}._inside"),
        lambda: getattr(jfsf, old),
    ):
        with pytest.raises(ImportError, match=rf"is now in {new} \(since jfsf 0.3.0"):
            call()


@pytest.mark.parametrize("old", GONE)
def test_a_module_that_is_gone_says_so(old):
    with pytest.raises(ImportError, match="is gone: "):
        importlib.import_module(f"jfsf.{old}")


@pytest.mark.parametrize(("module", "name"), OLD)
def test_a_name_that_is_gone_says_what_to_use(module, name):
    home = importlib.import_module(f"jfsf.{module}".rstrip("."))
    assert name not in home.__all__
    code = f"from {home.__name__} import {name}"
    with pytest.raises(ImportError, match=f"{name} is gone: use "):
        exec(code, {})


@pytest.mark.parametrize("name", INSIDE)
def test_a_name_that_stood_at_the_top_names_its_room(name):
    assert hasattr(importlib.import_module(f"jfsf.{INSIDE[name]}"), name)
    with pytest.raises(ImportError, match=f"is now jfsf.{INSIDE[name]}.{name} "):
        getattr(jfsf, name)


def test_other_names_fail_as_everywhere():
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        jfsf.nonsense  # noqa: B018
    with pytest.raises(ModuleNotFoundError, match="No module named 'jfsf.nonsense'"):
        importlib.import_module("jfsf.nonsense")


def test_what_replaces_a_name_is_there():
    said = {text for names in NAMES.values() for text in names.values()}
    for text in said:
        for dotted in text.split():
            if dotted.startswith("jfsf."):
                home, _, name = dotted.strip(".,:;()").rpartition(".")
                assert hasattr(importlib.import_module(home), name), text

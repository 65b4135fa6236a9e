"""README, gallery and guides name what is there: files, names, options, links."""

import json
import re
import shlex
from functools import cache
from importlib import import_module
from inspect import signature
from urllib.parse import urlparse

import pytest
import typer
from documents import (
    GALLERY,
    GUIDES,
    PAGES,
    README,
    ROOT,
    SCRIPTS,
    SOURCES,
    anchors,
    blocks,
    docstrings,
    links,
    name,
    spans,
)

import jfsf
from jfsf.apps.cli._app import app
from jfsf.array._jit import Jitted

VERBS = (
    "match|register|transfer|batch|collection|morphometrics|evaluate|info|demo|shapes|"
    "cache"
)
COMMAND = re.compile(rf"jfsf (?:{VERBS})\b.*")
EXAMPLE = re.compile(r"^Example: (jfsf .+)$", re.MULTILINE)
NAME = re.compile(r"jfsf(?:\.\w+)+")
# Data, pairs, its part, mean, median, and the file of a row of results.
ROW = re.compile(
    r"^\| .*?(\d+) pairs.*?\| (\w+) \| ([\d.]+) \| ([\d.]+) \| "
    r".*`(match_\w+\.json)` \|$",
    re.MULTILINE,
)
FIELD = re.compile(r"\w*Settings\.\w+|Certificate\.\w+|certificate\.\w+")
each_page = pytest.mark.parametrize("page", PAGES, ids=name)


@cache
def commands():
    return typer.main.get_command(app).commands


def parse(line):
    """Parse a command line as the program does, without running it."""
    program, verb, *rest = shlex.split(line, comments=True)
    assert program == "jfsf"
    commands()[verb].make_context(verb, rest)


@each_page
def test_commands_parse(page):
    shell = "".join(blocks(page.read_text(), "bash")).splitlines()
    for line in shell:
        command = line.removeprefix(".venv/bin/")
        if command.startswith("jfsf "):
            parse(command)


@each_page
def test_commands_that_are_mentioned_exist(page):
    for span in spans(page.read_text()):
        if COMMAND.fullmatch(span):
            _, verb, *rest = shlex.split(span)
            known = {o for p in commands()[verb].params for o in p.opts}
            assert {word for word in rest if word.startswith("-")} <= known, span


def test_examples_of_the_help_parse():
    found = [EXAMPLE.findall(d) for path in SOURCES for d in docstrings(path)]
    lines = sum(found, [])
    assert len(lines) == len(commands())
    for line in lines:
        parse(line)


@pytest.mark.parametrize(
    "line",
    ["jfsf match X Y --out a.npz --nonsense", "jfsf match X Y", "jfsf info", "jfsf no"],
)
def test_a_wrong_command_is_found(line):
    # Of typer's own click, whose classes have no public name.
    with pytest.raises(Exception, match=r"No such option|Missing|no"):
        parse(line)


@pytest.mark.parametrize("page", [README, *GUIDES], ids=name)
def test_options_that_are_mentioned_exist(page):
    known = {o for c in commands().values() for p in c.params for o in p.opts}
    known.add("--help")
    scripts = "".join(path.read_text() for path in SCRIPTS)
    for span in spans(page.read_text()):
        if span.startswith("--"):
            option = span.split()[0]
            assert option in known or f'"{option}"' in scripts, f"{page}: {option}"


def resolved(dotted):
    """The module or what is in it."""
    here, *path = dotted.split(".")
    found = import_module(here)
    for part in path:
        if not hasattr(found, part):
            import_module(f"{found.__name__}.{part}")
        found = getattr(found, part)
    return found


@each_page
def test_names_that_are_mentioned_exist(page):
    for span in spans(page.read_text()):
        for dotted in NAME.findall(span):
            assert resolved(dotted) is not None, f"{page}: {dotted}"
        for dotted in FIELD.findall(span):
            owner, field = dotted.split(".")
            fields = getattr(jfsf, owner[0].upper() + owner[1:])
            assert field in fields.__annotations__, f"{page}: {dotted}"


def test_names_in_the_code_are_public():
    """`jfsf.room.name` in a docstring or a comment can be imported as it stands."""
    for path in SOURCES:
        for dotted in re.findall(r"`(jfsf(?:\.\w+)+)`", path.read_text()):
            assert resolved(dotted) is not None, f"{path}: {dotted}"


@each_page
def test_scripts_and_results_that_are_mentioned_exist(page):
    homes = ROOT, ROOT / "experiments", *(path.parent for path in SCRIPTS)
    homes = *homes, ROOT / "experiments" / "results"
    kinds = r"[\w/]+\.(?:py|png)" if page in GUIDES else r"[\w/]+\.(?:py|json|md|png)"
    for span in spans(page.read_text()):
        if re.fullmatch(kinds, span) and span != "map.png":
            assert any((home / span).is_file() for home in homes), f"{page}: {span}"


@each_page
def test_links_lead_somewhere(page):
    for link in links(page.read_text()):
        url = urlparse(link)
        if url.scheme:
            assert url.scheme == "https" and "." in url.netloc, f"{page}: {link}"
            continue
        target = page if not url.path else page.parent / url.path
        assert target.is_file(), f"{page}: {link}"
        if page in GUIDES:  # they are all that the wheel holds
            assert target in GUIDES, f"{page}: {link}"
        if url.fragment:
            assert url.fragment in anchors(target.read_text()), f"{page}: {link}"


def test_every_guide_is_linked_from_the_readme():
    assert {f"jfsf/apps/guide/{g.name}" for g in GUIDES} <= set(
        links(README.read_text())
    )


def test_every_part_is_in_the_tables_of_the_guide():
    (page,) = (guide for guide in GUIDES if guide.stem == "stages")
    rows = [line for line in page.read_text().splitlines() if line.startswith("| `")]
    rooms = spans("".join(row.split("|")[1] for row in rows))
    assert sorted(rooms) == sorted([*jfsf._ROOMS, *jfsf.apps._ROOMS])


def test_the_table_of_static_arguments_is_that_of_the_functions():
    (page,) = (guide for guide in GUIDES if guide.stem == "jax")
    rows = [r for r in page.read_text().splitlines() if r.startswith("| `jfsf.")]
    said = {}
    for row in rows:
        function, static, traced = (spans(cell) for cell in row.split("|")[1:4])
        said[function[0]] = static, traced
    rooms = "neighbours spectral convert refine initial evaluate".split()
    there = {}
    for room in rooms:
        module = import_module(f"jfsf.{room}")
        for public in module.__all__:
            function = getattr(module, public)
            if isinstance(function, Jitted):
                static = function._static
                both: tuple = [], []
                for argument in signature(function).parameters:
                    both[argument not in static].append(argument)
                there[f"jfsf.{room}.{public}"] = both
    assert said == there


def test_every_script_is_in_the_gallery():
    named = set(spans(GALLERY.read_text()))
    there = {path.name for path in SCRIPTS if not path.name.startswith("_")}
    assert not there - {span.split()[0] for span in named}


def test_the_readme_is_short_and_has_the_two_commands():
    text = README.read_text()
    assert len(text.splitlines()) <= 150
    for marker, end in (("main", "jfsf demo"), ("test", "pytest")):
        after = text.split(f"<!-- ci: {marker} -->\n")[1]
        command = re.match(r"```bash\n(.*)\n```", after)
        assert command and command[1].endswith(end)


def test_the_results_of_the_readme_are_those_of_their_files():
    rows = ROW.findall(README.read_text())
    assert len(rows) >= 8
    for pairs, role, mean, median, file in rows:
        path = ROOT / "experiments/results" / file
        found = json.loads(path.read_text())["summary"]["all"]
        assert (found["pairs"], found["role"]) == (int(pairs), role), file
        for shown, value in ((mean, found["mean"]), (median, found["median"])):
            digits = len(shown.partition(".")[2])
            assert shown == f"{value:.{digits}f}", (file, shown, value)

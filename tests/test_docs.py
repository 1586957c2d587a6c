"""The words agree with the program: commands and options exist, links lead somewhere, public names say what they do."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from fullsphere.cli.main import COMMANDS, main

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")])
MODULES = sorted(path for folder in ("model", "mosaic", "cli") for path in (ROOT / folder).rglob("*.py"))

FENCED = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
INLINE = re.compile(r"`([^`\n]+)`")
COMMAND = re.compile(r"(?:^|[\s/\\])fullsphere\s+([^\n|&;#>]*)")


def commands_in(page: Path) -> Iterator[tuple[str, list[str]]]:
    """(subcommand, options) of every `fullsphere ...` in a page's shell blocks and code spans."""
    text = page.read_text()
    blocks = [body for language, body in FENCED.findall(text) if language in ("sh", "console", "bash")]
    spans = [span for span in INLINE.findall(FENCED.sub("", text)) if span.startswith("fullsphere ")]
    for code in (*blocks, *spans):
        for words in COMMAND.findall(re.sub(r"\\\n", " ", code)):
            first, *others = words.split() or [""]
            yield first, [word.split("=")[0] for word in others if re.match(r"--?[a-z]", word)]


def named(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


Helps = dict[str, set[str]]


@pytest.fixture
def helps(capsys: pytest.CaptureFixture[str]) -> Helps:
    """The options that each command's --help shows."""
    found = {}
    for command in COMMANDS:
        assert main([command, "--help"]) == 0
        found[command] = set(re.findall(r"(?<![\w-])--?[a-z][a-z-]*", capsys.readouterr().out))
    return found


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_commands_and_options_exist(page: Path, helps: Helps) -> None:
    for command, options in commands_in(page):
        if command.startswith("-"):
            assert command in ("--help", "--version")
            continue
        if command in ("COMMAND", ""):
            continue
        assert command in COMMANDS, f"{command} in {page.name}"
        unknown = set(options) - helps[command]
        assert not unknown, f"{page.name}: fullsphere {command} has no {unknown}"


def test_readme_shows_every_command_and_option_and_no_other(helps: Helps) -> None:
    readme = (ROOT / "README.md").read_text()
    for command in COMMANDS:
        assert f"fullsphere {command}" in readme
        for option in helps[command] - {"-h", "--help"}:
            assert option in readme, f"{command} {option}"
    own = re.sub(r"(pip install|pytest)[^`\n]*", "", readme)
    shown = set(re.findall(r"(?<=[` |])--[a-z][a-z-]+", own)) - {"--version"}
    assert shown <= set().union(*helps.values())


def anchors_of(page: Path) -> set[str]:
    headings = re.findall(r"^#+ (.+)$", FENCED.sub("", page.read_text()), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", FENCED.sub("", page.read_text())):
        if target.startswith(("http://", "https://")):
            continue
        place, _, anchor = target.partition("#")
        found = (page.parent / place).resolve() if place else page
        assert found.exists(), f"{page.name}: {target}"
        assert found.is_relative_to(ROOT), f"{page.name}: {target}"
        assert not anchor or anchor in anchors_of(found), f"{page.name}: {target}"


@pytest.mark.parametrize("module", MODULES, ids=named)
def test_public_names_say_what_they_do(module: Path) -> None:
    tree = ast.parse(module.read_text())
    assert not tree.body or ast.get_docstring(tree)
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            assert ast.get_docstring(node), f"{named(module)}: {node.name}"

"""README and docs: short, with links that lead somewhere, commands that exist, blocks that CI runs."""

import re
import shlex
from pathlib import Path

import pytest

from nsbench.cli.arguments import build_parser

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"```(?:sh|bash|console|shell)\n(.*?)```", re.S)
COMMAND = re.compile(r"(?:^ {4}|`)(nsbench [^`\n]*)", re.M)


def test_readme_is_at_most_120_lines():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 120


def test_readme_begins_with_the_command_of_the_suite_and_that_of_the_tests():
    """CI installs and tests as the second block says, in an environment of its own."""
    suite, tests = BLOCK.findall((ROOT / "README.md").read_text(encoding="utf-8"))[:2]
    assert suite.strip().endswith("nsbench run") and tests.strip().endswith("pytest")
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    for part in tests.strip().split(" && "):
        assert part.replace(".venv", ".venv-ci") in script


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_lead_to_files(page):
    links = re.findall(r"\]\(([^)#]+)", page.read_text(encoding="utf-8"))
    local = [link for link in links if "://" not in link]
    assert not [link for link in local if not (page.parent / link).exists()]


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_commands_that_are_shown_can_be_parsed(page):
    verbs = {"NAME", "PATH"}
    for line in COMMAND.findall(page.read_text(encoding="utf-8")):
        for command in line.split("&&"):
            words = shlex.split(command.split("#")[0].strip().rstrip(".,;:"))[1:]
            if len(words) < 2 or words[0] in verbs or words[0].startswith("-"):
                continue
            build_parser().parse_args(words)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_scripts_that_are_named_exist(page):
    text = page.read_text(encoding="utf-8")
    named = set(re.findall(r"tests/[\w/]+\.py", text))
    assert not [name for name in named if not (ROOT / name).exists()]

"""README and docs: short, with links that lead somewhere, commands that exist, blocks that CI runs."""

import re
import shlex
from pathlib import Path

import pytest

from nsbench.cli.arguments import build_parser

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"```(?:sh|bash|console|shell)\n(.*?)```", re.S)
COMMAND = re.compile(r"(?:^|^\$ |`)(nsbench [^`\n]*)", re.M)


LINK = re.compile(r"\]\(([^)\s#]*)(?:#([^)\s]*))?\)")
CODE = re.compile(r"^(```+).*?^\1|`[^`\n]*`", re.M | re.S)


def name(page):
    return page.relative_to(ROOT).as_posix()


def links(page):
    """Pairs (file, anchor) of the relative links of a page."""
    text = CODE.sub("", page.read_text(encoding="utf-8"))
    return [(f, a) for f, a in LINK.findall(text) if "://" not in f and (f or a)]


def anchors(page):
    """Names that the headings of a page get, and those that it gives itself."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    headings = re.findall(r"^#+ (.*)$", text, re.M)
    slugs = {re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in headings}
    return slugs | set(re.findall(r"^\(([\w-]+)\)=$", text, re.M))


def test_readme_is_at_most_120_lines():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 120


def test_readme_begins_with_the_command_of_the_suite_and_that_of_the_tests():
    """CI installs and tests as the second block says, in an environment of its own."""
    suite, tests = BLOCK.findall((ROOT / "README.md").read_text(encoding="utf-8"))[:2]
    assert suite.strip().endswith("nsbench run") and tests.strip().endswith("pytest")
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    for part in tests.strip().split(" && "):
        assert part.replace(".venv", ".venv-ci") in script


def broken_links(page):
    """Relative links of a page that lead to no file or no heading."""
    found = []
    for file, anchor in links(page):
        target = page.parent / file if file else page
        if not target.exists():
            found.append(file)
        elif anchor and target.suffix == ".md" and anchor not in anchors(target):
            found.append(f"{file}#{anchor}")
    return found


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_links_lead_to_files_and_headings(page):
    assert not broken_links(page)


def test_broken_links_are_found(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "# What is *it*?\n\n[a](#what-is-it) [b](page.md#what-is-it) [c](#nothing) [d](no.md)\n"
        "[e](page.md#no) `[f](none.md)` [g](https://example.org/x.md)\n"
    )
    assert broken_links(page) == ["#nothing", "no.md", "page.md#no"]


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_commands_that_are_shown_can_be_parsed(page):
    known = build_parser()._subparsers._group_actions[0].choices
    verbs = {"NAME", "PATH", "COMMAND"}
    for line in COMMAND.findall(page.read_text(encoding="utf-8")):
        for command in line.split("&&"):
            words = shlex.split(command.split("#")[0].strip().rstrip(".,;:"))[1:]
            if not words or words[0] in verbs or words[0].startswith("-"):
                continue
            assert words[0] in known, line
            if len(words) < 2:  # a verb that is mentioned
                continue
            build_parser().parse_args(words)


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_scripts_that_are_named_exist(page):
    text = page.read_text(encoding="utf-8")
    named = set(re.findall(r"tests/[\w/]+\.py", text))
    assert not [name for name in named if not (ROOT / name).exists()]

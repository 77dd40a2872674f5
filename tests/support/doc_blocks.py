"""Blocks of the documentation are run: Python in one namespace per page, commands in one folder.

    ```python   runs; where its first line is `# file: NAME`, it is written to that file too
                where it begins with `>>>`, what it prints is compared
    ```toml, ```yaml, ```text   with such a first line: written
    ```sh       each line is a command; `nsbench ...` runs in this process, and must exit with 0
                or with the N of a comment `# exit code N`
    ```console  the same after `$ `; the lines between are the output: "..." stands for anything,
                and seconds are not compared
    ```{code-cell}   Python of a notebook page

A block that cannot be run (it installs, or takes minutes) has `<!-- skip: next "why" -->` above.
"""

import doctest
import re
import shlex
from pathlib import Path

from sybil import Sybil
from sybil.evaluators.python import PythonEvaluator
from sybil.parsers.markdown import SkipParser
from sybil.parsers.markdown.lexers import RawFencedCodeBlockLexer
from sybil.region import Region

from nsbench.cli import main

FILE = re.compile(r"# file: (\S+)\n")
EXIT = re.compile(r"# exit code (\d+)")
INFO = re.compile(r"(?P<language>\{code-cell\}[^\n]*|\w+)[^\n]*\n", re.M)
OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
LANGUAGES = {"python", "toml", "yaml", "text", "sh", "console"}
HIDDEN = re.compile(r"(?:^---\n.*?^---\n)|(?:^:\w[^\n]*\n)", re.M | re.S)  # options of a cell


class BlockParser:
    """Find the fenced blocks of a page and say how each is evaluated."""

    def __init__(self, capture):
        self.run_python = PythonEvaluator()
        self.capture = capture
        self.lexer = RawFencedCodeBlockLexer(INFO)

    def __call__(self, document):
        for region in self.lexer(document):
            language = region.lexemes["language"].split()[0]
            if language == "{code-cell}" or language in LANGUAGES:
                kind = "python" if language == "{code-cell}" else language
                source = region.lexemes["source"]
                evaluate = getattr(self, f"evaluate_{kind}", self.evaluate_text)
                yield Region(region.start, region.end, source, evaluate)

    def evaluate_python(self, example):
        self.evaluate_text(example)
        blank = lambda m: "\n" * m[0].count("\n")
        example.parsed.text = HIDDEN.sub(blank, example.parsed.text)
        if example.parsed.startswith(">>>"):
            run_examples(example)
        else:
            self.run_python(example)

    def evaluate_text(self, example):
        name = FILE.match(example.parsed)
        if name:
            path = Path(name[1])
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(str(example.parsed)[name.end() :], encoding="utf-8")

    def evaluate_sh(self, example):
        for line in joined_lines(example.parsed):
            self.run_line(line)

    def evaluate_console(self, example):
        checker = doctest.OutputChecker()
        for line, expected in dialogue(example.parsed):
            got = self.run_line(line)
            want = mask_seconds(expected)
            if want.strip() and not checker.check_output(want, mask_seconds(got), OPTIONS):
                raise AssertionError(f"$ {line}\nexpected:\n{expected}\ngot:\n{got}")

    def run_line(self, line):
        """Run the commands of a line; return what they print."""
        wanted = EXIT.search(line)
        printed = []
        for command in commands_of(line):
            if command[0] != "nsbench":
                raise AssertionError(f"{command[0]} is no command that a page may run: skip it")
            code, text = self.capture(lambda words=command[1:]: run(words))
            printed.append(text)
            if code != int(wanted[1] if wanted else 0):
                raise AssertionError(f"{line}\nexit code {code}\n{text}")
        return "".join(printed)


def run_examples(example):
    """Run `>>>` lines in the namespace of the page and compare what they print."""
    text = str(example.parsed)
    test = doctest.DocTestParser().get_doctest(text, {}, example.path, example.path, example.line)
    test.globs = example.namespace
    found = []
    runner = doctest.DocTestRunner(optionflags=OPTIONS)
    if runner.run(test, out=found.append, clear_globs=False).failed:
        raise AssertionError("".join(found))


def mask_seconds(text):
    """The text without what follows from a clock: the column "seconds" of a table, the cheapest."""
    lines = []
    end = 0  # of the column in the lines below its head
    for line in text.splitlines():
        found = re.search(r" seconds ", line)
        if found:
            end = found.end() - 1
        elif end and len(line) > end and line[end] == " ":
            line = f"{line[: end - 9]} # {line[end:]}"
        lines.append(re.sub(r"^Take \S.*", "Take #", line))
    # what is rounding differs from processor to processor
    return re.sub(r"\b\d(?:\.\d+)?e-1[4-9]\b", "ROUNDING", "\n".join(lines) + "\n")


def run(words):
    try:
        return main(words)
    except SystemExit as e:
        return e.code or 0


def joined_lines(text):
    """Command lines of a block: comments and empty lines left out, continued lines joined."""
    lines = str(text).replace("\\\n", " ").splitlines()
    return [line for line in lines if line.strip() and not line.lstrip().startswith("#")]


def dialogue(text):
    """Pairs (command line, expected output) of a console block."""
    parts = re.split(r"^\$ ", str(text).replace("\\\n", " "), flags=re.M)[1:]
    for part in parts:
        line, _, expected = part.partition("\n")
        yield line, expected


def commands_of(line):
    """Words of each command of a line, between `&&`."""
    words = shlex.split(line, comments=True)
    command = []
    for word in words:
        if word == "&&":
            yield command
            command = []
        else:
            command.append(word)
    if command:
        yield command


def commands_shown(page):
    """Every command line of the sh and console blocks of a page, whether it is run or not."""
    for info, body in re.findall(r"^```(sh|console)[^\n]*\n(.*?)^```", page.read_text(), re.M | re.S):
        lines = joined_lines(body) if info == "sh" else [line for line, _ in dialogue(body)]
        yield from (words for line in lines for words in commands_of(line))


def sybil_of(capture):
    """The parsers of the pages; capture(call) returns its value and what it printed."""
    return Sybil([BlockParser(capture), SkipParser()])

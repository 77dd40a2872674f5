"""Argument parser of the command line: one function per verb.

A verb is added by `_add_verb`, which records the module of nsbench.cli that executes it. Nothing
but argparse is imported here, so that --help is quick; shtab is imported by --print-completion
alone.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from types import MappingProxyType

import nsbench

LIMIT = "limit of one run (default: 120 s); its preparation has 5 minutes more"
FILE_OPTIONS = MappingProxyType({"--cases": "case", "--solvers": "solver"})
ACCURACIES = {"h": "steps", "tol": "tolerances", "k": "stiffnesses"}
SHELLS = ("bash", "zsh")


def build_parser() -> argparse.ArgumentParser:
    """Build the parser of all verbs; its results carry `verb_module`, a module of nsbench.cli."""
    parser = argparse.ArgumentParser(
        "nsbench",
        description="Test bench for Filippov and complementarity systems: "
        "which method, which step, what error, at what cost.",
    )
    parser.add_argument(
        "--print-completion",
        action=_PrintCompletion,
        choices=SHELLS,
        help="print a script that completes commands and options in this shell, and stop",
    )
    parser.add_argument("--version", action="version", version=f"nsbench {nsbench.__version__}")
    verbs = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=_VerbParser)
    for add in (
        _add_list,
        _add_run,
        _add_report,
        _add_show,
        _add_step,
        _add_new,
        _add_check,
        _add_reference,
        _add_gate,
        _add_calibrate,
        _add_compare,
        _add_doctor,
        _add_study,
    ):
        add(verbs)
    return parser


class _VerbParser(argparse.ArgumentParser):
    """Parser of one verb, whose options may stand between its arguments: verify --certify CASE."""

    _is_within = False

    def parse_known_args(self, args=None, namespace=None):
        """Parse options first and arguments from what they leave."""
        if self._is_within:
            return super().parse_known_args(args, namespace)
        self._is_within = True
        try:
            return self.parse_known_intermixed_args(args, namespace)
        finally:
            self._is_within = False


class _PrintCompletion(argparse.Action):
    """Print the completion script of a shell and exit."""

    def __call__(self, parser, namespace, values, option_string=None):
        import shtab

        kinds = {"FILE": shtab.FILE, "PATH": shtab.FILE, "DIR": shtab.DIRECTORY}
        for verb in parser._subparsers._group_actions[0].choices.values():
            for argument in verb._actions:
                if argument.metavar in kinds:
                    argument.complete = kinds[argument.metavar]
        print(shtab.complete(parser, shell=values))
        parser.exit(0)


def _add_verb(verbs, name: str, text: str, module: str = "") -> argparse.ArgumentParser:
    verb = verbs.add_parser(name, help=text, description=text)
    verb.set_defaults(verb_module=module or name)
    return verb


def _add_list(verbs) -> None:
    verb = _add_verb(verbs, "list", "what exists: cases, solvers, metrics", module="list_")
    verb.add_argument(
        "what",
        nargs="?",
        type=lambda word: f"{word.removesuffix('s')}s",  # "solver" is understood too
        choices=("cases", "solvers", "metrics"),
    )
    _add_files(verb, {"--solvers": "solver"})


def _add_run(verbs) -> None:
    verb = _add_verb(verbs, "run", "run cases with solvers and write the report")
    _add_selection(verb)
    _add_workers(verb)
    _add_places(verb)
    verb.add_argument(
        "--plan",
        action="store_true",
        help="say what would run and why, with a forecast of time and memory, and stop",
    )
    verb.add_argument(
        "--probe",
        type=float,
        default=10.0,
        metavar="S",
        help="for --plan: limit of all small runs that tell what is not known yet (default: 10 s; "
        "0: none)",
    )
    verb.add_argument(
        "-v", "--verbose", action="store_true", help="for --plan: a line for each run"
    )
    verb.add_argument(
        "--references",
        metavar="DIR",
        help="folder of the references of case files (default: references in the folder of "
        "results); missing ones are built",
    )
    verb.add_argument(
        "--reach",
        type=float,
        metavar="E",
        help="carry the ladders on to smaller steps until this state error is reached",
    )
    verb.add_argument(
        "--budget",
        type=float,
        default=60.0,
        metavar="S",
        help="for --reach: seconds that the added runs of one method on one case may take "
        "(default: 60)",
    )
    verb.add_argument("--force", action="store_true", help="run again what is already known")
    verb.add_argument(
        "-q", "--quiet", action="store_true", help="print the path of the report only"
    )
    verb.add_argument(
        "--json", action="store_true", help="print the table at the end as JSON, nothing else"
    )
    verb.add_argument("-o", "--out", metavar="DIR", help="folder of results (default: results)")


def _add_selection(verb: argparse.ArgumentParser) -> None:
    """Add the arguments that select cases, solvers and accuracies."""
    verb.add_argument(
        "cases",
        nargs="*",
        metavar="CASE",
        help="such as tide, discs[n=30], my_case.py, my_case.py[mu=0.1] or a folder; none: the "
        "suite",
    )
    verb.add_argument(
        "-s", "--solver", action="append", metavar="SOLVER", help="such as pbd[order=reverse]"
    )
    for name, text in ACCURACIES.items():
        verb.add_argument(
            f"--{name}", metavar="A..B", help=f"{text}: one, a list A,B,C or a range A..B"
        )
    verb.add_argument(
        "--suite", choices=("smoke", "standard", "hard", "full"), help="default: standard"
    )
    verb.add_argument("--tag", help="only cases with this tag")
    _add_files(verb)


def _add_files(
    verb: argparse.ArgumentParser, options: Mapping[str, str] = FILE_OPTIONS
) -> None:
    """Add the files outside the package: options, with the kind of what the files hold."""
    for option, kind in options.items():
        verb.add_argument(
            option,
            dest=f"{kind}_files",
            action="append",
            default=[],
            metavar="PATH",
            help=f"{kind} file, or folder of {kind} files, outside the package",
        )


def _add_workers(verb: argparse.ArgumentParser) -> None:
    """Add the number of workers and the limit of a run."""
    _add_jobs(verb)
    verb.add_argument("--timeout", type=float, default=120.0, metavar="S", help=LIMIT)


def _add_jobs(verb: argparse.ArgumentParser, more: str = "") -> None:
    """Add the number of workers; more: the end of the sentence on its default."""
    text = f"workers (default: the number of cores, at most 2{more})"
    verb.add_argument("-j", "--jobs", type=int, metavar="N", help=text)


def _add_places(verb: argparse.ArgumentParser) -> None:
    """Add the cluster, and the memory of a worker."""
    verb.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="the workers of this Dask cluster instead, such as tcp://10.0.0.1:8786",
    )
    verb.add_argument(
        "--memory",
        metavar="SIZE",
        help="limit of one worker, such as 4G (default: its share of the machine)",
    )


def _add_report(verbs) -> None:
    verb = _add_verb(verbs, "report", "write the report of results again")
    verb.add_argument("dirs", nargs="+", metavar="DIR")


def _add_show(verbs) -> None:
    verb = _add_verb(verbs, "show", "one case, or one run of it")
    verb.add_argument("case", metavar="CASE", help="such as discs[n=30], or a case file")
    verb.add_argument("-s", "--solver", metavar="SOLVER", help="run it with this method")
    _add_files(verb, {"--solvers": "solver"})
    for name in ACCURACIES:
        verb.add_argument(f"--{name}", type=float)
    verb.add_argument(
        "--html",
        metavar="FILE",
        help="write the run as a moving scene: a page in one file that works offline",
    )
    verb.add_argument("--gif", metavar="FILE", help="write the run as a film, an animated GIF")


def _add_step(verbs) -> None:
    verb = _add_verb(verbs, "step", "which step, or tolerance, keeps an error, and what it costs")
    verb.add_argument("case", metavar="CASE", help="such as discs[n=30], or a case file")
    verb.add_argument(
        "--error",
        metavar="E",
        help="largest error of the state in the 2-norm, such as 1e-2, or 1%% of its size",
    )
    verb.add_argument(
        "--overlap",
        metavar="E",
        help="largest violation of a constraint, such as 1e-3, or 1%% of the smallest diameter",
    )
    verb.add_argument(
        "-s",
        "--solver",
        action="append",
        metavar="SOLVER",
        help="methods to ask, such as pbd (default: all of the standard suite)",
    )
    _add_files(verb, {"--solvers": "solver"})
    verb.add_argument(
        "--budget",
        type=float,
        default=60.0,
        metavar="S",
        help="seconds that the runs of one method may take (default: 60)",
    )
    verb.add_argument("--json", action="store_true", help="print the answers as JSON")


def _add_new(verbs) -> None:
    verb = _add_verb(verbs, "new", "write a commented case or method file to start from")
    verb.add_argument("what", choices=("case", "method"))
    verb.add_argument("name", metavar="NAME", help="of the case or method; the file is NAME.py")
    verb.add_argument(
        "--kind",
        default="contact",
        metavar="KIND",
        help="case: contact (default), discs, switch, hybrid, circuit; method: contact (default), "
        "switch",
    )


def _add_check(verbs) -> None:
    verb = _add_verb(verbs, "check", "does a case or a solver do what it says?")
    verb.add_argument(
        "files",
        nargs="+",
        metavar="FILE",
        help="files, such as cells.py or cells.py[n=6], or names of cases and solvers",
    )


def _add_reference(verbs) -> None:
    verb = _add_verb(verbs, "reference", "build or verify stored references")
    verb.add_argument("action", choices=("build", "verify", "list"))
    verb.add_argument("cases", nargs="*", metavar="CASE")
    verb.add_argument(
        "--into",
        metavar="DIR",
        help="folder to use (default: that of the package; of case files results/references)",
    )
    verb.add_argument(
        "--kind",
        choices=("auto", "certified", "runs"),
        default="auto",
        help="build: a proof, two runs that agree, or the first with the second as a fallback",
    )
    verb.add_argument(
        "--certify", action="store_true", help="verify: make every proof again (minutes)"
    )


def _add_gate(verbs) -> None:
    text = "compare results with a baseline: 0 as before, 1 not, 4 too little compared"
    verb = _add_verb(verbs, "gate", text)
    verb.add_argument("dir", nargs="?", metavar="DIR", help="folder of results (default: results)")
    verb.add_argument("--baseline", metavar="FILE", help="default: that of nsbench.toml")
    verb.add_argument(
        "--cases",
        dest="case_files",
        action="append",
        default=[],
        metavar="PATH",
        help="file, or folder, of cases that must be that of the runs (default: nsbench.toml)",
    )
    verb.add_argument(
        "--solvers",
        dest="solver_files",
        action="append",
        default=[],
        metavar="PATH",
        help="file, or folder, of methods that must be that of the runs (default: nsbench.toml)",
    )
    verb.add_argument(
        "--update",
        action="store_true",
        help="write what changed into the baseline (needs --reason)",
    )
    verb.add_argument("--reason", metavar="TEXT", default="", help="why the lines change")
    verb.add_argument("--summary", metavar="FILE", help="append a summary in Markdown to this file")


def _add_calibrate(verbs) -> None:
    text = "how far the numbers of a study spread from starts 1e-12 apart"
    verb = _add_verb(verbs, "calibrate", text)
    verb.add_argument("dir", nargs="?", metavar="DIR", help="folder of results (default: results)")
    _add_files(verb)
    verb.add_argument(
        "--references", metavar="DIR", help="of case files (default: those of the results)"
    )
    _add_workers(verb)


def _add_compare(verbs) -> None:
    verb = _add_verb(verbs, "compare", "what differs between folders of results")
    verb.add_argument("old", metavar="A")
    verb.add_argument("new", metavar="B")
    verb.add_argument("more", metavar="C", nargs="*", help="more versions, for a history")
    verb.add_argument("--html", metavar="FILE", help="write a page: changes, scatters, history")
    verb.add_argument("--summary", metavar="FILE", help="append a summary in Markdown to this file")
    verb.add_argument(
        "--rtol",
        type=float,
        metavar="R",
        help="relative difference that is none (default: 1e-6)",
    )


def _add_doctor(verbs) -> None:
    _add_verb(verbs, "doctor", "is this installation fit to measure with?")


def _add_study(verbs) -> None:
    text = "conduct a study of a question: evidence, answer, and what would refute it"
    verb = _add_verb(verbs, "study", text)
    verb.add_argument("name", metavar="NAME", help="such as lemma; list: the studies there are")
    verb.add_argument(
        "--full",
        action="store_true",
        help="the full form, which takes hours and goes on where it was interrupted (default: "
        "the small form, a minute)",
    )
    _add_jobs(verb, "; of the small form: 1, this process")
    _add_places(verb)
    verb.add_argument("-o", "--out", default="results", metavar="DIR")

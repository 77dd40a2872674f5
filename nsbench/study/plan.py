"""Plan a study: every run to attempt, as a `Spec` of case, solver and accuracy.

The accuracies of the standard suite are ladders of steps, tolerances or stiffnesses. Ratios of
steps are not dyadic: a ladder of powers of two would show effects of binary rounding as if they
were errors of the method.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from nsbench import solvers, user_code
from nsbench.case import SUITES, Case, case_module, case_names, get_case, load_case, parse_spec
from nsbench.problem import LCS, Complementarity
from nsbench.solvers.base import Solver, accuracy_unit

SMOKE = ("tide", "sliding", "three_discs")  # cases of the smoke suite, if they name none themselves
POINTS = 19  # of a ladder of OCTAVES
OCTAVES = 6  # between the coarsest and the finest step


@dataclass(frozen=True)
class Spec:
    """One run to attempt: a case by key (or by file), a solver by spec, its accuracy (NaN:
    refused).

    accuracy: name of the solver's accuracy parameter ("h", "tol", "k", "eps"); asked: its value.
    start_seed: other than 0 the run starts START_PERTURBATION away from the case's start, in a
    direction drawn with this seed, and is not timed.
    parts: digests of the parts of the run's key (nsbench.results.run_key) on the machine that
    requests it, for a process that computes it elsewhere.
    """

    case: str
    solver: str
    accuracy: str
    asked: float
    file: str = ""  # case file outside the package
    solver_files: tuple[str, ...] = ()
    start_seed: int = 0
    references: str = dataclasses.field(default="", compare=False)  # folder, of a case file
    parts: tuple[str, ...] = dataclasses.field(default=(), compare=False, repr=False)

    @property
    def label(self) -> str:
        """Format case, solver and accuracy; a refused run has no accuracy."""
        accuracy = f" {self.accuracy}={self.asked:.3g}" if np.isfinite(self.asked) else ""
        return f"{self.case} {self.solver}{accuracy}"


def suite_cases(
    suite: str, tag: str | None = None, left_out: dict[str, str] | None = None
) -> list[str]:
    """Return the keys of the cases of a suite.

    "full" holds everything, "smoke" the smallest. tag: only cases with this tag. left_out: receives
    by name why a case cannot be built (None: the first such case raises LookupError or ValueError).
    Raises LookupError for an unknown suite.
    """
    if suite not in SUITES:
        raise LookupError(f"no suite {suite!r}; there are: {', '.join(SUITES)}")
    out = []
    for name in case_names():
        module = case_module(name)
        suites = getattr(module, "SUITES", {"standard": [{}]})
        sets = suites.get(suite, [])
        if suite == "full":
            sets = suites.get("standard", []) + suites.get("hard", []) + sets
        if suite == "smoke":
            sets = suites.get(
                "smoke",
                suites.get("standard", [])[:1] if name in SMOKE else [],
            )
        for params in sets:
            try:
                case = get_case(name, **params)
            except (LookupError, ValueError) as e:
                if left_out is None:
                    raise
                left_out[name] = str(e)
                continue
            if tag is None or tag in case.tags:
                out.append(case.key)
    return out


_given: dict[
    str, Case
] = {}  # objects that were handed to `run`, by what stands for a file in their specs


def hand_over(case: Case) -> str:
    """Register a Case object; return the text that stands for its file in a `Spec`."""
    token = f"<object {len(_given)}>"
    _given[token] = case
    return token


@functools.lru_cache(maxsize=512)
def resolve(case: str, file: str = "", references: str = "") -> Case:
    """Return the case of a key, from the registry or from a file with its folder of references.

    It is the same object each time, so that what was compiled for it is used again.
    """
    if file in _given:
        return _given[file]
    if file:
        built = load_case(file, **parse_spec(case)[1])
        return built.replace(references=references) if references else built
    return get_case(case)


def starts_refused(cases: Iterable[Case]) -> dict[str, str]:
    """Say why cases have no start, by key: every run of theirs would end with this sentence."""
    from nsbench.dynamics.contacts.tolerances import scene_of
    from nsbench.solvers.common.initial_state import initial_state

    refused = {}
    for case in cases:
        if isinstance(case.problem, Complementarity):
            try:
                initial_state(case, scene_of(case))
            except ValueError as e:
                refused[case.key] = str(e)
    return refused


def plan_runs(
    cases: Iterable[tuple[str, str]],
    specs: Iterable[str] | None,
    values: dict | None = None,
    solver_files: tuple[str, ...] = (),
    references: str = "",
) -> list[Spec]:
    """Return every run to attempt.

    cases: (key, file), the file "" for a registered case; specs: of solvers (None: the standard
    ones, and those that a case and its kind of problem add); values: accuracies by name ("h",
    "tol", "k") that replace the standard ladders; references: folder of the references of case
    files. A pair that the solver refuses is one run of accuracy NaN. Raises ValueError for a step
    that no grid over the samples has.
    """
    out = []
    for key, file in cases:
        where = references if file else ""
        case = resolve(key, file, where)
        chosen = list(specs) if specs else [*solvers.standard(), *case.also, *_also_of_kind(case)]
        for spec in dict.fromkeys(chosen):
            method = solvers.get(spec)
            if user_code.solver_refuses(method, case, spec):
                nothing = float("nan")
                out.append(Spec(key, spec, method.accuracy, nothing, file, solver_files, 0, where))
                continue
            asked = (values or {}).get(method.accuracy) or ladder(case, method)
            for h in asked if values and method.accuracy == "h" else ():
                solvers.grid(case.t, h)  # raises before anything runs
            out += [
                Spec(key, spec, method.accuracy, float(a), file, solver_files, 0, where)
                for a in asked
            ]
    return out


def _also_of_kind(case: Case) -> tuple[str, ...]:
    """Return the variants that are run on every problem of a kind: of circuits the trapezoidal rule
    beside implicit Euler, of second order between the switches at the same cost."""
    return ("theta[theta=0.5]",) if isinstance(case.problem, LCS) else ()


def substeps_ladder(first: int, octaves: float = OCTAVES, points: int = POINTS) -> list[int]:
    """Return at least `points` step counts from `first` to 2^octaves times as many.

    Their ratios are not dyadic.
    """
    ratio = 2.0 ** (octaves / (points - 1)) * 1.003
    while True:
        out = [first]
        while out[-1] < first * 2**octaves:
            out.append(max(out[-1] + 1, round(out[-1] * ratio)))
        if len(out) >= points:
            return out
        ratio = 1.0 + 0.97 * (ratio - 1.0)


def ladder(case: Case, method: Solver) -> list[float]:
    """Return the accuracies of the standard suite for a case and a method."""
    if method.accuracy == "h":
        spacing = float(np.diff(case.t).min())
        # fewer steps per sample than a case's `substeps` are not asymptotic
        octaves = getattr(method, "octaves", OCTAVES)
        return [
            spacing / n
            for n in substeps_ladder(
                max(1, case.substeps), octaves, round(POINTS * octaves / OCTAVES)
            )
        ]
    values = [float(v) for v in getattr(method, "ladder", (method.default,))]
    if method.accuracy == "k" and len(values) == 2:
        first, last = values
        values = [float(v) for v in np.geomspace(first, last, POINTS)]
    return [v * accuracy_unit(method, case) for v in values]

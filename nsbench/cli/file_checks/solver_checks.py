"""Checks of a method: protocol, refusals, determinism, and convergence on cases with a closed form.

On two cases of each problem class that the method takes, the errors of state and multipliers are
measured over a range of accuracies. They must fall as the method claims; where they do not, the
multipliers are compared with the exact ones to say what they are instead.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nsbench import solvers
from nsbench.case import Case, get_case
from nsbench.measure import errors, fit_order
from nsbench.reference import canonical, columns_of, listed_contacts, reference, spread
from nsbench.report.claims import find_expectation
from nsbench.solvers.base import Solver, default_accuracy
from nsbench.solvers.scaled_run import ScaledRun
from nsbench.study.describe import describe_case, describe_solver
from nsbench.study.plan import ladder
from nsbench.study.result_contract import contract_violation
from nsbench.trajectory import Trajectory

Say = Callable[[str], None]
PROBES = ("tide", "sliding", "three_discs")  # one of each kind of problem that solvers accept
# cases with a closed form of state and multipliers, by problem class
CLOSED_FORMS = (
    ("tide", "obstacle", "two_discs", "graze"),
    ("friction", "oscillator", "circle_sliding"),
    ("rlc_diode", "diode_bridge"),
)
CASES_OF_A_CLASS = 2
SUBSTEPS = (2, 3, 5, 7, 11, 17, 27, 41, 64, 101, 160)  # steps between two samples, not dyadic
SECONDS_OF_A_CASE = 30.0  # finer accuracies of a slow method are left out
ORDER_TOLERANCE = 0.15  # between the claimed order and a fitted one
WIDEST_INTERVAL = 1.0  # of a fitted order: a wider one holds any claim
MEASURED = ("ok", "below_reference", "unverified")
EXACT = "exact: no order"  # verdict of a fit
UNLIKE_AN_ORDER = {"plateau": "they level off", "diverges": "they grow"}  # verdicts of a fit
COMPARED = "compared"  # the multipliers of the finest run with the exact ones
EVERYTHING = frozenset(("state", "multipliers", "reaction", COMPARED))
BELOW_REFERENCE = "below reference"  # verdict of a fit


def check_solver(name: str, say: Say) -> list[str]:
    """Check a registered method, by name or spec with options; returns violations as sentences."""
    method = solvers.get(name)
    violations = []
    for probe in PROBES:
        case = get_case(probe)
        why = method.refuses(case)
        say(f"{probe}: {why or 'runs'}")
        if why is None:
            violations += _check_run(case, method)
        elif not (isinstance(why, str) and len(why.split()) > 2):
            violations.append(
                f"refuses({probe}) returns {why!r}; None is needed, or a sentence (three words)"
            )
    if violations:
        return violations
    classes = [
        [c for c in map(get_case, keys) if method.refuses(c) is None] for keys in CLOSED_FORMS
    ]
    if not any(classes):
        say(f"{name} refuses every case with a closed form: no error or order of it was measured")
    for taken in classes:
        for case in taken[:CASES_OF_A_CLASS]:
            violations += _check_convergence(case, method, name, say)
    return violations


def _check_run(case: Case, method: Solver) -> list[str]:
    """Check one run against the contract, and that it depends on nothing but its input."""
    value = default_accuracy(method, case)
    runs = [ScaledRun(method, case, value) for _ in range(2)]
    found = [runs[0](), runs[0](), runs[1]()]
    wrong = contract_violation(case, runs[0].to_user_units(found[0]), method.accuracy, value)
    if wrong:
        return [f"{case.key}: {wrong}"]
    for other, when in zip(found[1:], ("is called again", "is prepared again"), strict=True):
        differing = _difference(found[0], other)
        if differing:
            return [
                f"{case.key}: {differing} when the run {when}: it must depend on nothing but case, "
                f"options and accuracy (no state kept, random numbers from a fixed seed)"
            ]
    return _check_contacts(case, runs[0].to_user_units(found[0]))


def _difference(one: Trajectory, other: Trajectory) -> str:
    """Return which array of two runs differs first, and by how much; "" if none does."""
    for name in ("x", "impulse", "reaction"):
        a = getattr(one, name)
        b = getattr(other, name)
        if a.shape != b.shape:
            return f"{name} changes its shape from {a.shape} to {b.shape}"
        if not np.array_equal(a, b, equal_nan=True):
            return f"{name} changes by {np.nanmax(np.abs(a - b)):.3g}"
    return ""


def _check_contacts(case: Case, traj: Trajectory) -> list[str]:
    """Check that the ids of contacts are those of the case, each once."""
    if case.exact_impulse is None:
        return []
    known = listed_contacts(case)
    ids = [canonical(case.problem, c) for c in traj.contacts]
    strange = [c for c in ids if c not in known]
    if strange:
        return [
            f"{case.key}: contacts has the id {strange[0]}, which is none of the case; they are "
            f"(family, row), here {', '.join(map(str, known[:4]))}"
        ]
    return [f"{case.key}: contacts lists an id twice"] if len(set(ids)) < len(ids) else []


def _accuracies(case: Case, method: Solver) -> tuple[list[float], list[float]]:
    """Return a few accuracies to run, from coarse to fine, and the ladder of the standard suite."""
    values = ladder(case, method)
    if method.accuracy == "h":
        spacing = float(np.diff(case.t).min())
        few = [spacing / n for n in SUBSTEPS]
        return [h for h in few if h >= min(values) or h == few[0]], values
    return values[:: max(1, len(values) // len(SUBSTEPS))], values


def _check_convergence(case: Case, method: Solver, name: str, say: Say) -> list[str]:
    """Measure the errors over the accuracies and compare them with what the method claims.

    The order of a method whose errors jump with the place of an event in its step shows on many
    steps only: where few contradict a claim, the ladder of the standard suite decides on that
    claim, and on no other. A claim that holds on few steps is fine whether others hold or not.
    """
    few, standard = _accuracies(case, method)
    first = _measure(case, method, name, few)
    said = f"{case.key}: {first.in_words()}"
    violations = first.violations
    if standard != few and not violations.keys() <= {COMPARED}:
        again = _measure(case, method, name, standard, frozenset(violations))
        if again.outcomes:
            held = first.in_words(frozenset(first.outcomes) - frozenset(violations))
            few_say = f"{first.ladder} contradict the claim"
            judged = f"{again.in_words()} (the ladder of the standard suite, as {few_say})"
            said = f"{case.key}: {'; '.join(filter(None, (held, judged)))}"
            why = f" (the ladder of the standard suite; {few_say} too)"
            violations = {k: v + why for k, v in again.violations.items()}
    say(said)
    return [f"{case.key}: {v}" for v in violations.values()]


@dataclass(frozen=True)
class _Measured:
    """What the errors on a ladder show, in words, and what contradicts a claim, by quantity.

    ladder: which accuracies were run, in words, "" if none of their runs ended well.
    """

    ladder: str
    outcomes: dict[str, str]
    violations: dict[str, str]
    why_not: str = ""

    def in_words(self, only: frozenset[str] | None = None) -> str:
        """Say what these quantities show (None: all), and on which ladder; "" of none."""
        if self.why_not:
            return self.why_not
        shown = [f"{k} {v}" for k, v in self.outcomes.items() if only is None or k in only]
        return f"{', '.join(shown)} on {self.ladder}" if shown else ""


def _measure(
    case: Case, method: Solver, name: str, values: list, asked: frozenset[str] = EVERYTHING
) -> _Measured:
    """Run the accuracies; return what the errors of the quantities asked for show."""
    expected = find_expectation(describe_case(case), describe_solver(name))
    steps = []
    rows = []
    began = time.monotonic()
    for value in values:
        if time.monotonic() - began > SECONDS_OF_A_CASE:  # the finest accuracies come last
            break
        traj = solvers.solve(case, name, **{method.accuracy: value})
        if traj.status.code not in MEASURED:
            continue
        taken = {"h": traj.stats.get("h", value), "k": 1.0 / value}
        steps.append(taken.get(method.accuracy, value))
        rows.append(errors(case, traj))
    if not rows:
        why = f"no run ended well, nothing measured ({traj.status})"
        return _Measured("", {}, {}, why)
    ladder_in_words = _ladder_in_words(method.accuracy, steps)
    outcomes = {}
    violations = {}
    for quantity, column, wanted in (
        ("state", "state_sup", expected["state"]),
        ("multipliers", "impulse", expected["impulse"]),
        ("reaction", "reaction", expected["impulse"]),
    ):
        measured = column == "state_sup" or np.isfinite(rows[-1][column])
        if quantity not in asked or not measured:
            continue
        text, wrong = _judge(steps, [r[column] for r in rows], rows[-1], column, wanted)
        outcomes[quantity] = text
        if wrong:
            violations[quantity] = f"{quantity}: {wrong} on {ladder_in_words}"
    compared = _compare_multipliers(case, traj, bool(violations)) if COMPARED in asked else ""
    if compared:
        violations[COMPARED] = f"{compared}, in the finest run of {ladder_in_words}"
    return _Measured(ladder_in_words, outcomes, violations)


def _ladder_in_words(accuracy: str, steps: list[float]) -> str:
    """Say how many accuracies were measured, and from where to where; of k, steps are 1 / k."""
    first, last = (1.0 / s if accuracy == "k" else s for s in (steps[0], steps[-1]))
    unit = ("step" if accuracy == "h" else "value") + "s" * (len(steps) > 1)
    counted = f"{len(steps)} {unit} {'' if accuracy == 'h' else 'of '}{accuracy}"
    return f"{counted} from {first:.2g} to {last:.2g}"


def _judge(steps, values, finest: dict, column: str, wanted) -> tuple[str, str]:
    """Return what the errors show in words, and how that contradicts the expectation ("": not)."""
    scale = finest["state_scale" if column == "state_sup" else "impulse_scale"]
    if not np.all(np.isfinite(values)):
        return "not measured", ""
    if isinstance(wanted, tuple):
        off = min(values)
        bound = wanted[1] * scale
        text = f"to {off:.1e}"
        return text, "" if off <= bound else f"an error of at most {bound:.1e} is claimed, {text}"
    if not isinstance(wanted, (int, float)) or len(steps) < len(SUBSTEPS) // 2:
        return f"to {min(values):.1e}", ""
    floor = finest["state_floor" if column == "state_sup" else f"{column}_floor"]
    fit = fit_order(np.array(steps), np.array(values), floor, scale=scale)
    if fit.verdict in (EXACT, BELOW_REFERENCE) or column in finest["below"].split():
        return "exact", ""
    text = f"of order {fit.order:.2f}"
    slope = f"slope of the fit {fit.order:.2f}, not an order"
    few = f"{values[0]:.1e} ... {values[-1]:.1e}"
    low, high = fit.interval
    holds_claim = low <= wanted <= high <= low + WIDEST_INTERVAL
    is_met = holds_claim or max(fit.order, fit.line) > wanted - ORDER_TOLERANCE
    if fit.verdict in UNLIKE_AN_ORDER:
        text = f"of no order: {UNLIKE_AN_ORDER[fit.verdict]} ({slope})"
    elif is_met:
        is_clear = holds_claim or fit.order > wanted - ORDER_TOLERANCE
        by_line = f"undecided: {fit.line:.2f} is the slope of one line, {slope}"
        return text if is_clear else by_line, ""
    elif fit.verdict != "order":
        text = f"of no order: {fit.reason} ({slope})"
    return text, f"order {wanted:g} is claimed, the errors {few} are {text}"


def _compare_multipliers(case: Case, traj: Trajectory, is_wrong: bool) -> str:
    """Say what the multipliers of the finest run are where they are not the exact ones.

    "" where they are. Their part along the exact ones is 1, -1 for the opposite sign, 0 where there
    are none.
    """
    ref = reference(case)
    if ref is None or ref.impulse is None:
        return ""
    columns = columns_of(case.problem, ref.contacts, traj.contacts)
    exact = spread(case.problem, ref.contacts, ref.impulse, columns).ravel()
    found = spread(case.problem, traj.contacts, traj.impulse, columns).ravel()
    size = float(exact @ exact)
    if size == 0.0:
        return ""
    part = float(found @ exact) / size
    if part <= -0.5:
        return "the multipliers have the opposite sign; none may be negative"
    if not np.any(found):
        return "the multipliers are all zero, those of the closed form are not"
    if is_wrong and abs(part - 1.0) > ORDER_TOLERANCE:
        return f"the impulses are {part:.3g} times those of the closed form"
    return ""

"""Dry run (`nsbench run --plan`): what would run and why, what is reused, and a forecast.

The reason why a run is made again comes from the parts of its key (nsbench.results.run_key) that
are stored with its row: the items that differ are named. Nothing is written.
"""

from __future__ import annotations

import argparse
import os
from collections import Counter, defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from nsbench.case import Case, size
from nsbench.execute.forecast import GUESS, NOTHING, PROBE, Forecast, select_probes
from nsbench.execute.probe import probe
from nsbench.execute.workers import memory
from nsbench.results.journal import read_journal, read_parts
from nsbench.results.row_reuse import CHANGED_DURING_RUN, READ, changed_data
from nsbench.results.run_key import PACKAGE, VARIABLE, Part
from nsbench.study import Spec

MAX_PAIRS = 30  # of case and solver that are listed, the longest first; the others are counted
MAX_REASONS = 20  # that are listed; the others are counted
MAX_CHANGES = 3  # of one reason that are named; the others are counted
WORKER_START = 2.0  # seconds in which a worker imports what it needs
SHOWN_COMPILATION = 1.0  # seconds of compiling from which they are mentioned
FILE_SUFFIXES = (".py", ".npz", ".json", ".csv", ".txt")

# reasons that name no item
NEW = "new"
NEW_ACCURACY = "new accuracy"
UNKNOWN_PARTS = "made by a version that did not say of what"

Say = Callable[..., None]
Cases = dict[tuple[str, str], Case]  # by key and file


def worker_count(args: argparse.Namespace) -> int:
    """Workers on this machine: those of -j, or the number of cores, at most two."""
    return args.jobs or min(2, os.cpu_count() or 1)


def check_memory(sizes: dict[str, size.Size | None], args: argparse.Namespace) -> None:
    """Raise ValueError for a case one run of which is foreseen to need more than a worker may use.

    sizes: by name of the case; None where nothing large is foreseen.
    """
    limit = args.memory or memory.worker_limit(worker_count(args))
    for name, foreseen in sizes.items():
        if foreseen is not None and foreseen.memory > limit:
            raise ValueError(
                f"{name}: {foreseen}, foreseen before anything is made; a worker may hold "
                f"{size.memory(limit)} "
                "(--memory of nsbench run gives it another limit)"
            )


@dataclass(frozen=True)
class Plan:
    """Runs of a study with all that their keys are made of, and the rows that may be reused."""

    specs: list[Spec]
    cases: Cases
    parts: dict[Spec, tuple[Part, ...]]
    keys: dict[Spec, str]
    reusable: dict  # rows by key
    out: Path  # folder of the results


def print_plan(plan: Plan, args: argparse.Namespace, say: Say) -> int:
    """Print what would run, why, and a forecast of time and memory; the exit code."""
    why = rerun_reasons(plan, args.force)
    todo = [s for s in plan.specs if why[s]]
    say(f"{len(todo)} to run, {len(plan.specs) - len(todo)} known")
    if args.verbose:
        for s in plan.specs:
            reason = f"  {why[s]}" if why[s] else ""
            say(f"{'run' if why[s] else 'reuse':<6} {s.label}{reason}")
    if not todo:
        return 0
    say("why:")
    reasons = Counter(why[s] for s in todo).most_common()
    for reason, runs in reasons[:MAX_REASONS]:
        say(f"  {runs:>7}  {reason}")
    if len(reasons) > MAX_REASONS:
        say(f"           and {len(reasons) - MAX_REASONS} more reasons (-v tells each)")
    forecast, probed = _build_forecast(todo, plan, args, say)
    _print_forecast(plan, why, forecast, probed, args, say)
    return 0


def _build_forecast(todo: list[Spec], plan: Plan, args, say: Say) -> tuple[Forecast, dict]:
    """The forecast, from the journal and from small runs; and the rows of these, by spec."""
    rows = [r for r in read_journal(plan.out).values() if r.get("seconds")]
    known_pairs = {(r["case"], r["solver"]) for r in rows}
    unknown = [s for s in todo if (s.case, s.solver) not in known_pairs]
    probed: dict = {}
    if unknown and args.probe > 0.0:
        limit = args.memory or memory.worker_limit(1)
        needs = {key: size.size_of(plan.cases[key]).memory for key in plan.cases}
        fitting = [s for s in select_probes(unknown) if needs[s.case, s.file] <= limit]
        probed = probe(fitting, args.probe)
        say(
            f"{len(probed)} small runs were made in a process of their own (at most {args.probe:g} "
            f"s in all; --probe)"
        )
    return Forecast(rows, probed.values()), probed


@dataclass
class _PairForecast:
    """Forecast of the runs of one case with one solver."""

    case: str
    file: str
    solver: str
    to_run: int = 0
    reused: int = 0
    seconds: float = 0.0
    timing: float = 0.0  # of them, with nothing beside it
    source: str = ""  # what the seconds are known from
    memory: float = 0.0  # bytes


def _forecast_pairs(plan: Plan, why: dict, forecast: Forecast) -> list[_PairForecast]:
    """Sum the forecasts by case and solver; only of pairs of which something is to run."""
    pairs: dict[tuple, _PairForecast] = {}
    for s in plan.specs:
        key = s.case, s.file, s.solver
        pair = pairs.setdefault(key, _PairForecast(*key))
        if why[s]:
            cost = forecast.cost(s)
            pair.to_run += 1
            pair.seconds += cost.seconds
            pair.timing += cost.timing
            pair.source = cost.source
        else:
            pair.reused += 1
    return [pair for pair in pairs.values() if pair.to_run]


def _print_forecast(plan: Plan, why: dict, forecast: Forecast, probed: dict, args, say: Say):
    """Print the table of case and solver, and the sums below it."""
    pairs = _forecast_pairs(plan, why, forecast)
    refusals = sum(1 for p in pairs if p.source == NOTHING)
    if refusals:
        say(
            f"{refusals} of them {'are refusals' if refusals > 1 else 'is a refusal'}, "
            f"which take no time"
        )
    ranked = sorted((p for p in pairs if p.source != NOTHING), key=lambda p: -p.seconds)
    if not ranked:
        return
    for pair in ranked:
        pair.memory = size.size_of(plan.cases[pair.case, pair.file]).memory
    shown = ranked if args.verbose else ranked[:MAX_PAIRS]
    case_width = max(len(name) for name in (*(p.case for p in shown), "case"))
    solver_width = max(len(name) for name in (*(p.solver for p in shown), "solver"))
    say(
        f"{'case':<{case_width}}  {'solver':<{solver_width}}  {'run':>5} {'reuse':>5} "
        f"{'seconds':>9} {'memory':>9}  from"
    )
    for p in shown:
        say(
            f"{p.case:<{case_width}}  {p.solver:<{solver_width}}  {p.to_run:>5} {p.reused:>5} "
            f"{p.seconds:>9.3g} {size.memory(p.memory):>9}  {p.source}"
        )
    if rest := ranked[len(shown) :]:
        say(
            f"and {len(rest)} more of case and solver, {sum(p.seconds for p in rest):.3g} s "
            f"together (-v lists them)"
        )
    compilation = forecast.compilation(p.solver for p in ranked)
    _print_totals(plan, ranked, compilation, probed, args, say)


def _print_totals(
    plan: Plan, pairs: list[_PairForecast], compilation: float, probed: dict, args, say: Say
) -> None:
    """Print the time of all runs, on the workers and on the clock, and the largest case."""
    jobs = worker_count(args)
    by_case: dict[tuple, float] = defaultdict(float)
    for p in pairs:
        by_case[p.case, p.file] += p.seconds - p.timing
    timing = sum(p.timing for p in pairs)
    shared = sum(by_case.values()) + compilation
    total = shared + timing
    # one worker takes all runs of a case: no other one can take half of it
    on_the_clock = WORKER_START + max(shared / jobs, max(by_case.values())) + timing
    uncertain = []
    for source, words in ((PROBE, "from small runs"), (GUESS, "guessed")):
        seconds = sum(p.seconds for p in pairs if p.source == source)
        if seconds:
            uncertain.append(f"{seconds:.3g} s {words}")
    if compilation >= SHOWN_COMPILATION:
        uncertain.append(f"{compilation:.3g} s of compiling what is not on the disk yet")
    sources = f" ({', '.join(uncertain)})" if uncertain else ""
    say(
        f"forecast: {total:.3g} s of computing, about {on_the_clock:.3g} s with {jobs} "
        f"worker{'s' if jobs > 1 else ''}, the report not counted{sources}"
    )
    largest = max(pairs, key=lambda p: p.memory)
    peak = max([float(row["memory"]) for row in probed.values()], default=0.0)
    say(
        f"largest: {largest.case}, {size.size_of(plan.cases[largest.case, largest.file])}"
        + (f"; the small runs held {size.memory(peak)}" if peak else "")
        + f"; a worker may hold {size.memory(args.memory or memory.worker_limit(jobs))}"
    )


def rerun_reasons(plan: Plan, force: bool) -> dict[Spec, str]:
    """Say for every run in a few words why it is to be made; "" where its row is reused."""
    stored_parts, items = read_parts(plan.out)
    rows = read_journal(plan.out)
    data = changed_data(plan.out, plan.specs, plan.keys)
    known_pairs = {key[:2] for key in stored_parts}
    changes: dict[tuple, str] = {}  # runs of one case and solver have changed alike
    reasons = {}
    for s in plan.specs:
        key = plan.keys[s]
        old = stored_parts.get((s.case, s.solver, s.accuracy, repr(float(s.asked))))
        if key in plan.reusable and not force:
            reasons[s] = ""
        elif old is None:
            reasons[s] = NEW_ACCURACY if (s.case, s.solver) in known_pairs else NEW
        elif s in data and not force:
            reasons[s] = "; ".join(f"{name.partition(': ')[2]} changed" for name in data[s])
        elif key in rows and old and not _changed_while_used(old, items):
            reasons[s] = "forced" if force else f"ended with {rows[key].get('status')}"
        else:
            new = tuple(p.digest for p in plan.parts[s])
            if (*old, *new) not in changes:
                changes[*old, *new] = _describe_changes(
                    [items.get(d) for d in old], [dict(p.items) for p in plan.parts[s]]
                )
            reasons[s] = changes[*old, *new]
    return reasons


def _changed_while_used(parts: list[str], items: dict[str, dict]) -> str:
    """The files that changed while a row was made, so that it is not certain what made it."""
    return next(
        (items[d][CHANGED_DURING_RUN] for d in parts if CHANGED_DURING_RUN in items.get(d, ())), ""
    )


def _describe_changes(old: list[dict | None], new: list[dict]) -> str:
    """Name the items that differ between the stored parts and those of now."""
    if not old or any(part is None for part in old):
        return UNKNOWN_PARTS
    # data files that the run itself read are compared elsewhere (row_reuse.changed_data)
    old = [{k: v for k, v in part.items() if not k.startswith(READ)} for part in old]
    if changed_file := next(
        (part[CHANGED_DURING_RUN] for part in old if CHANGED_DURING_RUN in part), ""
    ):
        return f"{changed_file} {CHANGED_DURING_RUN}"
    before = {name: digest for part in old for name, digest in part.items()}
    after = {name: digest for part in new for name, digest in part.items()}
    changes = [
        _describe_change(name, before.get(name), after.get(name))
        for name in sorted(before.keys() | after.keys())
        if before.get(name) != after.get(name)
    ]
    if not changes:
        return "asked for otherwise"
    more = f"; {len(changes) - MAX_CHANGES} more" if len(changes) > MAX_CHANGES else ""
    return "; ".join(changes[:MAX_CHANGES]) + more


def _describe_change(name: str, old: str | None, new: str | None) -> str:
    """Describe one item: contents that changed, or a version that is another one."""
    is_content = name == PACKAGE or name.startswith(VARIABLE) or "/" in name
    if not (is_content or name.endswith(FILE_SUFFIXES)):
        return f"{name} {old or 'none'} -> {new or 'none'}"
    if old is None:
        return f"{name} is used now"
    return f"{name} is used no more" if new is None else f"{name} changed"

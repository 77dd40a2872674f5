"""What `nsbench run --plan` says: which runs would be made and why, what is reused, and what it
will take."""

from __future__ import annotations

import os
from collections import Counter, defaultdict
from pathlib import Path

import numpy as np

from nsbench.case import size
from nsbench.execute.forecast import GUESS, NOTHING, PROBE, Forecast, small
from nsbench.execute.probe import probe
from nsbench.execute.rerun_reasons import rerun_reasons
from nsbench.execute.workers import memory
from nsbench.results.journal import read_journal

PAIRS = 30  # of case and solver that are told, the longest first; the others are counted
REASONS = 20
START = 2.0  # seconds in which a worker loads what it needs


def jobs_of(args) -> int:
    return args.jobs or min(2, os.cpu_count() or 1)


def check_memory(sizes: dict[str, size.Size | None], args) -> None:
    """Raises ValueError for a case one run of which is foreseen to need more memory than one worker
    may hold."""
    limit = args.memory or memory.limit(jobs_of(args))
    for name, s in sizes.items():
        if s is not None and s.memory > limit:
            raise ValueError(
                f"{name}: {s}, foreseen before anything is made; a worker may hold "
                f"{size.memory(limit)} "
                "(--memory of nsbench run gives it another limit)"
            )


def tell(specs, cases, parts, keys, known: dict, out: Path, args, say) -> int:
    """Say the plan; nothing is written."""
    why = rerun_reasons(specs, parts, keys, known, out, args.force)
    todo = [s for s in specs if why[s]]
    say(f"{len(todo)} to run, {len(specs) - len(todo)} known")
    if args.verbose:
        for s in specs:
            say(f"{'run' if why[s] else 'reuse':<6} {s.label}{'  ' + why[s] if why[s] else ''}")
    if not todo:
        return 0
    say("why:")
    counted = Counter(why[s] for s in todo).most_common()
    for reason, n in counted[:REASONS]:
        say(f"  {n:>7}  {reason}")
    if len(counted) > REASONS:
        say(f"           and {len(counted) - REASONS} more reasons (-v tells each)")
    forecast, probed = _forecast(todo, cases, out, args, say)
    _table(specs, why, cases, forecast, probed, args, say)
    return 0


def _forecast(todo, cases, out, args, say):
    rows = [r for r in read_journal(out).values() if r.get("seconds")]
    seen = {(r["case"], r["solver"]) for r in rows}
    unknown = [s for s in todo if (s.case, s.solver) not in seen]
    found: dict = {}
    if unknown and args.probe > 0.0:
        limit = args.memory or memory.limit(1)
        fitting = [s for s in small(unknown) if size.size_of(cases[s.case, s.file]).memory <= limit]
        found = probe(fitting, args.probe)
        say(
            f"{len(found)} small runs were made in a process of their own (at most {args.probe:g} "
            f"s in all; --probe)"
        )
    return Forecast(rows, found.values()), found


def _table(specs, why, cases, forecast, probed, args, say):
    pairs = defaultdict(lambda: [0, 0, 0.0, 0.0])
    sources = {}
    for s in specs:
        entry = pairs[s.case, s.file, s.solver]
        entry[0 if why[s] else 1] += 1
        if why[s]:
            cost = forecast.cost(s)
            entry[2] += cost.seconds
            sources[s.case, s.file, s.solver] = cost.source
    for case, file, solver in [p for p, source in sources.items() if source != NOTHING]:
        pairs[case, file, solver][3] = size.size_of(cases[case, file]).memory
    refused = [p for p, source in sources.items() if source == NOTHING]
    if refused:
        say(
            f"{len(refused)} of them {'are refusals' if len(refused) > 1 else 'is a refusal'}, "
            f"which take no time"
        )
    ranked = sorted((p for p in sources if sources[p] != NOTHING), key=lambda p: -pairs[p][2])
    if not ranked:
        return
    shown = ranked if args.verbose else ranked[:PAIRS]
    wide = [max(len(p[i]) for p in (*shown, ("case", "", "solver"))) for i in (0, 2)]
    say(
        f"{'case':<{wide[0]}}  {'solver':<{wide[1]}}  {'run':>5} {'reuse':>5} {'seconds':>9} "
        f"{'memory':>9}  from"
    )
    for p in shown:
        run, reuse, seconds, held = pairs[p]
        say(
            f"{p[0]:<{wide[0]}}  {p[2]:<{wide[1]}}  {run:>5} {reuse:>5} {seconds:>9.3g} "
            f"{size.memory(held):>9}  {sources[p]}"
        )
    if len(ranked) > len(shown):
        rest = ranked[len(shown) :]
        say(
            f"and {len(rest)} more of case and solver, {sum(pairs[p][2] for p in rest):.3g} s "
            f"together (-v lists them)"
        )
    _total(ranked, pairs, sources, cases, probed, args, say)
    compiling = forecast.compiling(p[2] for p in ranked)
    if compiling >= 1.0:
        say(f"compiling: up to {compiling:.3g} s more, where kernels are not on the disk yet")


def _total(ranked, pairs, sources, cases, probed, args, say):
    jobs = jobs_of(args)
    by_case = defaultdict(float)
    for p in ranked:
        by_case[p[:2]] += pairs[p][2]
    total = sum(by_case.values())
    # a case is one worker's; another one cannot take half of it
    clock = START + max(total / jobs, max(by_case.values()))
    parts = {
        source: sum(pairs[p][2] for p in ranked if sources[p] == source)
        for source in (PROBE, GUESS)
    }
    told = [
        f"{v:.3g} s {'from small runs' if k == PROBE else 'guessed'}" for k, v in parts.items() if v
    ]
    say(
        f"forecast: {total:.3g} s of computing, about {clock:.3g} s with {jobs} "
        f"worker{'s' if jobs > 1 else ''}, the report not "
        f"counted{' (' + ', '.join(told) + ')' if told else ''}"
    )
    largest = max(ranked, key=lambda p: pairs[p][3])
    peak = max([r["memory"] for r in probed.values()], default=0.0)
    say(
        f"largest: {largest[0]}, {size.size_of(cases[largest[:2]])}"
        + (f"; the small runs held {size.memory(float(np.max(peak)))}" if peak else "")
        + f"; a worker may hold {size.memory(args.memory or memory.limit(jobs))}"
    )

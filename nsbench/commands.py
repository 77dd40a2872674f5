"""What the commands do; they are given `say` to print with and return the exit code."""
from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

from nsbench import solvers, study
from nsbench.case import broken_cases, case_module, case_names, get_case, load_case

FINE, FAILED, NOTHING, BROKEN = 0, 3, 4, 5
EXPECTED = ("ok", "refused", "below_reference")
METRICS = {
    "state_sup": "largest error of the state over the sample times", "state_T": "error of the state at T",
    "set_distance": "distance of the states to the set of all solutions, where there are many",
    "impulse": "largest error of a cumulative impulse over the sample times",
    "reaction": "the same of the cumulative reaction, unique even where multipliers are not",
    "l1": "sum over sample intervals of the error of the interval's impulse",
    "settled": "largest error of an interval-mean multiplier away from events",
    "lam_own": "largest error of single steps' multipliers away from events, at the method's own time in the step",
    "lam_at_start": "the same against the exact multiplier at the start of the step",
    "lam_at_mid": "the same at its middle", "lam_at_end": "the same at its end", "lam_mean": "the same of its mean",
    "event_time": "largest error of a located event", "feasibility": "largest violation max(-g, 0)",
    "sign": "smallest multiplier", "complementarity": "largest product of gap and impulse",
    "residual": "residual of the equation", "selection": "distance to the least-norm multiplier (not an error)",
    "polyhedron": "distance of the multiplier to the set of all multipliers",
}


def list_(args, say) -> int:
    """nsbench list"""
    want = args.what
    if want in (None, "cases"):
        say("cases:" if want is None else "")
        for name in case_names():
            module = case_module(name)
            first = (module.__doc__ or "").strip().splitlines()[0]
            params = _parameters(module)
            say(f"  {name:<16} {first}" + (f"  [{params}]" if params else ""))
        for name, why in broken_cases().items():
            say(f"  {name:<16} FAILED TO LOAD: {why}")
    if want in (None, "solvers"):
        say("solvers:" if want is None else "")
        for name in solvers.all_names():
            method = solvers.get(name)
            first = (type(method).__doc__ or "").strip().splitlines()[0]
            say(f"  {name:<16} {first}  [{method.accuracy}; {_options(method)}]")
        for name, why in solvers.broken().items():
            say(f"  {name:<16} FAILED TO LOAD: {why}")
    if want in (None, "metrics"):
        say("metrics:" if want is None else "")
        for name, text in METRICS.items():
            say(f"  {name:<16} {text}")
    return FINE


def _parameters(module) -> str:
    import inspect
    if not hasattr(module, "make"):
        return ""
    return ", ".join(f"{k}={v.default}" for k, v in inspect.signature(module.make).parameters.items())


def _options(method) -> str:
    import dataclasses
    return ", ".join(f"{f.name}={f.default}" for f in dataclasses.fields(method))


def run(args, say) -> int:
    """nsbench run"""
    _workers(args)
    solver_files = tuple(str(p) for f in args.solver_files for p in python_files(f))
    added = [solvers.load(f) for f in solver_files]
    values = {n: read_values(getattr(args, n)) for n in ("h", "tol", "k") if getattr(args, n) is not None}
    files = [(load_case(p).key, str(p)) for f in args.case_files for p in python_files(f)]
    if args.cases:
        named = [get_case(c) for c in args.cases]
        keys = [(c.key, "") for c in named if args.tag is None or args.tag in c.tags]
    else:
        keys = [] if files else [(k, "") for k in study.suite_cases(args.suite, args.tag)]
    chosen = args.solver or ([*solvers.standard()] if files and not args.cases else None)
    specs = study.plan([*keys, *files], chosen, values, solver_files)
    if not specs:
        raise LookupError("nothing to run: no case matches")
    if added and args.solver is None:
        specs += [s for s in study.plan([*keys, *files], added, values, solver_files) if s not in specs]
    from nsbench.execute.suite import execute
    return execute(specs, Path(args.out), args, say)


def _workers(args) -> None:
    if args.jobs is not None and args.jobs < 1:
        raise ValueError(f"-j is {args.jobs}; at least one worker is needed")
    solvers.check_positive("--timeout", args.timeout)


def python_files(path) -> list[Path]:
    path = Path(path)
    if path.is_dir():
        found = sorted(p for p in path.glob("*.py") if not p.name.startswith(("_", ".")))
        if not found:
            raise FileNotFoundError(f"no case or solver file in {path}")
        return found
    if not path.is_file():
        raise FileNotFoundError(f"no file {path}")
    return [path]


def read_values(text: str) -> list[float]:
    """"1e-2", "1e-2,5e-3" or "1e-2..1e-4" (three per octave, at ratios that are not dyadic)."""
    try:
        if ".." in text:
            a, b = (float(v) for v in text.split(".."))
            out = np.geomspace(a, b, max(2, 1 + round(3.07 * abs(np.log2(a / b))))).tolist() if a > 0 and b > 0 else [a, b]
        else:
            out = [float(v) for v in text.split(",")]
    except ValueError:
        raise ValueError(f"cannot read {text!r}; write 1e-2, 1e-2,5e-3 or 1e-2..1e-4") from None
    for v in out:
        solvers.check_positive("accuracy", v)
    return out


def report(args, say) -> int:
    """nsbench report"""
    from nsbench.report import write_report
    for d in args.dirs:
        if not (Path(d) / "runs.parquet").is_file():
            raise FileNotFoundError(f"no results in {d}")
        say(str(write_report(Path(d), Path(d) / "report.html")))
    return FINE


def show(args, say) -> int:
    """nsbench show"""
    case = load_case(args.case) if args.case.endswith(".py") else get_case(args.case)
    say(f"{case.key}: {type(case.problem).__name__}, n = {case.n}, t = {case.t[0]:g} .. {case.t[-1]:g}, "
        f"{len(case.t)} samples")
    if args.solver is None:
        say(case.doc)
        for name in solvers.standard():
            say(f"  {name:<32} {solvers.get(name).refuses(case) or 'runs'}")
        return FINE
    accuracy = {n: getattr(args, n) for n in ("h", "tol", "k") if getattr(args, n) is not None}
    traj = solvers.solve(case, args.solver, **accuracy)
    say(f"{args.solver}: {traj.status.code}. {traj.status}")
    for name, value in {**traj.stats}.items():
        say(f"  {name:<20} {value}")
    if len(traj.t):
        from nsbench.measure import errors
        found = errors(case, traj)
        for name, value in found.items():
            text = f"{value:.6g}" if isinstance(value, float) else str(value)
            say(f"  {name:<20} {'below ten times the bound of the reference' if name in found['below'].split() else text}")
    for e in traj.events[:40]:
        say(f"  t = {e.t:.12g}  {e.kind}  {e.contact}")
    return FINE if traj.status.code in EXPECTED else FAILED


def check(args, say) -> int:
    """nsbench check"""
    from nsbench.execute.check import check_file
    problems = check_file(Path(args.file), say)
    for p in problems:
        say(f"  not met: {p}")
    say(f"{args.file}: {'fine' if not problems else f'{len(problems)} thing(s) to mend'}")
    return FINE if not problems else FAILED


def reference(args, say) -> int:
    """nsbench reference build | verify | list"""
    import time

    from nsbench import reference as ref
    folder = args.into or None
    keys = args.cases or [k for k in study.suite_cases("full") if _has_stored(get_case(k), args.action, folder)]
    options = {"build": {"kind": args.kind}, "verify": {"certify": args.certify}, "list": {}}[args.action]
    action = {"build": ref.build, "verify": ref.verify, "list": ref.load}[args.action]
    failed = 0
    for key in keys:
        case, start = get_case(key), time.perf_counter()
        try:
            said = action(case, folder=folder, **options)
            took = f" ({time.perf_counter() - start:.1f} s)" if args.action != "list" else ""
            say(f"{key}: {said or 'has no stored reference'}{took}")
        except (ValueError, ArithmeticError) as e:
            failed += 1
            say(f"{key}: {e}")
    return FINE if not failed else FAILED


def _has_stored(case, action, folder) -> bool:
    """Cases of the suite to work on: those with a stored reference and, to build, those that need one."""
    from nsbench.reference import files_of
    return files_of(case, folder)[1].exists() or (action == "build" and case.exact is None and case.unique)


def gate(args, say) -> int:
    """nsbench gate"""
    from nsbench.gate import baseline, told
    from nsbench.gate.facts import facts
    from nsbench.gate.judge import exit_code, judge
    from nsbench.report.source import read
    if args.update and not args.reason.strip():
        raise ValueError("--update needs --reason: a sentence that says why the numbers are others now")
    found, path = facts(read(args.dir)), Path(args.baseline)
    if args.update:
        return _update(found, path, args, say)
    findings = judge(found, baseline.read(path))
    code = exit_code(findings)
    for line in told.lines(findings):
        say(line)
    if args.summary:
        with open(args.summary, "a", encoding="utf-8") as file:
            file.write(told.summary(findings, code))
    return code


def calibrate(args, say) -> int:
    """nsbench calibrate"""
    from nsbench.execute.calibrate import calibrate as again
    _workers(args)
    return again(Path(args.dir), args, say)


def compare(args, say) -> int:
    """nsbench compare"""
    from dataclasses import replace

    from nsbench.gate import baseline, told
    from nsbench.gate.facts import facts
    from nsbench.gate.judge import judge
    from nsbench.report.source import read
    if not 0 <= args.rtol < 1:
        raise ValueError(f"--rtol is {args.rtol:g}; a number from 0 to 1 is needed")
    old, new = ({key: replace(f, config="") for key, f in facts(read(d)).items()} for d in (args.old, args.new))
    lines = {key: baseline.line(fact, 0.0, "") for key, fact in old.items()}
    lines = {key: line if line.kind in ("class", "max") else replace(line, rtol=args.rtol) for key, line in lines.items()}
    findings = judge(new, lines)
    for text in told.lines(findings):
        say(text)
    return FINE if any(f.outcome not in ("missing", "new") for f in findings) else NOTHING


def doctor(args, say) -> int:
    """nsbench doctor"""
    from nsbench.execute.doctor import FAULT, examine
    faults = 0
    for verdict, sentence in examine():
        say(f"{verdict:<8} {sentence}")
        faults += verdict == FAULT
    say("nothing stands in the way" if not faults else f"{faults} fault(s): numbers of this installation are not to be trusted")
    return FINE if not faults else BROKEN


def _update(found, path, args, say) -> int:
    from nsbench.gate import baseline, spreads
    from nsbench.gate.update import updated
    from nsbench.store import write_atomically
    old = baseline.read(path) if path.exists() else {}
    lines, changes = updated(found, old, spreads.read(args.dir), args.reason.strip())
    if changes or not path.exists():
        write_atomically(path, baseline.text(lines).encode())
    for change in changes:
        say(change)
    say(f"{path}: {len(lines)} lines, {len(changes)} changed")
    return FINE


def is_terminal() -> bool:
    return sys.stdout.isatty()


def dump(value) -> bytes:
    return json.dumps(value, indent=1, sort_keys=True, default=str).encode()

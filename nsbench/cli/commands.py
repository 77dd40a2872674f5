"""What the commands do; they are given `say` to print with and return the exit code."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from nsbench import solvers, study
from nsbench.case import broken_cases, case_module, case_names, get_case, load_case

FINE = 0
FAILED = 3
BROKEN = 5
EXPECTED = ("ok", "refused", "below_reference")
METRICS = {
    "state_sup": "largest error of the state over the sample times",
    "state_T": "error of the state at T",
    "set_distance": "distance of the states to the set of all solutions, where there are many",
    "impulse": "largest error of a cumulative impulse over the sample times",
    "reaction": "the same of the cumulative reaction, unique even where multipliers are not",
    "l1": "sum over sample intervals of the error of the interval's impulse",
    "settled": "largest error of an interval-mean multiplier away from events",
    "lam_own": "largest error of single steps' multipliers away from events, at the method's own "
    "time in the step",
    "lam_at_start": "the same against the exact multiplier at the start of the step",
    "lam_at_mid": "the same at its middle",
    "lam_at_end": "the same at its end",
    "lam_mean": "the same of its mean",
    "event_time": "largest error of a located event",
    "feasibility": "largest violation max(-g, 0)",
    "sign": "smallest multiplier",
    "complementarity": "largest product of gap and impulse",
    "residual": "residual of the equation",
    "selection": "distance to the least-norm multiplier (not an error)",
    "polyhedron": "distance of the multiplier to the set of all multipliers",
}


def list_(args, say) -> int:
    """nsbench list"""
    want = args.what
    if want in (None, "cases"):
        say("cases:" if want is None else "")
        for name in case_names():
            module = case_module(name)
            first = _first_line(module)
            params = _parameters(module)
            say(f"  {name:<16} {first}" + (f"  [{params}]" if params else ""))
        for name, why in broken_cases().items():
            say(f"  {name:<16} FAILED TO LOAD: {why}")
    if want in (None, "solvers"):
        say("solvers:" if want is None else "")
        for name in solvers.all_names():
            method = solvers.get(name)
            first = _first_line(type(method))
            say(f"  {name:<16} {first}  [{method.accuracy}; {_options(method)}]")
        for name, why in solvers.broken().items():
            say(f"  {name:<16} FAILED TO LOAD: {why}")
    if want in (None, "metrics"):
        say("metrics:" if want is None else "")
        for name, text in METRICS.items():
            say(f"  {name:<16} {text}")
    return FINE


def _first_line(thing) -> str:
    return next(iter((thing.__doc__ or "").strip().splitlines()), "(says nothing of itself)")


def _parameters(module) -> str:
    import inspect

    if not hasattr(module, "make"):
        return ""
    return ", ".join(
        f"{k}={v.default}" for k, v in inspect.signature(module.make).parameters.items()
    )


def _options(method) -> str:
    import dataclasses

    return ", ".join(f"{f.name}={f.default}" for f in dataclasses.fields(method))


def run(args, say) -> int:
    """nsbench run"""
    from nsbench.case.size import foreseen
    from nsbench.execute.dry_run import admit
    from nsbench.execute.suite import execute

    workers(args)
    _cluster(args)
    keys = []
    left_out = {}
    solver_files = tuple(str(p) for f in args.solver_files for p in python_files(f))
    added = [solvers.load(f) for f in solver_files]
    values = {
        n: read_values(getattr(args, n)) for n in ("h", "tol", "k") if getattr(args, n) is not None
    }
    files = [(load_case(p).key, str(p)) for f in args.case_files for p in python_files(f)]
    if args.cases:
        admit({c: foreseen(c) for c in args.cases}, args)
        named = [get_case(c) for c in args.cases]
        keys = [(c.key, "") for c in named if args.tag is None or args.tag in c.tags]
    elif not files:
        left_out = broken_cases()
        keys = [(k, "") for k in study.suite_cases(args.suite, args.tag, left_out)]
    chosen = args.solver or ([*solvers.standard()] if files and not args.cases else None)
    _told_apart([*keys, *files])
    specs = study.plan([*keys, *files], chosen, values, solver_files)
    if not specs:
        raise LookupError("nothing to run: no case matches")
    if added and args.solver is None:
        specs += [
            s for s in study.plan([*keys, *files], added, values, solver_files) if s not in specs
        ]
    if not (files or args.cases or args.solver):
        left_out |= {f"solver {name}": why for name, why in solvers.broken().items()}
    for name, why in left_out.items():
        say(f"left out: {name}: {why}")
    return execute(specs, Path(args.out), args, say) or (FAILED if left_out else FINE)


def _told_apart(cases) -> None:
    """ValueError with both files where two cases of one run have the same name, or names that are
    equal but for case."""
    seen: dict[str, tuple] = {}
    for key, file in dict.fromkeys(cases):
        one = seen.setdefault(key.casefold(), (key, file))
        if one != (key, file):
            where = [f or study.resolve(k).source for k, f in (one, (key, file))]
            raise ValueError(
                f"two cases are named alike: {one[0]} in {where[0]} and {key} in {where[1]}"
            )


def workers(args) -> None:
    if args.jobs is not None and args.jobs < 1:
        raise ValueError(f"-j is {args.jobs}; at least one worker is needed")
    solvers.check_positive("--timeout", args.timeout)
    if getattr(args, "probe", 0.0) and not 0.0 <= args.probe < float("inf"):
        raise ValueError(f"--probe is {args.probe:g}; a number of seconds is needed, 0 for none")
    if getattr(args, "memory", None) is not None:
        from nsbench.execute.workers.memory import bytes_of

        args.memory = bytes_of(args.memory)


def _cluster(args) -> None:
    from importlib.util import find_spec

    if args.dask is None:
        return
    if args.jobs is not None:
        raise ValueError(
            "-j is for workers on this machine, --dask for those of a cluster; give one of them"
        )
    if find_spec("distributed") is None:
        raise ValueError("--dask needs the package distributed: pip install 'nsbench[dask]'")


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
    """ "1e-2", "1e-2,5e-3" or "1e-2..1e-4" (three per octave, at ratios that are not dyadic)."""
    try:
        if ".." in text:
            a, b = (float(v) for v in text.split(".."))
            out = (
                np.geomspace(a, b, max(2, 1 + round(3.07 * abs(np.log2(a / b))))).tolist()
                if a > 0 and b > 0
                else [a, b]
            )
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
    from nsbench.results.consistency import check

    for d in args.dirs:
        if not (Path(d) / "runs.parquet").is_file():
            raise FileNotFoundError(f"no results in {d}")
        check(d)
        say(str(write_report(Path(d), Path(d) / "report.html")))
    return FINE


def show(args, say) -> int:
    """nsbench show"""
    case = load_case(args.case) if args.case.endswith(".py") else _admitted(args.case)
    say(
        f"{case.key}: {type(case.problem).__name__}, n = {case.n}, t = {case.t[0]:g} .. "
        f"{case.t[-1]:g}, "
        f"{len(case.t)} samples"
    )
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
            say(
                f"  {name:<20} "
                f"{'below ten times the bound of the reference' if name in found['below'].split() else text}"
            )
    for e in traj.events[:40]:
        say(f"  t = {e.t:.12g}  {e.kind}  {e.contact}")
    return FINE if traj.status.code in EXPECTED else FAILED


def _admitted(key: str):
    """The registered case, unless it is foreseen to need more memory than there is."""
    from types import SimpleNamespace

    from nsbench.case.size import foreseen
    from nsbench.execute.dry_run import admit

    admit({key: foreseen(key)}, SimpleNamespace(memory=None, jobs=1))
    return get_case(key)


def check(args, say) -> int:
    """nsbench check"""
    from nsbench.cli.check import check_file

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
    keys = [_admitted(k).key for k in args.cases] or [
        k for k in study.suite_cases("full") if _has_stored(get_case(k), args.action, folder)
    ]
    options = {"build": {"kind": args.kind}, "verify": {"certify": args.certify}, "list": {}}[
        args.action
    ]
    action = {"build": ref.build, "verify": ref.verify, "list": ref.load}[args.action]
    failed = 0
    for key in keys:
        case = get_case(key)
        start = time.perf_counter()
        try:
            said = action(case, folder=folder, **options)
            took = f" ({time.perf_counter() - start:.1f} s)" if args.action != "list" else ""
            say(f"{key}: {said or 'has no stored reference'}{took}")
        except (ValueError, ArithmeticError) as e:
            failed += 1
            say(f"{key}: {e}")
    return FINE if not failed else FAILED


def _has_stored(case, action, folder) -> bool:
    """Cases of the suite to work on: those with a stored reference and, to build, those that need
    one."""
    from nsbench.reference import files_of

    return files_of(case, folder)[1].exists() or (
        action == "build" and case.exact is None and case.unique
    )


def doctor(args, say) -> int:
    """nsbench doctor"""
    from nsbench.cli.doctor import FAULT, examine

    faults = 0
    for verdict, sentence in examine():
        say(f"{verdict:<8} {sentence}")
        faults += verdict == FAULT
    say(
        "nothing stands in the way"
        if not faults
        else f"{faults} fault(s): numbers of this installation are not to be trusted"
    )
    return FINE if not faults else BROKEN

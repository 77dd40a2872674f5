"""A suite from plan to folder: what is known is reused, the rest runs in workers, then tables and
report."""

from __future__ import annotations

import contextlib
import json
import os
import re
import secrets
from collections import Counter
from itertools import chain, groupby
from pathlib import Path

import nsbench
from nsbench.case import parse_spec, size
from nsbench.compilation.disk_cache import digest, digest_of
from nsbench.execute import dry_run
from nsbench.execute.forecast import weight
from nsbench.execute.progress import EXPECTED_STATUSES, Progress
from nsbench.execute.workers.pool import Chore, run_all
from nsbench.reference import lookup
from nsbench.results import consistency, row_reuse
from nsbench.results import run_key as key
from nsbench.results import tables as store
from nsbench.results.atomic_write import write_atomically
from nsbench.results.environment import environment
from nsbench.results.journal import Journal, as_read, clean
from nsbench.results.packed_rows import OrderedRows, PackedRows
from nsbench.study import describe
from nsbench.study.attempt import lost_run_row
from nsbench.study.plan import resolve

NO_ROW = "No worker gave a row of this run. The same command tries it again."


def execute(specs, out: Path, args, say) -> int:
    """Run what is not known yet and write DIR/{journal.jsonl, runs.*, env.json, report.*,
    figures/}; the exit code."""
    key.forget()  # this process may have made keys before somebody edited a file
    cases = {(s.case, s.file): resolve(s.case, s.file) for s in specs}
    made_of = {}  # many runs are made of the same
    parts = {
        s: made_of.get(k) or made_of.setdefault(k, key.parts_of(s, cases[s.case, s.file]))
        for s in specs
        for k in [(s.case, s.file, s.solver, s.solver_files)]
    }
    keys = {s: key.key_of(s, parts[s]) for s in specs}
    _folder(out)
    for case in cases.values():
        lookup.check(case)
    dry_run.check_memory({c.key: size.size_of(c) for c in cases.values()}, args)
    if args.plan:
        known = {} if args.force else _known(out, specs, keys, args, say)
        return dry_run.tell(specs, cases, parts, keys, known, out, args, say)
    with contextlib.closing(Journal(out)) as journal:  # from here on nobody else writes there
        known = {} if args.force else _known(out, specs, keys, args, say)
        rows = PackedRows()
        todo = [s for s in specs if keys[s] not in known]
        for s in specs:
            if keys[s] in known:
                rows[keys[s]] = known[keys[s]]
        del known
        drawn = set()
        if todo:
            say(f"{len(todo)} runs ({len(specs) - len(todo)} known already), results in {out}")
            consistency.mark_stale(out)
            entries = row_reuse.RowRecorder(
                journal, keys, parts, cases, on_this_machine=args.dask is None
            )
            drawn = _run(todo, keys, entries, rows, args, say, [*cases], out)
            entries.report(say)
        ordered = OrderedRows(
            rows, (keys[s] for s in specs), lambda i: lost_run_row(specs[i], "error", NO_ROW)
        )
        path = publish(out, ordered, cases, fresh=bool(todo), say=say, drawn=drawn)
    failed = Counter(r["status"] for r in ordered if r["status"] not in EXPECTED_STATUSES)
    if failed:
        say(
            f"{failed.total()} of {len(ordered)} runs failed; the report lists each with its reason"
        )
    say(f"report: {path}")
    return 3 if failed["error"] or failed["crashed"] or failed.total() == len(ordered) else 0


def _folder(out: Path) -> None:
    """Raises ValueError if this can be no folder of results."""
    if out.exists() and not out.is_dir():
        raise ValueError(
            f"{out} is a {'link to a ' if out.is_symlink() else ''}file; a folder is needed"
        )
    if out.is_symlink() and not out.exists():
        raise ValueError(
            f"{out} is a link to {os.readlink(out)}, which does not exist; a folder is needed"
        )


def _known(out: Path, specs, keys, args, say) -> PackedRows:
    """Rows by key that need not be made again (nsbench.results.row_reuse)."""
    damaged: list[int] = []
    rows = row_reuse.reusable_rows(out, specs, keys, args.timeout, damaged)
    if damaged:
        few = ", ".join(map(str, damaged[:5])) + (", ..." if len(damaged) > 5 else "")
        say(
            f"{out / 'journal.jsonl'}: {len(damaged)} damaged line(s) left out ({few}); their "
            f"runs are made again"
        )
    return rows


def _run(todo, keys, entries, rows, args, say, cases, out):
    """The rows of `todo`; the pictures that were drawn on the way, as (case, file)."""
    session = secrets.token_hex(6)  # seconds of one session were measured side by side
    batches = [list(g) for _, g in groupby(todo, key=lambda s: (s.case, s.file))]
    batches = _in_order(batches)
    bar = Progress(len(todo), say, os.isatty(1) if _has_terminal() else False)
    outputs = Outputs(out / "output", keys)

    def on_row(spec, row):
        first = keys[spec] not in rows
        rows[keys[spec]] = row = entries.row(spec, as_read(row | {"session": session}))
        if first:
            outputs.none(spec)
            bar.step(spec.label, row["status"])

    jobs = args.jobs or min(2, os.cpu_count() or 1)
    (out / "figures").mkdir(exist_ok=True)
    try:
        if args.dask is not None:
            from nsbench.execute.cluster import client

            return {
                *client.run_all(
                    batches,
                    args.dask,
                    args.timeout,
                    on_row,
                    args.memory,
                    outputs.write,
                    entries.parts,
                )
            }
        return {
            c.args[:2]
            for c in run_all(
                batches,
                jobs,
                args.timeout,
                on_row,
                _chores(cases, out),
                most=args.memory,
                on_output=outputs.write,
            )
        }
    finally:
        bar.end()


class Outputs:
    """DIR/output/LABEL-KEY.txt: what a run has printed, if anything; nothing is left of an earlier
    one."""

    def __init__(self, folder: Path, keys: dict):
        self.folder = folder
        self.keys = keys
        self.written = set()
        self.old = {p.name for p in folder.glob("*.txt")} if folder.is_dir() else set()

    def name(self, spec) -> str:
        return (
            re.sub(r"[^A-Za-z0-9=.,+-]+", "_", spec.label)[:80].lstrip(".")
            + f"-{self.keys[spec][:12]}.txt"
        )

    def write(self, spec, text: bytes) -> None:
        self.folder.mkdir(exist_ok=True)
        write_atomically(self.folder / self.name(spec), text)
        self.written.add(spec)

    def none(self, spec) -> None:
        """The run has ended: without a word, unless something of it was written."""
        if self.old and spec not in self.written and self.name(spec) in self.old:
            (self.folder / self.name(spec)).unlink(missing_ok=True)


def _chores(cases, out):
    """What a report needs beside rows, several pictures at a time: workers that have nothing else
    to do draw them."""
    talk = [Chore(_talk, ("talk", "", str(out)))] if "sliding" in {key for key, _ in cases} else []
    return [*talk, *(Chore(_picture, (key, file, str(out / "figures"))) for key, file in cases)]


def _picture(key: str, file: str, folder: str) -> None:
    from nsbench.report.scenes.files import write_scenes

    write_scenes([resolve(key, file)], Path(folder))


def _talk(name: str, _: str, out: str) -> None:
    write_atomically(Path(out) / "extra.json", _dump({f"{name}_figure": describe.talk_figure()}))


def _in_order(batches):
    """The long ones first, so that no tail is left at the end; but before all others the longest
    one of each kind of problem, those with constraints at the head: on a new machine the workers
    then begin with different kernels. Variants of one case need the same ones, and do not follow
    one another where something else can.
    """
    order = sorted(range(len(batches)), key=lambda i: -weight(batches[i]))
    problems = [resolve(b[0].case, b[0].file).problem for b in batches]
    first: dict[tuple, int] = {}
    for i in order:
        first.setdefault(
            (not getattr(problems[i], "constraints", ()), type(problems[i]).__name__), i
        )
    head = [first[kind] for kind in sorted(first)]
    names = [parse_spec(b[0].case)[0] for b in batches]
    out = head
    rest = [i for i in order if i not in head]
    while rest:
        at = next((k for k, i in enumerate(rest) if names[i] != names[out[-1]]), 0)
        out.append(rest.pop(at))
    return [batches[i] for i in out]


def _has_terminal() -> bool:
    try:
        return os.isatty(1)
    except OSError:
        return False


def publish(out: Path, rows, cases, fresh: bool, say, drawn=frozenset()) -> Path:
    """Tables, pictures and report; nothing is written again when nothing changed. drawn: pictures
    that are there."""
    digest = digest_of(
        chain((json.dumps(clean(r), sort_keys=True).encode() for r in rows), [_report_digest()])
    )
    path = out / "report.html"
    if not fresh and path.exists() and consistency.is_consistent(out, digest):
        return path
    tables = store.write_tables(out, rows)
    meta = {s: describe.describe_solver(s) for s in dict.fromkeys(r["solver"] for r in rows)}
    write_atomically(out / "solvers.json", _dump(meta))
    write_atomically(
        out / "cases.json", _dump({k: describe.describe_case(c) for (k, _), c in cases.items()})
    )
    if fresh or not consistency.is_unmodified(out, "env.json"):
        write_atomically(out / "env.json", _dump(environment()))
    figures = out / "figures"
    figures.mkdir(exist_ok=True)
    if "sliding" not in {k for k, _ in cases}:
        write_atomically(out / "extra.json", _dump({}))
    elif ("talk", "") not in drawn:
        _talk("talk", "", out)
    missing = [c for name, c in cases.items() if name not in drawn]
    if missing:
        from nsbench.report.scenes.files import write_scenes

        write_scenes(missing, figures)
    from nsbench.report import write_report

    path = Path(write_report(out, path))
    consistency.mark_consistent(out, digest, tables)
    return path


def _report_digest() -> bytes:
    root = Path(nsbench.__file__).parent / "report"
    return digest(
        *(p.read_bytes() for p in sorted(root.rglob("*")) if p.is_file() and p.suffix != ".pyc")
    ).encode()


def _dump(value) -> bytes:
    return json.dumps(value, indent=1, default=str).encode()

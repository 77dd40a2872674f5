"""Execute a planned study: run what has no row yet, and write its folder of results.

Rows whose key is known are reused, the other runs are made by workers of this machine or of a Dask
cluster, rows are journalled as they come; then the tables, the pictures and the report are
written.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import secrets
from collections import Counter
from collections.abc import Iterable
from itertools import chain, groupby
from pathlib import Path

import nsbench
from nsbench.case import parse_spec, size
from nsbench.compilation.disk_cache import digest, digest_of
from nsbench.execute import dry_run, extended_ladders
from nsbench.execute.forecast import work
from nsbench.execute.missing_references import build_references
from nsbench.execute.notes import dump, write_notes
from nsbench.execute.progress import EXPECTED_STATUSES, Progress
from nsbench.execute.workers.pool import Chore, run_all
from nsbench.reference import lookup
from nsbench.report.data import read
from nsbench.report.overview import format_overview
from nsbench.results import consistency, row_reuse
from nsbench.results import run_key as key
from nsbench.results import tables as store
from nsbench.results.atomic_write import write_atomically
from nsbench.results.environment import start_of_runs
from nsbench.results.journal import Journal, as_read, clean
from nsbench.results.packed_rows import OrderedRows, PackedRows
from nsbench.study import Spec, describe
from nsbench.study.attempt import lost_run_row
from nsbench.study.plan import resolve
from nsbench.trajectory import NO_FAILURE

RUNS_FAILED = 3  # exit code
NOTHING_RAN = 4  # exit code
NO_ROW = "No worker gave a row of this run. The same command tries it again."


def execute(specs: list[Spec], out: Path, args, say) -> int:
    """Run what is not known yet and write the folder of results; returns the exit code.

    Writes DIR/{journal.jsonl, runs.*, env.json, cases.json, solvers.json, report.*, figures/,
    output/}. args: options of `nsbench run` (plan, force, timeout, memory, jobs, dask; with --plan
    also probe and verbose; reach and budget: see nsbench.execute.extended_ladders). Raises
    ValueError for a folder that cannot be used and for a case that needs too much memory; errors
    of results and cluster pass on.
    """
    _check_folder(out)
    build_references({(s.case, s.file, s.references) for s in specs if s.references}, args, say)
    key.forget()  # this process may have made keys before somebody edited a file
    cases = {(s.case, s.file): resolve(s.case, s.file, s.references) for s in specs}
    parts = _parts_of_all(specs, cases)
    keys = {s: key.key_of(s, parts[s]) for s in specs}
    for case in cases.values():
        lookup.check(case)
    dry_run.check_memory({c.key: size.size_of(c) for c in cases.values()}, args)
    if args.plan:
        reusable = {} if args.force else _reusable_rows(out, specs, keys, args, say)
        return dry_run.print_plan(dry_run.Plan(specs, cases, parts, keys, reusable, out), args, say)
    with contextlib.closing(Journal(out)) as journal:  # from here on nobody else writes there
        rows = PackedRows()
        began = start_of_runs(vars(args).get("argv"))
        known = parts, keys, cases, rows, began
        fresh, drawn = _complete(specs, known, journal, args, say, out)
        for _ in range(extended_ladders.ROUNDS if args.reach else 0):
            found = [as_read(rows[keys[s]]) for s in specs if keys[s] in rows]
            added = extended_ladders.further_runs(specs, found, args.reach, args.budget)
            if not added:
                break
            parts |= _parts_of_all(added, cases)
            keys |= {s: key.key_of(s, parts[s]) for s in added}
            specs = [*specs, *added]
            fresh |= _complete(added, known, journal, args, say, out)[0]
        if args.reach:
            found = [as_read(rows[keys[s]]) for s in specs if keys[s] in rows]
            for line in extended_ladders.describe_unreached(found, args.reach, args.budget):
                say(line)
        ordered = OrderedRows(
            rows, (keys[s] for s in specs), lambda i: lost_run_row(specs[i], "error", NO_ROW)
        )
        path = publish(out, ordered, cases, fresh, say, drawn, began)
    doubtful = Counter(r["status"] for r in ordered if r["status"] not in EXPECTED_STATUSES)
    if doubtful:
        failed = sum(n for status, n in doubtful.items() if status not in NO_FAILURE)
        counts = {"failed": failed, "are unverified": doubtful.total() - failed}
        said = [f"{n} of {len(ordered)} runs {what}" for what, n in counts.items() if n]
        say(f"{', '.join(said)}; the report lists each with its reason")
    for line in format_overview(read(out)):
        say(line)
    refused = all(r["status"] == "refused" for r in ordered)
    if refused:
        say("nothing ran: every method refuses; the report gives the reasons")
    say(f"report: {path}")
    unexpected = doubtful["error"] or doubtful["crashed"] or doubtful.total() == len(ordered)
    return RUNS_FAILED if unexpected else NOTHING_RAN * refused


def _complete(specs, known, journal, args, say, out) -> tuple[bool, set]:
    """Make the rows of `specs` that no earlier call has made; add all of them to the known rows.

    known: parts and keys of the specs, cases, rows by key, when runs began. Returns whether
    anything ran, and the pictures that workers have drawn meanwhile.
    """
    parts, keys, cases, rows, began = known
    reusable = {} if args.force else _reusable_rows(out, specs, keys, args, say)
    todo = [s for s in specs if keys[s] not in reusable]
    for s in specs:
        if keys[s] in reusable:
            rows[keys[s]] = reusable[keys[s]]
    if not todo:
        return False, set()
    say(f"{len(todo)} runs ({len(specs) - len(todo)} known already), results in {out}")
    consistency.mark_stale(out)
    journal.append_plan(list(keys.values()))
    write_notes(out, (s.solver for s in keys), cases, fresh=True, began=began)
    here = args.dask is None
    recorder = row_reuse.RowRecorder(journal, keys, parts, cases, on_this_machine=here)
    drawn = _run(todo, keys, recorder, rows, args, say, cases, out)
    recorder.report(say)
    return True, drawn


def _parts_of_all(specs: list[Spec], cases: dict) -> dict[Spec, tuple]:
    """Parts of the key of every run; those of one case and solver are made once."""
    shared: dict[tuple, tuple] = {}
    parts = {}
    for s in specs:
        made_of = s.case, s.file, s.solver, s.solver_files
        if made_of not in shared:
            shared[made_of] = key.parts_of(s, cases[s.case, s.file])
        parts[s] = shared[made_of]
    return parts


def _check_folder(out: Path) -> None:
    """Raise ValueError if this cannot be a folder of results."""
    if out.exists() and not out.is_dir():
        raise ValueError(
            f"{out} is a {'link to a ' if out.is_symlink() else ''}file; a folder is needed"
        )
    if out.is_symlink() and not out.exists():
        raise ValueError(
            f"{out} is a link to {os.readlink(out)}, which does not exist; a folder is needed"
        )


def _reusable_rows(out: Path, specs, keys, args, say) -> PackedRows:
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


def _run(todo, keys, recorder, rows, args, say, cases, out) -> set[tuple[str, str]]:
    """Run `todo` on workers; rows go to the recorder and to `rows`.

    Returns the pictures that idle workers have drawn meanwhile, as (case, file).
    """
    session = secrets.token_hex(6)  # seconds of one session were measured side by side
    batches = [list(g) for _, g in groupby(todo, key=lambda s: (s.case, s.file))]
    batches = order_batches(batches)
    jobs = dry_run.worker_count(args) if args.dask is None else None
    bar = Progress(todo, jobs, say, _has_terminal())
    outputs = Outputs(out / "output", keys)

    def on_row(spec: Spec, row: dict) -> None:
        recorder.add(spec, as_read(row | {"session": session}))

    def write_rows(at_once: bool = False) -> None:
        for spec, row in recorder.write(at_once):
            first = keys[spec] not in rows
            rows[keys[spec]] = row
            if first:
                outputs.remove_old(spec)
                bar.step(spec, row)

    def write_row(spec: Spec, row: dict) -> None:
        on_row(spec, row)
        write_rows(at_once=True)

    (out / "figures").mkdir(exist_ok=True)
    try:
        if jobs is None:
            from nsbench.execute.cluster import client

            client.run_all(
                batches,
                args.dask,
                args.timeout,
                write_row,
                args.memory,
                outputs.write,
                recorder.parts,
            )
            return set()
        chores_done = run_all(
            batches,
            jobs,
            args.timeout,
            on_row,
            _chores(cases, out, keys),
            memory_limit=args.memory,
            on_output=outputs.write,
            on_pause=write_rows,
            on_compile=bar.tell_compilation,
        )
        return {chore.args[:2] for chore in chores_done}
    finally:
        try:
            write_rows(at_once=True)
        finally:
            bar.end()


class Outputs:
    """Files DIR/output/LABEL-KEY.txt: what a run has printed, if anything.

    A run that prints nothing leaves no file of an earlier one with its key.
    """

    def __init__(self, folder: Path, keys: dict):
        self.folder = folder
        self.keys = keys
        self.written: set[Spec] = set()
        self.old = {p.name for p in folder.glob("*.txt")} if folder.is_dir() else set()

    def file_name(self, spec: Spec) -> str:
        """Name of the file of a run."""
        return (
            re.sub(r"[^A-Za-z0-9=.,+-]+", "_", spec.label)[:80].lstrip(".")
            + f"-{self.keys[spec][:12]}.txt"
        )

    def write(self, spec: Spec, text: bytes) -> None:
        """Store what a run has printed."""
        self.folder.mkdir(exist_ok=True)
        write_atomically(self.folder / self.file_name(spec), text)
        self.written.add(spec)

    def remove_old(self, spec: Spec) -> None:
        """Remove the file of an earlier run, now that this one has ended and printed nothing."""
        if self.old and spec not in self.written and self.file_name(spec) in self.old:
            (self.folder / self.file_name(spec)).unlink(missing_ok=True)


def _chores(cases, out, specs):
    """Pictures and players of the report, made by workers that have no runs left.

    args[:2]: case and file. specs: of the study, some of which a player shows.
    """
    asked: dict[tuple, dict] = {name: {} for name in cases}
    for s in specs:
        if s.asked > 0:  # a refused pair has none
            asked[s.case, s.file].setdefault(s.solver, []).append(s.asked)
    has_sliding = "sliding" in {name for name, _ in cases}
    talk = [Chore(_write_talk_figure, ("talk", "", str(out)))] if has_sliding else []
    figures = str(out / "figures")
    return [
        *talk,
        *(
            Chore(_draw_scene, (*name, figures, case.references, asked[name]))
            for name, case in cases.items()
        ),
    ]


def _draw_scene(key: str, file: str, folder: str, references: str, asked: dict) -> None:
    from nsbench.report.scenes.files import write_scenes

    write_scenes([resolve(key, file, references)], Path(folder), asked)


def _write_talk_figure(name: str, _: str, out: str) -> None:
    write_atomically(Path(out) / "extra.json", dump({f"{name}_figure": describe.talk_figure()}))


def order_batches(batches: list[list[Spec]]) -> list[list[Spec]]:
    """Order the batches (one case each) so that workers are busy to the end.

    The long ones come first, so that no tail is left; but before all others the longest one of each
    kind of problem, those with constraints at the head: on a new machine the workers then begin
    with different kernels. Variants of one case need the same kernels, and do not follow one
    another where something else can.
    """
    weights = [sum(map(work, batch)) for batch in batches]
    longest_first = sorted(range(len(batches)), key=lambda i: -weights[i])
    problems = [resolve(b[0].case, b[0].file, b[0].references).problem for b in batches]
    longest_of_kind: dict[tuple, int] = {}
    for i in longest_first:
        without_constraints = not getattr(problems[i], "constraints", ())
        kind = without_constraints, type(problems[i]).__name__
        longest_of_kind.setdefault(kind, i)
    order = [longest_of_kind[kind] for kind in sorted(longest_of_kind)]
    rest = [i for i in longest_first if i not in order]
    names = [parse_spec(b[0].case)[0] for b in batches]
    while rest:
        other = next((k for k, i in enumerate(rest) if names[i] != names[order[-1]]), 0)
        order.append(rest.pop(other))
    return [batches[i] for i in order]


def _has_terminal() -> bool:
    """Is standard output a terminal? (Its descriptor may be closed.)"""
    try:
        return os.isatty(1)
    except OSError:
        return False


def publish(
    out: Path, rows: Iterable[dict], cases: dict, fresh: bool, say, drawn=frozenset(), began=None
) -> Path:
    """Write tables, pictures and report; returns the path of the report.

    Nothing is written again when nothing has changed. fresh: there are new rows; drawn: pictures
    that were drawn by workers, as (case, file). began: as for `write_notes`.
    """
    contents = digest_of(
        chain((json.dumps(clean(r), sort_keys=True).encode() for r in rows), [_report_digest()])
    )
    path = out / "report.html"
    if not fresh and path.exists() and consistency.is_consistent(out, contents):
        return path
    tables = store.write_tables(out, rows)
    write_notes(out, (r["solver"] for r in rows), cases, fresh, began)
    figures = out / "figures"
    figures.mkdir(exist_ok=True)
    if "sliding" not in {k for k, _ in cases}:
        write_atomically(out / "extra.json", dump({}))
    elif ("talk", "") not in drawn:
        _write_talk_figure("talk", "", out)
    not_drawn = [c for name, c in cases.items() if name not in drawn]
    if not_drawn:
        from nsbench.report.scenes.files import write_scenes

        write_scenes(not_drawn, figures)
    from nsbench.report import write_report

    path = Path(write_report(out, path))
    consistency.mark_consistent(out, contents, tables)
    return path


def _report_digest() -> bytes:
    """Digest of the code of the report: another one makes a report that is out of date."""
    root = Path(nsbench.__file__).parent / "report"
    return digest(
        *(p.read_bytes() for p in sorted(root.rglob("*")) if p.is_file() and p.suffix != ".pyc")
    ).encode()

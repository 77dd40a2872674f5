"""A cluster against this machine: the same rows, bounded memory here, and what it costs; five parts
that run alone.

    python tests/studies/cluster.py rows [CASE ...] [--suite standard]     here and on 2 workers,
    one of them killed midway
    python tests/studies/cluster.py memory [--runs 100000]       the client's memory while so many
    tiny runs come in
    python tests/studies/cluster.py whole [--runs 100000]        the same of all that `nsbench run
    --dask` does, tables and report
    python tests/studies/cluster.py overhead [--runs 10000]      processor time and seconds per run
    beyond the run itself
    python tests/studies/cluster.py efficiency [--runs 10000]    2 workers against 1, in turns

Tiny runs are PBD on DROP, a case file whose three samples are soon measured, with as many different
steps; long ones (a twentieth as many) PBD on the tide with steps of 2e-5 to 4e-5. The journal is
written and synced as in `nsbench run`. Exit status 1 if a row differs, or if the client's memory
grows with the number of runs (by more than GROWTH from a tenth of them to all of them; of the whole
command, by more than A_RUN per run). Seconds are told with the load of the machine: beside other
work they say little, processor time and ratios in turns somewhat more.
"""

import argparse
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
from local_cluster import cluster

from nsbench import columns
from nsbench.execute import suite
from nsbench.execute.cluster import client as far
from nsbench.results import row_reuse
from nsbench.results.journal import Journal, read_journal
from nsbench.study import Spec
from nsbench.study.attempt import run_one

GROWTH = 16e6  # bytes: a few tasks of MOST rows
A_RUN = 2e3  # bytes: its row, packed, its key and what was asked for
ROUNDS = 3
LONG = 2e-5  # step of the runs of some 10 ms
DROP = '''
"""Drop: a point that falls on the floor, looked at three times."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    return lambda t, y: -xp.ones_like(y)


CASE = Case(name="drop", problem=Complementarity(drift, (Affine(A=np.eye(1), b=np.zeros(1)),)), x0=np.array([0.5]),
            t=np.linspace(0.0, 1.0, 3), exact=lambda t: np.maximum(0.5 - t, 0.0)[:, None],
            exact_impulse=lambda t: np.maximum(t - 0.5, 0.0)[:, None])
'''
TICKS = os.sysconf("SC_CLK_TCK")


def tiny(runs, folder):
    file = Path(folder) / "drop.py"
    file.write_text(DROP)
    return (
        Spec("drop", "pbd", "h", 0.05 * (0.2 + 0.8 * (i + 1) / runs), str(file))
        for i in range(runs)
    )


def long(runs, folder):
    return (Spec("tide", "pbd", "h", LONG * (1 + i / runs)) for i in range(runs))


def load():
    return "load " + " ".join(f"{v:.1f}" for v in os.getloadavg())


def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def spent(top):
    """Seconds of processor time of a process and all below it, the ended ones that were waited for
    included."""
    used = {}
    below = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            head, _, tail = stat.read_text().rpartition(")")
        except OSError:
            continue
        pid = int(head.split()[0])
        fields = tail.split()
        used[pid] = sum(map(int, fields[11:15])) / TICKS  # utime, stime, and those of children
        below.setdefault(int(fields[1]), []).append(pid)
    total = 0.0
    todo = [top]
    while todo:
        pid = todo.pop()
        total += used.get(pid, 0.0)
        todo += below.get(pid, [])
    return total


def send(specs, address, folder, on_count=lambda n: None):
    """Seconds for all rows to be in the journal."""
    journal = Journal(Path(folder))
    count = [0]
    start = time.perf_counter()

    def on_row(spec, row):
        if row["status"] not in ("ok", "below_reference"):
            sys.exit(f"{spec.label}: {row['status']}: {row['why']}")
        journal.append(spec.label, row)
        count[0] += 1
        on_count(count[0])

    try:
        far.run_all([specs], address, 120.0, on_row)
    finally:
        journal.close()
    return time.perf_counter() - start


def rows(args):
    """The whole command on both sides, and their journals held against one another."""
    with tempfile.TemporaryDirectory() as folder, cluster(2) as (address, _):
        here = Path(folder) / "here"
        there = Path(folder) / "there"
        command = [sys.executable, "-m", "nsbench", "run", "--suite", args.suite, *args.cases]
        print(f"{load()}; here")
        subprocess.run([*command, "-o", str(here)], stdout=subprocess.DEVNULL)
        expected = read_journal(here)
        print(f"{len(expected)} rows here; {load()}; on the cluster")
        victim = worker_pids(address)[0]
        run = subprocess.Popen(
            [*command, "--dask", address, "-o", str(there)], stdout=subprocess.DEVNULL
        )
        while run.poll() is None and len(read_journal(there)) < len(expected) // 2:
            time.sleep(1.0)
        os.kill(victim, signal.SIGKILL)
        at = len(read_journal(there))
        run.wait()
        found = read_journal(there)
        replaced = victim not in worker_pids(address)
    differ = [k for k in expected if plain(found.get(k, {})) != plain(expected[k])]
    for k in differ[:20]:
        a = plain(expected[k])
        b = plain(found.get(k, {}))
        print(
            "  differs:",
            a["case"],
            a["solver"],
            a["asked"],
            *(f"{n}: {a.get(n)} {b.get(n)}" for n in a if a[n] != b.get(n)),
        )
    print(
        f"worker {victim} killed after {at} rows, {'replaced' if replaced else 'not replaced'}; "
        f"{len(found)} rows, "
        f"{len(differ)} differ, {len(found.keys() - expected.keys())} too many; {load()}"
    )
    return bool(differ) or found.keys() != expected.keys()


def plain(row):
    return {k: repr(v) for k, v in row.items() if k not in columns.names("clock")}


def worker_pids(address):
    with far.connect_client(address) as client:
        return [*client.run(os.getpid).values()]


def memory(args):
    """The client is a process of its own: what the cluster needs here is not its memory."""
    with tempfile.TemporaryDirectory() as folder, cluster(2) as (address, _):
        return subprocess.run(
            [
                sys.executable,
                __file__,
                "client",
                "--runs",
                str(args.runs),
                "--address",
                address,
                "--folder",
                folder,
            ]
        ).returncode


def client(args):
    marks = {args.runs: 0, args.runs // 10: 0} | {
        n: 0 for n in (1000, 10_000, 100_000) if n < args.runs
    }

    def on_count(n):
        if n in marks:
            marks[n] = resident()
            print(
                f"{n:>8} runs: {marks[n] / 1e6:.1f} MB resident, "
                f"{time.perf_counter() - start:.0f} s",
                flush=True,
            )

    print(f"       0 runs: {resident() / 1e6:.1f} MB resident; {load()}", flush=True)
    start = time.perf_counter()
    seconds = send(tiny(args.runs, args.folder), args.address, args.folder, on_count)
    grown = marks[args.runs] - marks[args.runs // 10]
    size = (Path(args.folder) / "journal.jsonl").stat().st_size
    print(
        f"{seconds:.0f} s, {1e3 * seconds / args.runs:.2f} ms a run; the last nine tenths added "
        f"{grown / 1e6:.1f} MB; the "
        f"journal is {size / 1e6:.0f} MB; {load()}"
    )
    return grown > GROWTH


def whole(args):
    """The command's own process: rows are kept until tables are written, and all of them are
    reported."""
    with tempfile.TemporaryDirectory() as folder, cluster(2) as (address, _):
        return subprocess.run(
            [
                sys.executable,
                __file__,
                "command",
                "--runs",
                str(args.runs),
                "--address",
                address,
                "--folder",
                folder,
            ]
        ).returncode


def command(args):
    marks = {args.runs // 10: 0, args.runs: 0}
    count = [0]
    plain = row_reuse.RowRecorder.add

    def add(entries, spec, found):
        count[0] += 1
        if count[0] in marks:
            marks[count[0]] = resident()
            print(
                f"{count[0]:>8} runs: {resident() / 1e6:.1f} MB resident, "
                f"{time.perf_counter() - start:.0f} s",
                flush=True,
            )
        return plain(entries, spec, found)

    row_reuse.RowRecorder.add = add
    print(f"       0 runs: {resident() / 1e6:.1f} MB resident; {load()}", flush=True)
    start = time.perf_counter()
    given = argparse.Namespace(
        plan=False, force=False, timeout=120.0, memory=None, jobs=None, dask=args.address
    )
    specs = [*tiny(args.runs, args.folder)]
    print(f"{resident() / 1e6:.1f} MB with what is asked for", flush=True)
    status = suite.execute(specs, Path(args.folder) / "results", given, lambda *words, **how: None)
    grown = (marks[args.runs] - marks[args.runs // 10]) / (0.9 * args.runs)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    print(
        f"exit {status} after {time.perf_counter() - start:.0f} s; {grown:.0f} bytes more for "
        f"each run; {peak / 1e6:.0f} MB at "
        f"the most, tables and report included; {load()}"
    )
    return status or grown > A_RUN


def overhead(args):
    """Processor time of client, scheduler, workers and their children, per run, beyond that of the
    runs themselves."""
    for name, make, runs in (("tiny", tiny, args.runs), ("long", long, args.runs // 20)):
        with tempfile.TemporaryDirectory() as folder, cluster(1) as (address, process):
            some = [*make(runs, folder)][:: max(1, runs // 500)]
            run_one(some[0])
            start = time.perf_counter()
            cpu = time.process_time()
            for spec in some:
                run_one(spec)
            alone, cpu_alone = (
                (b - a) / len(some)
                for a, b in ((start, time.perf_counter()), (cpu, time.process_time()))
            )
            send(make(50, folder), address, folder)  # workers are warm
            cpu = spent(process.pid) + time.process_time()
            seconds = send(make(runs, folder), address, folder) / runs
            cpu = (spent(process.pid) + time.process_time() - cpu) / runs
        print(
            f"{name}: {1e3 * cpu_alone:.3f} ms of processor time alone, {1e3 * cpu:.3f} by a "
            f"cluster of 1: "
            f"{1e3 * (cpu - cpu_alone):.3f} ms more a run; by the clock {1e3 * alone:.3f} and "
            f"{1e3 * seconds:.3f}; {load()}",
            flush=True,
        )
    return 0


def efficiency(args):
    """Seconds of 1 worker over twice those of 2, in turns; both clusters stand the whole time."""
    for name, make, runs in (("tiny", tiny, args.runs), ("long", long, args.runs // 20)):
        with (
            tempfile.TemporaryDirectory() as folder,
            cluster(1) as (one, _),
            cluster(2) as (two, _),
        ):
            for address in (one, two):
                send(make(50, folder), address, folder)
            for turn in range(ROUNDS):
                took = {
                    address: send(make(runs, folder), address, folder)
                    for address in ((one, two) if turn % 2 else (two, one))
                }
                print(
                    f"{name}: {runs} runs by 1 worker {took[one]:.1f} s, by 2 workers "
                    f"{took[two]:.1f} s: efficiency "
                    f"{took[one] / took[two] / 2:.2f}; {load()}",
                    flush=True,
                )
    return 0


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "part", choices=("rows", "memory", "whole", "overhead", "efficiency", "client", "command")
    )
    parser.add_argument("cases", nargs="*", help="rows: these cases instead of the suite")
    parser.add_argument("--suite", default="standard")
    parser.add_argument("--runs", type=int)
    parser.add_argument("--address")
    parser.add_argument("--folder")
    given = parser.parse_args()
    given.runs = given.runs or (10_000 if given.part in ("overhead", "efficiency") else 100_000)
    sys.exit(globals()[given.part](given))

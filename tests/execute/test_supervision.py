"""Whatever a run does to its worker, it is a row with a sentence, in time, and the others go on."""

import itertools
import os
import time
from pathlib import Path

import pytest
from solver_file import solver

from nsbench.execute.workers import memory, pool
from nsbench.execute.workers.pool import run_all
from nsbench.execute.workers.process import THREADS
from nsbench.study import Spec

SOLVER = solver(
    """
    if self.how in ("sleep", "regex"):
        open(os.path.join(os.path.dirname(__file__), self.how), "w").write(repr(time.time()))
    if self.how == "sleep":
        ctypes.PyDLL(None).sleep(1000)                       # in C, with the interpreter's lock
    if self.how == "regex":
        re.match(r"(a+)+$", "a" * 60 + "b")
    if self.how == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    if self.how == "segfault":
        ctypes.string_at(0)
    if self.how == "close":
        os.closerange(0, 100)
        time.sleep(1000)
    if self.how == "fork":                                   # a child that holds everything open
        child = os.fork()
        if child == 0:
            time.sleep(1000)
        open(os.path.join(os.path.dirname(__file__), self.how), "w").write(str(child))
        os._exit(9)
    if self.how == "grow":
        kept = []
        while True:
            kept.append(np.ones(1 << 23))
    # what it has started grows, itself it does not
    if self.how == "child":
        import subprocess
        subprocess.run([sys.executable, "-c", "import time; kept = bytearray(3 << 29); time.sleep(20)"])
    # children that hold what it holds hold nothing more
    if self.how == "shared":
        kept = np.ones(1 << 26)
        for _ in range(3):
            if os.fork() == 0:
                time.sleep(1000)
        time.sleep(2.5)
    if self.how == "huge":
        np.ones(1 << 48)
    if self.how == "xla":
        raise RuntimeError("RESOURCE_EXHAUSTED: Out of memory while trying to allocate 9 bytes.")
    if self.how == "alloc":
        os.write(2, b"terminate called after throwing an instance of 'std::bad_alloc'" + bytes([10]))
        os.abort()
    if self.how == "print":
        ctypes.CDLL(None).puts(b"from C " + bytes([27]) + b"[2J")
        print("from Python")
        os.system("echo from a child")
        for _ in range(3):
            warnings.warn("careful")
        np.log(np.zeros(1))
    if self.how == "flood":
        for _ in range(300):
            print("x" * 1000)
""",
    before="""
class Odd(float):
    'A number that only this file knows.'

""",
    stats='{"odd": Odd(2.5)}',
)


def rows_of(tmp_path, *hows, batches=1, jobs=1, timeout=30.0, memory_limit=4 << 30):
    """(rows, what they printed, when they came), each by what the run does; pbd comes last.

    batches: the runs are dealt out to so many, each of a solver of its own: workers prepare runs
    of one solver one after another."""
    files = [tmp_path / f"bad{k or ''}.py" for k in range(batches)]
    for file in files:
        file.write_text(SOLVER)
    specs = []
    for how, file in zip(hows, itertools.cycle(files), strict=False):
        specs.append(Spec("tide", f"{file.stem}[how={how}]", "h", 0.01, "", (str(file),)))
    names = {s: how for s, how in zip(specs, hows, strict=True)}
    rows = {}
    outputs = {}
    times = {}

    def on_row(spec, row):
        times.setdefault(names.get(spec, "pbd"), time.time())
        rows[names.get(spec, "pbd")] = row

    def on_output(spec, text):
        outputs[names[spec]] = text.decode()

    run_all(
        [*(specs[k::batches] for k in range(batches)), [Spec("tide", "pbd", "h", 0.01)]],
        jobs,
        timeout,
        on_row,
        memory_limit=memory_limit,
        on_output=on_output,
    )
    return rows, outputs, times


@pytest.mark.long
@pytest.mark.survives("hang")
def test_a_run_stuck_in_c_is_a_timeout_row_within_four_seconds_of_its_start(tmp_path):
    rows, _, times = rows_of(tmp_path, "sleep", "regex", "fine", jobs=2, timeout=2.0)
    for how in ("sleep", "regex"):
        assert (
            rows[how]["status"] == "timeout"
            and "2 s" in rows[how]["why"]
            and rows[how]["limit"] == 2.0
        )
        assert 1.9 < times[how] - float((tmp_path / how).read_text()) < 4.0
    assert rows["fine"]["status"] == rows["pbd"]["status"] == "ok"


@pytest.mark.long
@pytest.mark.survives("hang")
def test_a_preparation_stuck_in_c_has_a_limit_of_its_own(tmp_path, monkeypatch):
    """Where a method prepares, and where it is asked what it refuses."""
    monkeypatch.setattr(
        pool, "PREPARATION_LIMIT", 8.0
    )  # two workers begin within it on a busy machine too
    stuck = SOLVER
    for where in ("    def prepare(self, case, h):", "    def refuses(self, case):"):
        name = where.split()[1].split("(")[0]
        sleeps = f"        if self.how == '{name}':\n            ctypes.PyDLL(None).sleep(1000)"
        stuck = stuck.replace(where, f"{where}\n{sleeps}")
    monkeypatch.setitem(globals(), "SOLVER", stuck)
    hows = ("prepare", "refuses", "fine", "fine2")
    rows, _, _ = rows_of(tmp_path, *hows, batches=2, jobs=2, timeout=2.0)
    for name in hows[:2]:
        assert rows[name]["status"] == "timeout" and "10 s (prepare)" in rows[name]["why"]
    assert [rows[how]["status"] for how in (*hows[2:], "pbd")] == ["ok"] * 3


@pytest.mark.long
@pytest.mark.survives("death")
@pytest.mark.skipif(os.name != "posix", reason="signals and descriptors of POSIX")
def test_a_worker_that_dies_or_closes_everything_is_a_crashed_row(tmp_path):
    rows, outputs, _ = rows_of(tmp_path, "kill", "segfault", "close", "fork", "fine")
    assert {how: row["status"] for how, row in rows.items()} == {
        "kill": "crashed",
        "segfault": "crashed",
        "close": "crashed",
        "fork": "crashed",
        "fine": "ok",
        "pbd": "ok",
    }
    assert (
        "SIGKILL" in rows["kill"]["why"]
        and "SIGSEGV" in rows["segfault"]["why"]
        and "code 9" in rows["fork"]["why"]
    )
    assert "closed its pipe" in rows["close"]["why"]
    assert (
        "Segmentation fault" in rows["segfault"]["why"] and 'bad.py", line' in outputs["segfault"]
    )
    child = int((tmp_path / "fork").read_text())
    status = f"/proc/{child}/status"
    if os.path.isdir("/proc/self"):  # what a run has started is stopped with it
        assert not os.path.exists(status) or "State:\tZ" in Path(status).read_text()


@pytest.mark.long
@pytest.mark.survives("memory")
@pytest.mark.skipif(
    not memory.resident_memory(os.getpid()), reason="the system does not tell what a process holds"
)
def test_memory_that_is_not_to_be_had_is_an_oom_row(tmp_path):
    rows, _, _ = rows_of(tmp_path, "fine", "grow", "huge", "xla", "alloc", memory_limit=1 << 30)
    assert {how: row["status"] for how, row in rows.items()} == {
        "fine": "ok",
        "grow": "oom",
        "huge": "oom",
        "xla": "oom",
        "alloc": "oom",
        "pbd": "ok",
    }
    assert "its limit is 1.0 GiB" in rows["grow"]["why"] and "bad_alloc" in rows["alloc"]["why"]


@pytest.mark.long
@pytest.mark.survives("memory")
@pytest.mark.skipif(
    not memory.resident_memory(os.getpid(), [os.getppid()]),
    reason="the system does not tell what processes share",
)
def test_what_a_run_has_started_counts_and_what_they_share_counts_once(tmp_path):
    rows, _, _ = rows_of(tmp_path, "child", "shared", "fine", memory_limit=5 << 28)
    assert [rows[how]["status"] for how in ("child", "shared", "fine")] == ["oom", "ok", "ok"], rows
    assert "The worker and what it has started held 1." in rows["child"]["why"]


@pytest.mark.long
@pytest.mark.survives("output of a run", "warnings")
def test_what_a_run_prints_is_kept_with_it_and_bounded(tmp_path, capfd):
    rows, outputs, _ = rows_of(tmp_path, "fine", "print", "flood")
    assert [rows[how]["status"] for how in ("fine", "print", "flood")] == ["ok"] * 3
    assert [rows[how]["warnings"] for how in ("fine", "print", "flood", "pbd")] == [0, 2, 0, 0]
    for text in ("from C", "from Python", "from a child", "UserWarning: careful", "divide by zero"):
        assert text in outputs["print"]
    assert (
        set(outputs) == {"print", "flood"}
        and 60_000 < len(outputs["flood"]) < 70_000
        and "left out" in outputs["flood"]
    )
    seen = capfd.readouterr()
    assert seen.out == seen.err == ""  # the terminal is the parent's alone
    assert type(rows["print"]["odd"]) is float  # and no type of a solver's file comes to the parent


def test_a_worker_killed_by_the_system_for_memory_is_told_from_one_that_was_killed(monkeypatch):
    from nsbench.execute.workers.pool import WorkerPool
    from nsbench.execute.workers.process import Worker

    class Gone:
        # of no process
        exitcode = -9
        pid = 2**22 + 1

        def kill(self):
            pass

    class Printed:
        def take(self, i):
            return b""

        def close(self):
            pass

    def row(peak, kills, printed=Printed()):
        spec = Spec("tide", "pbd", "h", 0.1)
        rows = []
        job = Worker(
            Gone(),
            Printed(),
            printed,
            specs=[spec],
            missing={0},
            index=0,
            phase="run",
            peak_memory=peak,
            runs_begun=1,
        )
        monkeypatch.setattr(memory, "count_oom_kills", lambda: kills)
        team = WorkerPool(
            [], None, lambda s, r: rows.append(r), lambda s, t: None, 1, 1000, busy=[job]
        )
        team.handle_death(job)
        return rows[0]

    assert [row(100, 0)["status"], row(900, 0)["status"], row(100, 1)["status"]] == [
        "crashed",
        "oom",
        "oom",
    ]


def test_a_run_that_followed_others_is_tried_alone_before_its_memory_is_blamed():
    from nsbench.execute.workers.pool import WorkerPool
    from nsbench.execute.workers.process import Worker

    spec = Spec("tide", "pbd", "h", 0.1)
    rows = []

    class Pipe:
        def close(self):
            pass

        def take(self, i):
            return b""

    team = WorkerPool([], None, lambda s, r: rows.append(r), lambda s, t: None, 1, 1000)
    for _ in range(2):
        job = Worker(None, Pipe(), Pipe(), specs=[spec], missing={0}, index=0, runs_begun=5)
        team.busy = [job]
        team.record_memory_excess(job, "too large")
        if not rows:
            assert team.queue_alone == [[spec]] and not team.queue
    assert [r["status"] for r in rows] == ["oom"]


def test_the_limit_of_memory_is_a_share_of_what_there_is(tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "total_memory", lambda: 64 << 30)
    assert memory.worker_limit(4) == int(0.8 * (64 << 30) / 4)
    monkeypatch.setattr(memory, "total_memory", lambda: 1 << 30)
    assert memory.worker_limit(4) == memory.SMALLEST_LIMIT
    assert memory.parse_size("1.5 GiB") == 3 << 29 and memory.parse_size("800M") == 800 << 20
    for text in ("4 parsecs", "-1G", "", "nan", "3"):
        with pytest.raises(ValueError, match="--memory"):
            memory.parse_size(text)


def test_the_limit_of_a_container_is_heeded(tmp_path, monkeypatch):
    machine = memory.total_memory()
    (tmp_path / "memory.max").write_text("max\n")
    monkeypatch.setattr(memory, "_control_groups", lambda: iter([tmp_path]))
    assert memory.total_memory() >= machine
    (tmp_path / "memory.max").write_text(f"{1 << 29}\n")
    assert memory.total_memory() == 1 << 29


@pytest.mark.long
@pytest.mark.survives("threads")
@pytest.mark.parametrize("threads", [1, 2])
def test_every_library_of_a_worker_has_the_threads_it_is_given(tmp_path, threads):
    file = tmp_path / "bad.py"
    file.write_text(
        SOLVER.replace(
            "k = len(case.t)",
            """k = len(case.t)
            import numba
            print(*(os.environ[n] for n in THREADS), numba.get_num_threads())""",
        ).replace(
            "import ctypes", "from nsbench.execute.workers.process import THREADS; import ctypes"
        )
    )
    said = []
    run_all(
        [[Spec("tide", "bad", "h", 0.01, "", (str(file),))]],
        1,
        30.0,
        lambda s, r: None,
        threads=threads,
        on_output=lambda s, text: said.append(text.split()),
    )
    assert set(said[0]) == {str(threads).encode()} and len(said[0]) == 1 + len(THREADS)


def test_each_run_gets_what_it_printed_however_the_pipe_cuts_it():
    from nsbench.execute.workers.output_capture import OutputCapture, mark

    ours, theirs = os.pipe()
    text = (
        b"before"
        + mark(b"word", 3)
        + b"of \0 three\0wor"
        + mark(b"word", -1)
        + b"again"
        + mark(b"word", 14)
        + b"of 14"
    )

    class End:
        def fileno(self):
            return ours

    for size in (1, 2, 7, 1000):
        printed = OutputCapture(End(), b"word")
        for k in range(0, len(text), size):
            os.write(theirs, text[k : k + size])
            printed.drain()
        assert printed.take(3) == b"of \0 three\0wor" and printed.take(14) == b"of 14"
        assert printed.take(-1) == b"beforeagain" and printed.take(3) == b""

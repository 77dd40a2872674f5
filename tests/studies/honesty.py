"""Thousands of random scenes by every method that takes them: is what says ok true, does nothing
crash, does all come to an end?

    python tests/studies/honesty.py --runs 10000 --seed 0 [-j 2] [-o FOLDER] [--family F ...]
    [--solver S ...] python tests/studies/honesty.py --show 17 [--shrink SPEC]

Scene number i of a seed is a case file drawn from the families of tests/randomised (degenerate on
purpose); each is run by event_driven, a second integrator of it, and some of the methods that
accept it, and judged as tests/randomised/judge.py says.
Each (scene, method) is one run. Workers are killed when a run takes more than --limit seconds of
CPU time (a hang), and replaced when they die (a crash). With -o, lines are kept in
FOLDER/rows.jsonl, scenes that have one are not run again, and the case file of whatever was wrong,
crashed or hung lies beside it. Prints counts by family, method and status; the exit status is 1 if
anything was silently wrong, crashed or hung.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import multiprocessing as mp
import os
import re
import sys
import tempfile
import time
from collections import Counter, defaultdict
from multiprocessing.connection import wait
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np  # noqa: E402
from randomised.choices import drawn, replayed, shrunk  # noqa: E402
from randomised.scenes import FAMILIES, scene  # noqa: E402

BAD = ("wrong", "crash", "hang")
LIVES = 80  # scenes of a worker: what it compiled stays in its memory
# methods beside event_driven, and how often each is drawn: those that compile for seconds are drawn
# less
METHODS = {
    "pbd": 3,
    "pbd[order=reverse]": 2,
    "pbd[order=random,seed=1]": 2,
    "pbd[order=cell]": 2,
    "pbd[order=coloured]": 2,
    "pbd[sweeps=3]": 2,
    "catching_up": 3,
    "catching_up[backend=osqp]": 0.5,
    "catching_up[backend=piqp]": 0.5,
    "catching_up[nonlinear=true]": 1,
    "euler": 4,
    "euler[implicit=true]": 4,
    "theta": 4,
    "theta[theta=0.5]": 3,
    "richardson": 2,
    "richardson[method=catching_up]": 1,
    "richardson[levels=3]": 1,
    "kdtree": 2,
    "kdtree[sweep=numpy]": 1,
    "penalty": 0.4,
    "penalty[method=kvaerno5]": 0.3,
    "penalty[extrapolate=1]": 0.3,
    "pbd_jax": 0.25,
    "nosnoc": 0.15,
    "event_driven[compiled=false,max_steps=500]": 0.5,
    "solve_ivp": 0.1,
}  # of up to 70 ms each
MORE = 8  # methods of a scene beside event_driven and its second


def family_of(i: int, families) -> str:
    return families[i % len(families)]


def choices(seed: int, i: int):
    return drawn(np.random.default_rng([seed, i]))


def chosen(case, seed: int, i: int, solvers_) -> list[str]:
    """The methods of scene i: event_driven, its second, and some of the others that take it."""
    from randomised.answer import SECOND

    from nsbench import solvers

    rng = np.random.default_rng([seed, i, 1])
    takers = [s for s in (solvers_ or METHODS) if not solvers.get(s).refuses(case)]
    w = np.array([METHODS.get(s, 1.0) for s in takers])
    picked = (
        rng.choice(len(takers), min(MORE, len(takers)), replace=False, p=w / w.sum())
        if takers
        else []
    )
    return ["event_driven", SECOND[i % len(SECOND)][0], *(takers[k] for k in sorted(picked))]


def loaded(text: str, folder: Path):
    from nsbench.case import load_case

    path = folder / f"scene_{os.getpid()}.py"
    path.write_text(text, encoding="utf-8")
    return load_case(path)


def worker(pipe, seed, families, solvers_) -> None:
    """Scenes in: (index, methods done, answered); out: ("on", method), ("row", ...), ("done",)."""
    from randomised.judge import Scene, Verdict

    folder = Path(tempfile.mkdtemp(prefix="honesty-"))
    while (task := pipe.recv()) is not None:
        i, done, answered = task
        pipe.send(("on", "loading"))
        try:
            case = loaded(scene(choices(seed, i), family_of(i, families)), folder)
        except ValueError as e:
            pipe.send(("row", "loading", Verdict("told", "border", str(e)), 0.0))
            pipe.send(("done",))
            continue
        judged = Scene(case, i, answered)
        for spec in chosen(case, seed, i, solvers_):
            if spec in done:
                continue
            pipe.send(("on", spec))
            start = time.process_time()
            pipe.send(("row", spec, judged.judge(spec), time.process_time() - start))
        pipe.send(("done",))


class Worker:
    """One process at work on a scene, and what it has told."""

    def __init__(self, args):
        ours, theirs = mp.Pipe()
        self.process = mp.Process(target=worker, args=(theirs, *args), daemon=True)
        self.pipe = ours
        self.lives = LIVES
        self.process.start()
        theirs.close()
        self.index = -1
        self.rows = {}
        self.on = ""
        self.since = 0.0
        self.answered = True

    def give(self, i: int, rows: dict, answered: bool = True):
        self.index = i
        self.rows = rows
        self.answered = answered
        self.lives = self.lives - 1
        self.on = ""
        self.since = self.cpu()
        self.pipe.send((i, list(rows), answered))

    def cpu(self) -> float:
        """Seconds of CPU time it has taken."""
        try:
            fields = Path(f"/proc/{self.process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        except OSError:
            return 0.0
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def listen(self) -> bool:
        """Takes one message; True when the scene is done. EOFError from a process that died."""
        what, *rest = self.pipe.recv()
        if what == "row":
            spec, v, seconds = rest
            self.rows[spec] = (v.word, v.status, v.why, round(seconds, 2))
        self.since = self.cpu()
        self.on = rest[0] if what == "on" else ""
        return what == "done"

    def end(self):
        self.process.kill()
        self.process.join()
        self.pipe.close()


def run(o, families, done: set[int], keep) -> None:
    """Scenes one after the other until there are as many runs as asked for; keep(index, rows)
    each."""
    mp.set_start_method("spawn", force=True)
    args = (o.seed, families, o.solver)
    count = o.count
    following = iter(range(10**9))
    crew = []

    def nextup():
        return next(i for i in following if i not in done)

    try:
        while count < o.runs or crew:
            while len(crew) < o.j and count < o.runs:
                crew.append(Worker(args))
                crew[-1].give(nextup(), {})
            for pipe in wait([w.pipe for w in crew], 0.5):
                w = next(w for w in crew if w.pipe is pipe)
                crew.remove(w)
                try:
                    over = w.listen()
                except (EOFError, ConnectionResetError):
                    crew.append(
                        _after(
                            w, args, "crash", f"the worker died with exit code {w.process.exitcode}"
                        )
                    )
                    continue
                if not over:
                    crew.append(w)
                    continue
                count += sum(row[0] != "refused" for row in w.rows.values())
                keep(w.index, w.rows)
                if count >= o.runs or w.lives <= 0:
                    w.end()
                else:
                    w.give(nextup(), {})
                    crew.append(w)
            for w in [w for w in crew if w.cpu() - w.since > o.limit]:
                crew.remove(w)
                crew.append(_after(w, args, "hang", f"no end within {o.limit:g} s of CPU time"))
    finally:
        for w in crew:
            w.end()


def _after(w: Worker, args, word: str, why: str) -> Worker:
    """Another worker for the rest of the scene of one that died or was late."""
    w.end()
    fresh = Worker(args)
    rows = w.rows | {w.on or "loading": (word, "", why, 0.0)}
    fresh.give(w.index, rows, w.answered and w.on != "event_driven")
    return fresh


def table(lines, families) -> str:
    """Counts of statuses and words by family and method."""
    status = defaultdict(Counter)
    words = defaultdict(Counter)
    for i, rows in lines:
        for spec, (word, code, *_) in rows.items():
            key = family_of(i, families), re.sub(r",max_steps=\d+", "", spec)
            words[key][word] += 1
            status[key][code or word] += 1
    shown = ("fine", "own", "slow", "open", *BAD)
    out = [
        f"{'family':8s} {'method':32s} {'runs':>5s}  "
        + " ".join(f"{w:>6s}" for w in shown)
        + "  statuses"
    ]
    for key in sorted(words):
        w = words[key]
        out.append(
            f"{key[0]:8s} {key[1]:32s} {sum(w.values()):5d}  "
            + " ".join(f"{w[k]:6d}" for k in shown)
            + "  "
            + " ".join(f"{k} {v}" for k, v in status[key].most_common())
        )
    return "\n".join(out)


def tell(i, rows, seed, families, folder):
    """Says what is bad, and keeps its case file."""
    for spec, (word, _, why, seconds) in rows.items():
        if word not in BAD and not (word == "slow" and "-v" in sys.argv):
            continue
        print(
            f"{word:6s} scene {i} {family_of(i, families)} {spec}: {why} ({seconds} s)", flush=True
        )
        if folder and word in BAD:
            text = scene(choices(seed, i), family_of(i, families))
            (folder / f"scene_{seed}_{i}.py").write_text(text, encoding="utf-8")


def show(o, families) -> int:
    """Judges one scene by all methods, here; or shrinks it while `spec` stays bad."""
    from randomised.judge import Scene

    from nsbench import solvers

    folder = Path(tempfile.mkdtemp(prefix="honesty-"))
    i = o.show
    made = choices(o.seed, i)
    family = family_of(i, families)
    text = scene(made, family)
    if o.shrink:
        word = Scene(loaded(text, folder), i).judge(o.shrink).word

        def fails(trial):
            try:
                return (
                    Scene(loaded(scene(replayed(trial), family), folder), i).judge(o.shrink).word
                    == word
                )
            except ValueError:
                return False

        text = scene(replayed(shrunk(made.made, fails, o.tries)), family)
    print(text)
    case = loaded(text, folder)
    judged = Scene(case, i)
    for spec in (
        [o.shrink] if o.shrink else o.solver or ["event_driven", judged.second[0], *METHODS]
    ):
        if not solvers.get(spec).refuses(case):
            print(f"{spec:32s} {judged.judge(spec)}", flush=True)
    return 0


def main(argv=None) -> int:
    ap = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    ap.add_argument("--runs", type=int, default=10000)
    ap.add_argument("--seed", type=int, default=0)
    ap.add_argument("-j", type=int, default=2)
    # what the budgets of steps take (see randomised.ladder) is 45 s at the most, on a slow machine
    ap.add_argument(
        "--limit", type=float, default=120.0, help="seconds of CPU time of one (scene, method)"
    )
    ap.add_argument("-o", type=Path, help="folder of rows and case files")
    ap.add_argument("--family", nargs="*", choices=sorted(FAMILIES))
    ap.add_argument("--solver", nargs="*")
    ap.add_argument("--show", type=int, help="judge this scene alone")
    ap.add_argument("--shrink", help="with --show: make it minimal for this method")
    ap.add_argument("--tries", type=int, default=200)
    ap.add_argument("-v", action="store_true", help="tell of slow ones too")
    o = ap.parse_args(argv)
    families = o.family or list(FAMILIES)
    if o.show is not None:
        return show(o, families)
    lines = {}
    begin = time.perf_counter()
    if o.o:
        o.o.mkdir(parents=True, exist_ok=True)
        if (o.o / "rows.jsonl").exists():
            for line in (o.o / "rows.jsonl").read_text().splitlines():
                with contextlib.suppress(
                    ValueError
                ):  # half a line is left where the study was killed
                    lines |= dict([json.loads(line)])
    o.count = sum(row[0] != "refused" for rows in lines.values() for row in rows.values())

    def keep(i, rows):
        lines[i] = rows
        tell(i, rows, o.seed, families, o.o)
        if o.o:
            with (o.o / "rows.jsonl").open("a") as file:
                file.write(json.dumps([i, rows]) + "\n")

    run(o, families, set(lines), keep)
    print(table(sorted(lines.items()), families))
    words = Counter(row[0] for rows in lines.values() for row in rows.values())
    print(
        f"{len(lines)} scenes, {sum(words.values())} runs: {dict(words)}; silent wrong "
        f"{words['wrong']}, "
        f"crashes {words['crash']}, hangs {words['hang']}; {time.perf_counter() - begin:.0f} s"
    )
    return 1 if any(words[w] for w in BAD) else 0


if __name__ == "__main__":
    raise SystemExit(main())

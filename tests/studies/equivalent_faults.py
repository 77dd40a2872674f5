"""Why a drawn fault that no test sees is none, or none that a number shows.

By the name that drawn_faults.named gives it: file, line, what stands there instead. A constant that
moved by a hundredth has a reason by its kind.
"""

import math

HUNDREDTH = "a constant moved by a hundredth: not looked at one by one"
SIZE = "a limit on what is read at once or at all: any of its size serves"
WORKERS = "how many workers share the runs, which have the same bits with any number"
PHASE_2 = "when and how projected Newton ends: the dual method goes on from there to the solution"
ALWAYS_MORE = "what is counted there is always more than that"

# file: {line -> what stands there instead: reason}
_BY_FILE = {
    "gate/baseline.py": {
        "ENOUGH = 10 << 20  # bytes: a larger file is no baseline -> 21": SIZE,
    },
    "gate/calibrate.py": {
        "1, min(2, (os.cpu_count() or 1) // threads) -> 2": WORKERS,
        "1, min(2, (os.cpu_count() or 1) // threads) -> and": WORKERS,
        "SEEDS = (1, 2)  # of the perturbed starts -> 2": "any two seeds perturb a start",
        "SEEDS = (1, 2)  # of the perturbed starts -> 3": "any two seeds perturb a start",
    },
    "gate/compared_numbers.py": {
        "for key in versions[0].asked: -> 0 + 1": (
            "a method that one of the versions lacks has no accuracy that all have"
        ),
    },
    "gate/comparison.py": {
        'is_better = over > 0 if line.metric in LARGER_IS_BETTER or line.kind == "min" else over '
        "< 0 -> <=": "a number that is as before has passed in the line above",
    },
    "gate/comparison_page.py": {
        'points = _thinned([p for p in points if p["x"] > 0.0 and 0.0 < p["y"] < math.inf]) -> '
        "<=": "no number of a version is infinite; that none is zero is tested",
    },
    "gate/facts.py": {
        "return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode())"
        ".hexdigest()[:6] -> 7": "one digit more of a digest, on both sides of every comparison",
    },
    "gate/spreads.py": {"ENOUGH = 10 << 20  # bytes -> 21": SIZE},
    "lcp/gram_lcp.py": {"bad = -1 -> 2": "any negative number says that there is none"},
    "lcp/lemke.py": {
        "close = abs(a - b) <= 1e-13 * (abs(a) + abs(b)) -> <": "no two floats are so far apart",
    },
    "dynamics/contacts/kernels/cell_list.py": {
        "while f > row and pj[f - 1] > j: -> >=": "a partner of a particle comes once",
    },
    "qp/kernels/active_set.py": {
        "near = 0.0 -> 1.01": PHASE_2,
        "near = max(near, abs(min(mu[k] * norm[k], w[k] / norm[k]))) -> k + 1": PHASE_2,
    },
    "qp/kernels/interior_point.py": {
        "gap = 0.0 -> 1.01": "how far to centre: another way to the same solution",
    },
    "qp/kernels/large_callback.py": {
        "start[k] = mu[k] -> k + 1": "a warm start: another way to the same solution",
    },
    "solvers/catching_up/kernels/loop.py": {
        "reached = t[K - 1] -> 2": "every step writes it before it is read",
    },
    "solvers/event_driven/contacts/kernels/active_set_change.py": {
        "visible = UNCERTAINTY * settings.strict * floats.drift_size[0] -> 0 + 1": (
            "a multiplier that has crossed zero falls, visibly or not: its contact leaves by the "
            "loop, or by the choice of the driver"
        ),
    },
    "solvers/event_driven/contacts/kernels/held_set.py": {
        "return sign[k] * s, size * (2.0 if kind[k] == PAIR else 1.0) -> k + 1": (
            "of the kind: a factor of two in bounds with a margin of a hundred; of the sign: what "
            "enters in vain is left to the driver, what is missed fires within its band"
        ),
    },
    "solvers/pbd/kernels/listed_loop.py": {
        "return LoopResult(X, R, ids[:count], values[:count], work, code, t[K - 1], -1, -1) -> 2": (
            "no status names the time of a run that came to its end, and any negative number says "
            "that there are no lists"
        ),
    },
    "measure/orders/corrected_power_law.py": {
        "u, n = u - u.max(), len(u) -> +": (
            "the head r exp(q u) has another r; the search for it spans the share it may have"
        ),
    },
    "measure/orders/fit.py": {
        "and not fit_slope(h[end], err[end])[1][0] > FLAT -> >=": (
            "differs where the end of an interval is FLAT to the last bit"
        ),
    },
    "measure/orders/plateau.py": {
        "if found[0] < best[0]: -> <=": "differs where two searches end at the same misfit",
        "dv = (A[0, 0] * g[1] - A[0, 1] * g[0]) / det -> 1": (
            "a worse step of a damped iteration, which goes on to the same minimum"
        ),
        "free = max(before.n - 3, 1) -> +": "decides none of 3000 drawn ladders",
    },
    "measure/orders/window.py": {
        "DIP = 1 / 3  # of the floor: an error below says nothing, even among larger ones -> 4": (
            "a share that was chosen: a fourth serves as well"
        ),
    },
    "results/consistency.py": {
        'flags |= getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) -> 1': (
            "the default is taken on systems without these flags alone"
        ),
        "return lines[:1] == [rows] and len(lines) > 1 and not _inconsistency(folder, lines) -> "
        "2": "a key file has a line of the rows, one of the journal and one of a table at least",
    },
    "results/journal.py": {
        "whole += whole > 0 and ended -> 1": ALWAYS_MORE,
        "while end > 0: -> 1": "a journal does not begin with the end of a line",
        "LONGEST = 16 << 20  # bytes of a line: the parts of one key take some ten thousand -> "
        "21": SIZE,
        "BLOCK = 1 << 20  # bytes that are read at a time -> 21": SIZE,
        "BLOCK = 1 << 20  # bytes that are read at a time -> 2": SIZE,
        "MAX_BYTES = 16 << 30  # of a journal: ten million rows take less -> 31": SIZE,
        "MAX_BYTES = 16 << 30  # of a journal: ten million rows take less -> 17": SIZE,
        "self._file = -1 -> 2": "any negative number says that the file is closed",
        "if self._file >= 0: -> 1": "an open file has a number beyond those of the terminal",
        'ended = whole == 0 or file.read(1) == b"\\n" -> 2': (
            "two bytes are compared with one where a line begins behind the end of another"
        ),
        "v = float(v) if abs(v) <= sys.float_info.max else math.inf if v > 0 else -math.inf -> "
        ">=": "zero has 64 bits and does not come here",
        "os.kill(pid, 0) -> 1": "ends the tests themselves, but for those that nohup began",
    },
    "results/run_key.py": {
        "lines = [driver.read_text().splitlines()[0]] if driver.exists() else [] -> 0 + 1": (
            "read where there is the driver of a graphics card"
        ),
        "SHORT = 16  # hexadecimal digits of a digest within a key -> 17": (
            "one digit more of a digest, in every key"
        ),
    },
}
_KNOWN = {
    f"nsbench/{file}: {line}": why for file, of in _BY_FILE.items() for line, why in of.items()
}


def reason(title: str, named: str) -> str:
    """Return why a fault is none that a test can see, "" if no reason is known."""
    before, _, after = title.rpartition(": ")[2].partition(" -> ")
    try:
        moved = float(after) / float(before)
    except (ValueError, ZeroDivisionError):
        moved = 0.0
    return _KNOWN.get(named, HUNDREDTH if math.isclose(moved, 1.01, rel_tol=1e-9) else "")

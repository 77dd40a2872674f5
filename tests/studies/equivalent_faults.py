"""Why a drawn fault that no test sees is none, or none that a number shows.

By the name that drawn_faults.named gives it: file, line, what stands there instead. A constant that
moved by a hundredth has a reason by its kind.
"""

import math

HUNDREDTH = "a constant moved by a hundredth: not looked at one by one"
SIZE = "a limit on what is read at once or at all: any of its size serves"
WORKERS = "how many workers share the runs, which have the same bits with any number"
PHASE_2 = "when and how projected Newton ends: the dual method goes on from there to the solution"
EQUAL = "differs where both sides are equal to the last bit"
NEGATIVE = "any negative number says that there is none"
FLAGS = "the default is taken on systems without these flags alone"
SEARCH = "another way of the search to the same minimum"
ALWAYS_MORE = "what is counted there is always more than that"

# file: {line -> what stands there instead: reason}
_BY_FILE = {
    "qp/kernels/dual_active_set.py": {
        "mu[k] = max(mu[k] + t * (goal[k] - mu[k]), 0.0) if on[k] else 0.0 -> k + 1": (
            "where the inner loop goes on from: it ends at the solution on its set"
        ),
    },
    "solvers/event_driven/filippov/kernels/step_certificate.py": {
        "for k in range(1, p + 1): -> 2": "a bound that is wider by one coefficient more",
    },
    "solvers/pbd/kernels/skin_control.py": {
        "np.sqrt(far) / max(control.age, 1), -> 2": (
            "how often lists are renewed, which hold the same contacts"
        ),
    },
    "solvers/event_driven/contacts/kernels/first_event.py": {
        "if rise < 0.0 or 0.0 <= fall <= rise: -> <": EQUAL,
    },
    "gate/baseline.py": {
        "ENOUGH = 10 << 20  # bytes: a larger file is no baseline -> 21": SIZE,
        "return times_claim(line, fact) > MOST * (1 + 1e-9)  # a quotient is rounded -> -": (
            "a margin for the rounding of a quotient"
        ),
    },
    "gate/calibrate.py": {
        "1, min(2, (os.cpu_count() or 1) // threads) -> 2": WORKERS,
        "1, min(2, (os.cpu_count() or 1) // threads) -> and": WORKERS,
        "SEEDS = (1, 2)  # of the perturbed starts -> 3": "any two seeds perturb a start",
        "jobs = args.jobs or max( -> and": WORKERS,
    },
    "gate/compared_numbers.py": {
        "for key in versions[0].asked: -> 0 + 1": (
            "a method that one of the versions lacks has no accuracy that all have"
        ),
    },
    "gate/comparison.py": {
        'is_better = over > 0 if line.metric in LARGER_IS_BETTER or line.kind == "min" else '
        "over < 0 -> <=": "a number that is as before has passed in the line above",
    },
    "gate/comparison_page.py": {
        'points = _thinned([p for p in points if p["x"] > 0.0 and 0.0 < p["y"] < math.inf]) -> '
        "<=": "no number of a version is infinite; that none is zero is tested",
        "for key in versions[0].facts: -> 0 + 1": (
            "a number that one of the versions lacks is left out"
        ),
        "if not half >= 0.0: -> >": EQUAL,
    },
    "gate/facts.py": {
        'return "near" if column.gate == "near" and value > least else "max" -> >=': EQUAL,
        'return "near" if abs(value) > least else "min" -> >=': EQUAL,
    },
    "gate/spreads.py": {
        "ENOUGH = 10 << 20  # bytes -> 21": SIZE,
    },
    "lcp/gram_lcp.py": {
        "bad = -1 -> 2": NEGATIVE,
        "lam[idx[a]] = max(0.0, lam[idx[a]] - alpha * c[a]) -> a + 1": (
            "the multipliers are computed anew on the new support"
        ),
    },
    "lcp/lemke.py": {
        "close = abs(a - b) <= 1e-13 * (abs(a) + abs(b)) -> <": "no two floats are so far apart",
    },
    "dynamics/contacts/kernels/cell_list.py": {
        "while f > row and pj[f - 1] > j: -> >=": "a partner of a particle comes once",
    },
    "qp/kernels/active_set.py": {
        "near = 0.0 -> 1.01": PHASE_2,
        "near = max(near, abs(min(mu[k] * norm[k], w[k] / norm[k]))) -> k + 1": PHASE_2,
        "on[k] = w[k] < -tol * norm[k] -> <=": EQUAL,
    },
    "qp/kernels/interior_point.py": {
        "tried = 2 * few -> /": "when an exact solution is tried at the earliest",
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
            "a multiplier that has crossed zero falls, visibly or not: its contact leaves by "
            "the loop, or by the choice of the driver"
        ),
        "if y * y > dependent * UNCERTAINTY * length: -> /": (
            "what lies between the two limits has returned before"
        ),
        "entering = event.entry if event.closing else -1 -> 2": NEGATIVE,
    },
    "solvers/event_driven/contacts/kernels/held_set.py": {
        "return sign[k] * s, size * (2.0 if kind[k] == PAIR else 1.0) -> k + 1": (
            "of the kind: a factor of two in bounds with a margin of a hundred; of the sign: "
            "what enters in vain is left to the driver, what is missed fires within its band"
        ),
        "size += vals[e] * vals[e] -> /": "a factor in bounds with a margin of a hundred",
    },
    "solvers/pbd/kernels/listed_loop.py": {
        "return LoopResult(X, R, ids[:count], values[:count], work, code, t[K - 1], -1, -1) -> 2": (
            "no status names the time of a run that came to its end, and any negative number "
            "says that there are no lists"
        ),
    },
    "measure/orders/corrected_power_law.py": {
        "u, n = u - u.max(), len(u) -> +": (
            "the head r exp(q u) has another r; the search for it spans the share it may have"
        ),
        "high = grid[:, -1] -> 2": SEARCH,
    },
    "measure/orders/fit.py": {
        "and not fit_slope(h[end], err[end])[1][0] > FLAT -> >=": (
            "differs where the end of an interval is FLAT to the last bit"
        ),
        "abs(line.order) <= FLAT -> <": EQUAL,
    },
    "measure/orders/plateau.py": {
        "fine = h <= end * (1 + 1e-9) -> -": "decides none of 3000 drawn ladders",
        "if found[0] < best[0]: -> <=": "differs where two searches end at the same misfit",
        "dv = (A[0, 0] * g[1] - A[0, 1] * g[0]) / det -> 1": (
            "a worse step of a damped iteration, which goes on to the same minimum"
        ),
        "free = max(before.n - 3, 1) -> +": "decides none of 3000 drawn ladders",
        "return foreseen and slope < 0.5 * full.p -> <=": EQUAL,
        "for k in np.argsort(rss, axis=None)[:3]: -> 4": SEARCH,
        "p = min(max(p + step, 0.0), 20.0) -> 1.01": SEARCH,
        "det = A[0, 0] * A[1, 1] - A[0, 1] ** 2 -> +": SEARCH,
        "for _ in range(40): -> 41": SEARCH,
    },
    "measure/orders/window.py": {
        "DIP = 1 / 3  # of the floor: an error below says nothing, even among larger ones -> 4": (
            "a share that was chosen: a fourth serves as well"
        ),
    },
    "results/consistency.py": {
        'flags |= getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) -> 1': FLAGS,
        "return lines[:1] == [rows] and len(lines) > 1 and not _inconsistency(folder, lines) -> "
        "2": "a key file has a line of the rows, one of the journal and one of a table at least",
        "return path.stat().st_size if path.is_file() else 0 -> 1": (
            "the same on both sides of the comparison"
        ),
        "if len(lines) == 1: -> 2": (
            "a key file has a line of the rows, one of the journal and one of a table at least"
        ),
    },
    "results/journal.py": {
        "whole += whole > 0 and ended -> 1": ALWAYS_MORE,
        "while end > 0: -> 1": "a journal does not begin with the end of a line",
        "BLOCK = 1 << 20  # bytes that are read at a time -> 21": SIZE,
        "BLOCK = 1 << 20  # bytes that are read at a time -> 2": SIZE,
        "self._file = -1 -> 2": "any negative number says that the file is closed",
        "if self._file >= 0: -> 1": "an open file has a number beyond those of the terminal",
        'ended = whole == 0 or file.read(1) == b"\\n" -> 2': (
            "two bytes are compared with one where a line begins behind the end of another"
        ),
        "v = float(v) if abs(v) <= sys.float_info.max else math.inf if v > 0 else -math.inf -> "
        ">=": "zero has 64 bits and does not come here",
        "os.kill(pid, 0) -> 1": "ends the tests themselves, but for those that nohup began",
        '| getattr(os, "O_NOFOLLOW", 0) -> 1': FLAGS,
        '| getattr(os, "O_NONBLOCK", 0), -> 1': FLAGS,
        "v = float(v) if abs(v) <= sys.float_info.max else math.inf if v > 0 else -math.inf -> 1": (
            "no whole number beyond 64 bits is 1"
        ),
    },
    "results/run_key.py": {
        "lines = [driver.read_text().splitlines()[0]] if driver.exists() else [] -> 0 + 1": (
            "read where there is the driver of a graphics card"
        ),
    },
    "solvers/event_driven/filippov/kernels/step_to_event.py": {
        "NO_WATCH = -1  # instead of the number of a watched function -> 2": NEGATIVE,
        "if abs(move) <= 2.0 * EPS * max(abs(t + s), h): -> -": (
            "how many steps of Newton's method there are at least"
        ),
        "if abs(move) <= 2.0 * EPS * max(abs(t + s), h): -> /": (
            "how many steps of Newton's method there are at least"
        ),
    },
    "linalg/multifrontal.py": {
        "row = F[(own + i) * (nf + 1) : (own + i + 1) * nf] -> 2": (
            "what the slice has beyond `out` is not read"
        ),
    },
    "solvers/event_driven/filippov/kernels/polynomial_root.py": {
        "for j in range(k + 1): -> 2": "that binomial coefficient is zero",
        "if left > error or (lo == -1.0 and left > 0.0): -> >=": EQUAL,
    },
    "linalg/skyline_cholesky.py": {
        "most = 0 -> 1": "room for one entry more",
    },
    "solvers/event_driven/contacts/kernels/series_step.py": {
        "t = floats.time[0] -> 0 + 1": "of the time only the rounding counts there",
        "return h > 4e-16 * (abs(t) + abs(settings.end)) or h >= settings.end - t -> >=": EQUAL,
    },
    "solvers/euler/kernels/loop.py": {
        "field(after - h, x, s, y) -> +": (
            "which of two statuses a run has whose implicit step failed, where its field "
            "depends on time"
        ),
        "unsure |= mode[i] != 0 and not c[i] * mode[i] >= 0.0 -> /": "a mode is 1 or -1 there",
    },
    "solvers/event_driven/filippov/kernels/enclosure.py": {
        "M[row, k] = 0.0 -> 1.01": "the radius there is infinite",
    },
    "solvers/theta/kernels/loop.py": {
        "free[c] = step.y[c] - push[c] -> c + 1": (
            "what stands there already is the same where the drift is linear, as in an LCS"
        ),
    },
    "measure/residuals.py": {
        "row, col, _ = scene.gradient_entries(float(t[0]), x[0], near) -> 0 + 1": (
            "only where the entries lie is taken, which is the same in every state"
        ),
    },
    "linalg/nested_dissection.py": {
        "parts += above[c] > -2 -> c + 1": (
            "a part begins at the first place, and behind the array but for chance"
        ),
    },
    "solvers/euler/kernels/implicit_step.py": {
        "q[n + j] *= jump[slide[j]] -> -": "when Newton's iteration ends",
    },
    "solvers/event_driven/filippov/kernels/mode_change.py": {
        "ratio = last / before if before > 0.0 else 1.0 -> >=": (
            "infinite, no ratio below 0.9 either"
        ),
    },
    "measure/multiplier_times.py": {
        "SPACINGS = (1 / 4, 1 / 8, 1 / 16, 1 / 32)  # of their nodes, in sample spacings -> *": (
            "the best of four spacings is taken"
        ),
    },
    "solvers/pbd/kernels/cell_storage.py": {
        "if pairs > max_pairs or (pairs < 0 and size > max_pairs + n): -> <=": (
            "a list too long by one pair: the run is done by another loop"
        ),
    },
    "measure/orders/slopes.py": {
        "points: int = 0 -> 1": "every fit says how many points it has",
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

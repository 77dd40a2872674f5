"""Break the bench on purpose, one fault at a time, and see which test notices.

    python tests/studies/mutations.py [NAME ...]

Every fault is a replacement of text in a copy of the checkout; the tests named with it must pass
before and fail after. Faults in the scaling of cases are to be noticed by the metamorphic tests.
Prints one line per fault with the first test that failed; exit status 1 if one went unnoticed or no
longer applies.
"""

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from copies import broken_in, copy, is_kernel

METAMORPHIC = "tests/solvers/test_metamorphic.py"

SWEEP = (
    "nsbench/solvers/pbd/kernels/listed_loop.py",
    "sweep(0, m, lists",
    "sweep(0, max(m - 1, 0), lists",
)
# name: (file, text, its replacement, tests)
FAULTS = {
    "sign error in the multiplier (pbd)": (
        "nsbench/solvers/pbd/kernels/projection.py",
        "            mu[c] += m\n",
        "            mu[c] -= m\n",
        "tests/solvers/test_contract.py",
    ),
    "sign error in the multiplier (event_driven)": (
        "nsbench/solvers/event_driven/contacts/kernels/constraint_rows.py",
        "return f + reaction, lam, reaction",
        "return f + reaction, -lam, reaction",
        "tests/solvers/event_driven/test_event_driven*.py",
    ),
    "one prox dropped": (*SWEEP, "tests/solvers/pbd/test_pbd.py"),
    "h halved inside the loop": (
        "nsbench/solvers/pbd/kernels/listed_loop.py",
        "x[c] += h * v[c]",
        "x[c] += 0.5 * h * v[c]",
        "tests/solvers/test_contract.py",
    ),
    "last step skipped": (
        "nsbench/solvers/pbd/kernels/listed_loop.py",
        "for s in range(substeps[k]):",
        "for s in range(substeps[k] - (k == K - 2)):",
        "tests/solvers/pbd/test_pbd.py",
    ),
    "dg/dt forgotten (event_driven)": (
        "nsbench/solvers/event_driven/contacts/evaluation.py",
        "self.constraints.rates(t, x, rows.listed)\n",
        "np.zeros(len(rows))\n",
        "tests/solvers/event_driven/test_event_driven*.py",
    ),
    "walls taken at the start of the step (pbd)": (
        "nsbench/solvers/pbd/kernels/listed_loop.py",
        "b_of(after, b)",
        "b_of(now, b)",
        "tests/solvers/pbd/test_pbd.py",
    ),
    "lambda compared at nodes": (
        "nsbench/measure/multiplier_times.py",
        "mean = (_impulse(case, t[k]) - _impulse(case, t[k] - h[k])) / h[k][:, None]",
        "mean = nodal(case, t[k], spacing)[0]",
        "tests/measure/test_time_labels.py",
    ),
    "reference truncated by one digit in 1e-8": (
        "nsbench/reference/storage.py",
        '"x": ref.x}',
        '"x": np.trunc(ref.x * 1e8) / 1e8}',
        "tests/reference/test_reference.py tests/reference/test_certificate.py",
    ),
    "order fitted on asked steps": (
        "nsbench/study/attempt.py",
        '{"h": counted.get("h", spec.asked), "k"',
        '{"h": spec.asked, "k"',
        "tests/solvers/test_steps_taken.py",
    ),
    "scaling: fields are not multiplied by the unit of time": (
        "nsbench/dynamics/scaling/scaled_case.py",
        "        rate = T / S\n",
        "        rate = 1.0 / S\n",
        METAMORPHIC,
    ),
    "scaling: the origin of time is forgotten": (
        "nsbench/dynamics/scaling/scaled_case.py",
        "        return self.origin + self.time * t\n",
        "        return self.time * t\n",
        METAMORPHIC,
    ),
    "scaling: steps keep the user's unit": (
        "nsbench/dynamics/scaling/scaled_case.py",
        '{"h": value / self.time,',
        '{"h": value,',
        METAMORPHIC,
    ),
    "scaling: impulses stay in own units": (
        "nsbench/dynamics/scaling/scaled_case.py",
        "            impulse=traj.impulse * impulse,\n",
        "            impulse=traj.impulse,\n",
        METAMORPHIC,
    ),
    "scaling: reactions stay in own units": (
        "nsbench/dynamics/scaling/scaled_case.py",
        "reaction=traj.reaction * state if",
        "reaction=traj.reaction if",
        METAMORPHIC,
    ),
    "scaling: units are no powers of two": (
        "nsbench/dynamics/scaling/scaled_case.py",
        "    T = power_of_two(scale.time)\n",
        "    T = float(scale.time) / 1.1\n",
        METAMORPHIC,
    ),
    "scaled run: switches keep the user's unit": (
        "nsbench/solvers/scaled_run.py",
        "prepare(with_own_switches(self.own.case), value)",
        "prepare(self.own.case, value)",
        METAMORPHIC,
    ),
    "scaled run: sizes are never found again": (
        "nsbench/solvers/scaled_run.py",
        "        if found is None:\n",
        "        if True:\n",
        METAMORPHIC,
    ),
    "estimate: all coordinates have size one": (
        "nsbench/dynamics/scaling/estimate.py",
        "    return Scale(_time(case, [v for _, v in fields], own, span), own)\n",
        "    return Scale(_time(case, [v for _, v in fields], own, span), 0.0 * own + 1.0)\n",
        METAMORPHIC,
    ),
    "estimate: the largest coordinate is the size of all": (
        "nsbench/dynamics/scaling/estimate.py",
        "        own = _filled(np.where((far > FARTHER * own) & (own > 0.0), far, own))\n",
        "        own = np.full(case.n, max(own.max(), far.max()))\n",
        METAMORPHIC,
    ),
    "estimate: the time is that of the run": (
        "nsbench/dynamics/scaling/estimate.py",
        "    return min(span, 1.0 / rate) if rate > 0.0 else span\n",
        "    return span\n",
        METAMORPHIC,
    ),
}


def tests_of(pattern, folder):
    """Test files of a space-separated list of patterns and node ids."""
    out = []
    for part in pattern.split():
        path, sep, node = part.partition("::")
        out += [str(p.relative_to(folder)) + sep + node for p in sorted(folder.glob(path))]
    return out


def pytest(folder, pattern, kernels):
    """(exit status, first failure) of the tests in a copy; kernels: folder of compiled ones."""
    env = os.environ | {
        "PYTHONPATH": str(folder),
        "PYTHONDONTWRITEBYTECODE": "1",
        "NUMBA_CACHE_DIR": str(kernels),
    }
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "pytest",
            "-xq",
            "-n0",
            "-p",
            "no:cacheprovider",
            "-m",
            "",  # the long tests too
            *tests_of(pattern, folder),
        ],
        cwd=folder,
        env=env,
        capture_output=True,
        text=True,
        timeout=1500,
    )
    failed = re.search(r"^FAILED (\S+)", done.stdout, re.M)
    return done.returncode, failed[1] if failed else done.stdout.strip().splitlines()[-1:]


def attempt(folder, replacement, pattern):
    """(exit status, first failure) of the tests in a copy with a fault."""
    with tempfile.TemporaryDirectory() as scratch, broken_in(folder, replacement):
        kernels = scratch if is_kernel(replacement[0]) else folder / ".kernels"
        return pytest(folder, pattern, kernels)


def main(chosen):
    bad = 0
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        copy(folder)
        for name, (file, text, other, pattern) in FAULTS.items():
            if chosen and not any(c in name for c in chosen):
                continue
            try:
                status, failed = attempt(folder, (file, text, other), pattern)
            except LookupError as e:
                status = 0
                failed = e
            caught = status == 1
            bad += not caught
            said = f"caught by {failed}" if caught else f"NOT CAUGHT (status {status}: {failed})"
            print(f"{name:45} {said}", flush=True)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

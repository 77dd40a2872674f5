"""Break the bench on purpose, one fault at a time, and see which test notices.

    python tests/studies/mutations.py [NAME ...]

Every fault is a replacement of text in a copy of the checkout; the tests named with it must pass
before and fail after.
Prints one line per fault with the first test that failed; exit status 1 if one went unnoticed or no
longer applies.
"""

import os
import re
import subprocess
import sys

from copies import broken

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
}


def tests_of(pattern, folder):
    """Test files of a space-separated list of patterns and node ids."""
    out = []
    for part in pattern.split():
        path, sep, node = part.partition("::")
        out += [str(p.relative_to(folder)) + sep + node for p in sorted(folder.glob(path))]
    return out


def pytest(folder, pattern):
    """(exit status, first failure) of the tests in a copy."""
    env = dict(os.environ, PYTHONPATH=str(folder), PYTHONDONTWRITEBYTECODE="1")
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "pytest",
            "-xqn0",
            "-p",
            "no:cacheprovider",
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


def main(chosen):
    bad = 0
    for name, (file, text, other, pattern) in FAULTS.items():
        if chosen and not any(c in name for c in chosen):
            continue
        try:
            with broken((file, text, other)) as folder:
                status, failed = pytest(folder, pattern)
        except LookupError as e:
            status = 0
            failed = e
        caught = status == 1
        bad += not caught
        print(
            f"{name:45} "
            f"{'caught by ' + str(failed) if caught else f'NOT CAUGHT (status {status}: {failed})'}",
            flush=True,
        )
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

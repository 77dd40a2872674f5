"""For every solver: whether its runs import a file of the package that their keys do not know. Ends
with 1 if one does.

    python tests/studies/imported.py [SOLVER ...]

Each solver runs four cases in a process that finds no other solver; what it has imported then is
compared with what is read off the texts of its files. On a new machine this compiles everything.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "source_files"))
from test_imports import PROBES, unknown

from nsbench import solvers


def main(names) -> int:
    missed = 0
    for name in names or solvers.all_names():
        ((statuses, files, n),) = unknown((name,), PROBES).values()
        missed += len(files)
        print(
            f"{name}: {n} files imported, runs ended {', '.join(statuses)}; not known to the key: "
            f"{', '.join(sorted(str(f) for f in files)) or 'none'}",
            flush=True,
        )
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

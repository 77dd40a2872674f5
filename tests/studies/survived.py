"""What must be survived, the tests that show it, and how they ended, as a table in Markdown.

python tests/studies/survived.py [words that pytest is to be given]
"""

import sys
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(HERE / "support"))
from survival_table import ENTRIES, marked  # noqa: E402


class Seen:
    """Collects, for each entry, its tests and how they ended."""

    def __init__(self):
        self.tests: dict[str, dict[str, set]] = {}
        self.names: dict[str, list[str]] = {}

    def pytest_itemcollected(self, item):
        self.names[item.nodeid] = [a for m in item.iter_markers("survives") for a in m.args]

    def pytest_runtest_logreport(self, report):
        if report.when != "call" and report.passed:
            return
        test = report.nodeid.split("[")[0].rpartition("/")[2]
        for name in self.names.get(report.nodeid, ()):
            self.tests.setdefault(name, {}).setdefault(test, set()).add(report.outcome)

    def table(self) -> str:
        what = [ends for tests in self.tests.values() for ends in tests.values()]
        pairs = sum(len(set(tests)) for tests in marked().values())
        out = [
            f"{len(ENTRIES)} entries, {len(what)} of {pairs} pairs of entry and test were run, "
            f"{sum(bool(ends - {'passed'}) for ends in what)} did not pass",
            "",
            "| what must be survived | expected | test | outcome |",
            "| --- | --- | --- | --- |",
        ]
        for room in dict.fromkeys(e.room for e in ENTRIES):
            out.append(f"| **{room}** | | | |")
            for e in (e for e in ENTRIES if e.room == room):
                tests = {
                    t: self.tests.get(e.name, {}).get(t, {"not run"})
                    for t in marked().get(e.name, ())
                }
                ends = set().union(*tests.values()) if tests else {"NO TEST"}
                named = "<br>".join(f"`{t}`" for t in sorted(tests)) or "none"
                out.append(f"| {e.what} | {e.outcome} | {named} | {', '.join(sorted(ends))} |")
        return "\n".join(out)


if __name__ == "__main__":
    seen = Seen()
    code = pytest.main(
        ["-q", "-n0", "-m", "survives", "-p", "no:cacheprovider", *(sys.argv[1:] or [str(HERE)])],
        plugins=[seen],
    )
    print(seen.table())
    sys.exit(int(code))

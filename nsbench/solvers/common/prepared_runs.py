"""Keep prepared (traced and compiled) runs for the next call with equal case, method, accuracy.

To prepare a run (compile, allocate, factorise) may take a hundred times as long as the run. A run
that is in use is taken out, so that no two threads share its workspace; one that raised is not put
back. Results do not depend on what is kept: a prepared run starts from scratch each time.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Hashable
from typing import Any

MAX_RUNS = 16
MAX_NUMBERS = 20_000_000  # states times samples of all runs that are kept: some hundred megabytes


class PreparedRuns:
    """A bounded store of prepared runs; the one that was used least recently goes first."""

    def __init__(self, max_runs: int = MAX_RUNS, max_numbers: int = MAX_NUMBERS):
        self.max_runs = max_runs
        self.max_numbers = max_numbers
        self.lock = threading.Lock()
        self.runs: OrderedDict[Hashable, tuple[int, Any]] = OrderedDict()

    def take(self, key: Hashable) -> Any | None:
        """Take a run out of the store; None if there is none."""
        with self.lock:
            return self.runs.pop(key, (0, None))[1]

    def put(self, key: Hashable, size: int, run: Any) -> None:
        """Put a run back, of `size` numbers; older ones go where that is too much."""
        with self.lock:
            self.runs[key] = (size, run)
            while self.runs and (
                len(self.runs) > self.max_runs
                or sum(size for size, _ in self.runs.values()) > self.max_numbers
            ):
                self.runs.popitem(last=False)

    def clear(self) -> None:
        """Forget all runs."""
        with self.lock:
            self.runs.clear()

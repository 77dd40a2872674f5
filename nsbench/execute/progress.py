"""Progress of a long run: a bar with the time left on a terminal, plain lines elsewhere."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable

EXPECTED_STATUSES = ("ok", "refused", "below_reference")  # all others count as failures
LINE = 15.0  # seconds between plain lines


class Progress:
    """Counts finished runs out of `total`; `say(text, end)` prints, `terminal` chooses the bar."""

    def __init__(self, total: int, say: Callable, terminal: bool):
        self.total = total
        self.done = 0
        self.failed = 0
        self.say = say
        self.terminal = terminal
        self.start = self.last = time.monotonic()

    def step(self, label: str, status: str) -> None:
        self.done += 1
        self.failed += status not in EXPECTED_STATUSES
        now = time.monotonic()
        if self.terminal:
            if now - self.last > 0.1 or self.done == self.total:
                self.say("\r" + self.line(label, shutil.get_terminal_size().columns - 1), end="")
                self.last = now
        elif now - self.last > LINE:
            self.say(self.line(label, 120))
            self.last = now

    def line(self, label: str, width: int) -> str:
        spent = time.monotonic() - self.start
        left = spent / max(1, self.done) * (self.total - self.done)
        head = f"{self.done}/{self.total}"
        guess = f"about {clock(left)} left" if self.done >= 10 else "time left unknown"
        tail = f"{clock(spent)} spent, {guess}" + (f", {self.failed} failed" if self.failed else "")
        cells = max(0, min(30, width - len(head) - len(tail) - len(label) - 6))
        full = cells * self.done // max(1, self.total)
        bar = f"[{'#' * full}{'.' * (cells - full)}] " if cells > 4 else ""
        return f"{head} {bar}{tail}  {label}"[: max(1, width)].ljust(max(1, width))

    def end(self) -> None:
        if self.terminal and self.done:
            self.say("")


def clock(seconds: float) -> str:
    s = round(seconds)
    return (
        f"{s // 3600}:{s % 3600 // 60:02d}:{s % 60:02d}" if s >= 3600 else f"{s // 60}:{s % 60:02d}"
    )

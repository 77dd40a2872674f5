"""Progress of a study: finished runs, failures and the time left.

On a terminal it is one line, redrawn with a bar by tqdm; elsewhere a plain line every
SECONDS_BETWEEN_LINES seconds. The time left is estimated by nsbench.execute.remaining_time.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable

from nsbench.case import parse_spec
from nsbench.execute.remaining_time import RemainingTime
from nsbench.study import Spec
from nsbench.trajectory import NO_FAILURE

EXPECTED_STATUSES = ("ok", "refused", "below_reference")  # of a command that went well
SECONDS_BETWEEN_LINES = 15.0  # where there is no terminal
SECONDS_BETWEEN_REDRAWS = 0.1
PLAIN_WIDTH = 120
BAR_CELLS = 20
FIRST_ESTIMATE = 5  # finished runs: with fewer no time left is given


class Waiting:
    """Say now and then that something without steps of its own goes on; what: its name."""

    def __init__(self, what: str, say: Callable):
        self.what = what
        self.say = say
        self.start = self.printed_at = time.monotonic()

    def tell(self) -> None:
        """Print how long it has taken, if it is time to."""
        now = time.monotonic()
        if now - self.printed_at > SECONDS_BETWEEN_LINES:
            self.printed_at = now
            self.say(f"{self.what}: {now - self.start:.0f} s so far")


class Progress:
    """Count finished runs and print how far a study is.

    specs: all runs to do; jobs: workers (None: not known); say(text, end): prints; terminal: redraw
    one line with a bar; limit: what is said instead of the time left, where something else than
    the runs so far bounds it.
    """

    def __init__(
        self, specs: list[Spec], jobs: int | None, say: Callable, terminal: bool, limit: str = ""
    ):
        self.total = len(specs)
        self.done = 0
        self.failed = 0
        self.say = say
        self.terminal = terminal
        self.limit = limit
        self.is_drawn = False  # is there a line on the terminal that is redrawn?
        self.start = time.monotonic()
        self.printed_at = self.start
        self.remaining = RemainingTime(specs, jobs)

    def step(self, spec: Spec, row: dict) -> None:
        """Count a run with its first row; print, if it is time to."""
        self.done += 1
        self.failed += row["status"] not in NO_FAILURE
        self.remaining.add(spec, row)
        self.tell(spec.label, at_once=self.terminal and self.done == self.total)

    def tell(self, label: str, at_once: bool = False, left: str = "") -> None:
        """Print the line with this label, if it is time to, or `at_once`.

        left: what is said instead of the time left.
        """
        since = time.monotonic() - self.printed_at
        if not at_once and since <= (
            SECONDS_BETWEEN_REDRAWS if self.terminal else SECONDS_BETWEEN_LINES
        ):
            return
        self.printed_at = time.monotonic()
        if self.terminal:
            width = shutil.get_terminal_size().columns - 1
            self.say("\r" + self.line(label, width, left), end="")
            self.is_drawn = True
        else:
            self.say(self.line(label, PLAIN_WIDTH, left))

    def tell_compilation(self, spec: Spec) -> None:
        """Print, if it is time to, that the kernels of this run are being compiled."""
        name = parse_spec(spec.solver)[0]
        seconds = self.remaining.compilation()
        self.tell(spec.label, left=f"compiling {name}, once, about {seconds:.0f} s")

    def clear(self) -> None:
        """Take the redrawn line off the terminal, for a line of another kind."""
        if self.is_drawn:
            self.say("\r" + " " * (shutil.get_terminal_size().columns - 1) + "\r", end="")
            self.is_drawn = False

    def line(self, label: str, width: int, left: str = "") -> str:
        """Format the line of progress, `width` characters long; label: what ended, or is done."""
        from tqdm import tqdm

        elapsed = time.monotonic() - self.start
        left = left or self.limit
        if not left and self.done >= FIRST_ESTIMATE:
            left = f"about {tqdm.format_interval(self.remaining.seconds(elapsed))} left"
        left = left or "time left unknown"
        failures = f", {self.failed} failed" if self.failed else ""
        line = tqdm.format_meter(
            self.done,
            self.total,
            elapsed,
            ncols=max(1, width),
            ascii=".#",
            prefix=label.replace("{", "(").replace("}", ")"),
            bar_format=f"{{n}}/{{total}} {{elapsed}} spent, {left}{failures} "
            f"[{{bar:{BAR_CELLS}}}] {{desc}}",
        )
        return line.ljust(max(1, width))

    def end(self) -> None:
        """End the redrawn line."""
        if self.is_drawn:
            self.say("")

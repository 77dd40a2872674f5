"""First lines of a worker's process: bind it to its parent, then import the rest.

The rest (numpy, the methods) takes a second and more to import; a parent that ends within that time
takes the worker with it. Therefore this module, and the packages above it, import nothing else.
"""

from __future__ import annotations

from nsbench.execute.workers.parent_watch import exit_with_parent


def start_worker(pipe, output, word: bytes, parent: int, locks: str) -> None:
    """Body of a worker's process; arguments as of nsbench.execute.workers.worker.work."""
    exit_with_parent(parent)
    from nsbench.execute.workers.worker import work

    work(pipe, output, word, parent, locks)

"""Build the references that cases of files lack, before any of their runs is made."""

from __future__ import annotations

import time

from nsbench import reference
from nsbench.execute import dry_run
from nsbench.execute.progress import Waiting
from nsbench.execute.workers.pool import Chore, run_all
from nsbench.reference import build_missing, is_missing, lookup, store_reason, why_missing
from nsbench.study.plan import resolve


def build_references(sources: set[tuple[str, str, str]], args, say) -> None:
    """Build on workers the references that cases of files lack: (key, file, folder) each.

    With --plan it is said which they are. What cannot be built has its reason stored beside them
    (nsbench.reference.missing).
    """
    missing = sorted(source for source in sources if is_missing(resolve(*source)))
    if not missing:
        return
    names = ", ".join(key for key, _, _ in missing)
    if args.plan:
        say(f"first the references of {names} would be built; until then their errors are unknown")
        return
    ways = {source[0]: reference.describe_attempt(resolve(*source)) for source in missing}
    for way in dict.fromkeys(ways.values()):
        say(f"building the references of {', '.join(k for k in ways if ways[k] == way)}: {way}")
    start = time.perf_counter()
    chores = [Chore(_build_reference, source) for source in missing]
    jobs = dry_run.worker_count(args) if args.dask is None else 1
    run_all(
        [],
        jobs,
        args.timeout,
        lambda spec, row: None,
        chores,
        memory_limit=args.memory,
        on_pause=Waiting("references", say).tell,
    )
    for source in missing:
        case = resolve(*source)
        if is_missing(case):
            store_reason(case, "its worker ended, or was stopped at the limits of time and memory")
        found = lookup.reference(case)
        told = f"no reference: {why_missing(case)}" if found is None else f"reference: {found}"
        say(f"{case.key}: {told}")
    say(f"references took {time.perf_counter() - start:.0f} s")


def _build_reference(key: str, file: str, folder: str) -> None:
    build_missing(resolve(key, file, folder))

"""`nsbench study`: conduct one of the studies, and write what it found.

DIR/studies/NAME.json holds the finding, DIR/studies/NAME.html its page; where DIR holds results of
`nsbench run`, its report is written again with a section on the studies.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import time
from collections.abc import Callable
from pathlib import Path

from nsbench.cli.exit_codes import FAILED, FINE
from nsbench.source_files.regular_files import exists

# several threads on matrices of a few hundred rows cost more than they save; set before numpy loads
LIBRARY_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def command(args: argparse.Namespace, say: Callable[..., None]) -> int:
    """List the studies, or conduct one; 3 if its numbers contradict each other.

    Raises LookupError for an unknown name, ValueError for a folder that is a file and for options
    that cannot be used.
    """
    from nsbench.studies import STUDIES, find_study

    if args.name == "list":
        for study in STUDIES:
            say(f"  {study.name:<12} {study.question}")
        return FINE
    study = find_study(args.name)
    os.environ.update(dict.fromkeys(LIBRARY_THREADS, "1"))  # as in workers: the same numbers
    from nsbench.cli.option_values import check_cluster_options, check_worker_options

    check_worker_options(args)
    check_cluster_options(args)
    say(study.question)
    folder = Path(args.out)
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"{folder} is a file; a folder is needed")
    try:
        path = _conduct(study, folder, args, say)
    except ArithmeticError as e:
        say(f"the study contradicts itself or what it takes for proven: {e}")
        return FAILED
    say(f"finding: {path}")
    for page in _write_pages(folder, study.name):
        say(f"report: {page}")
    return FINE


def _conduct(study, folder: Path, args: argparse.Namespace, say: Callable[..., None]) -> Path:
    """Conduct the study and write its finding; the full form keeps a journal of its parts."""
    from nsbench.studies.finding import FOLDER, Effort, write_finding
    from nsbench.studies.part_journal import PartJournal

    began = time.monotonic()
    parts = folder / FOLDER / f"{study.name}.parts.jsonl"
    journal = PartJournal(parts if args.full else None, study.name)
    with _workers(args) as workers:
        finding = study.load().conduct(Effort(args.full, journal, say, workers))
    if journal.reused:
        say(f"{journal.reused} parts were known from an earlier run")
    say(finding.short)
    say(finding.answer)
    return write_finding(finding, folder, time.monotonic() - began, args.full)


def _workers(args: argparse.Namespace) -> contextlib.AbstractContextManager:
    """Return the workers of the options, to be entered; of None this process does all parts."""
    from nsbench.execute.dry_run import worker_count

    if args.dask is not None:
        from nsbench.execute.cluster.chores import cluster_workers

        return cluster_workers(args.dask, args.memory)
    jobs = worker_count(args) if args.full else args.jobs or 1
    if jobs == 1 and args.memory is None:  # a limit can be kept of another process only
        return contextlib.nullcontext()
    from nsbench.execute.workers.chores import chore_workers

    return chore_workers(jobs, args.memory)


def _write_pages(folder: Path, name: str) -> list[Path]:
    """Write the page of the study, and the report of the folder's runs where there are any."""
    from nsbench.report import write_report
    from nsbench.report.study_pages import write_study_page
    from nsbench.results.consistency import check

    pages = [write_study_page(folder, name)]
    if exists(folder / "runs.parquet"):
        check(folder)
        pages.append(write_report(folder, folder / "report.html"))
    return pages

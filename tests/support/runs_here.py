"""Rows that the command line asks for are made in the process of the tests.

A worker takes a second and more to start. Where a test asks what becomes of rows (files, tables,
judgements, exit codes), and not who makes them, the fixture `runs_here` makes them without one.
"""

from nsbench.results.row_reuse import read_by
from nsbench.study.attempt import run_batch


def run_all(batches, jobs, timeout, on_row, chores=(), **more):
    """As nsbench.execute.workers.pool.run_all, without workers: no limit is kept, chores are left
    to those who ask for them."""
    for batch in batches:
        for i, row in run_batch(batch):
            read = read_by(batch[i])
            on_row(batch[i], row | {"warnings": 0} | ({"read": read} if read else {}))
    return []


def patch_runs(monkeypatch):
    """What `nsbench run` and `nsbench calibrate` run is run here, until the patch is undone."""
    monkeypatch.setattr("nsbench.execute.suite.run_all", run_all)
    monkeypatch.setattr("nsbench.execute.missing_references.run_all", run_all)
    monkeypatch.setattr("nsbench.gate.calibrate.run_all", run_all)

"""Chores on a cluster: their values, what they raise, and nothing left when their client stops."""

import math
import operator
import os
import signal
import time

import psutil
import pytest
from local_cluster import cluster

from nsbench.execute.cluster import chores
from nsbench.execute.cluster import client as far
from nsbench.execute.cluster.chores import cluster_workers
from nsbench.execute.cluster.remote_worker import Limits, fingerprint
from nsbench.execute.workers.worker import LostChore


@pytest.fixture(scope="module")
def address():
    with cluster(2, DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES="1") as (where, _):
        yield where


def test_values_of_chores_come_as_they_end_and_what_one_raises_is_raised(address):
    tasks = [(math.sqrt, (n,)) for n in range(3)]
    found = {}
    with cluster_workers(address) as workers:
        workers(tasks, found.__setitem__)
        with pytest.raises(ArithmeticError, match="^ZeroDivisionError: division"):
            workers([(operator.truediv, (1, 0))], found.__setitem__)
        with pytest.raises(LostChore, match="_exit was not done. The worker died"):
            workers([(os._exit, (3,))], found.__setitem__)
    assert found == {n: math.sqrt(n) for n in range(3)}


def test_an_interrupt_keeps_the_values_there_are_and_ends_the_processes_of_the_cluster(address):
    found = {}

    def on_value(number, value):
        found[number] = value
        os.kill(os.getpid(), signal.SIGINT)

    tasks = [(os.getpid, ()), (time.sleep, (600.0,))]
    with pytest.raises(KeyboardInterrupt), cluster_workers(address) as workers:
        workers(tasks, on_value)
    assert [*found] == [0]  # of two tasks
    until = time.monotonic() + 30.0
    while psutil.pid_exists(found[0]) and time.monotonic() < until:
        time.sleep(0.05)
    assert not psutil.pid_exists(found[0])


def test_chores_of_workers_unlike_this_installation_are_refused(address):
    here = fingerprint() | {"numpy": "1.0"}
    with far.connect_client(address) as client:
        request = Limits(None), "chores", here
        with pytest.raises(far.ClusterError, match="that joined is not like this"):
            chores._compute(client, address, request, [(os.getpid, ())], print)

"""Who waits for a compilation is told what for; files and pipes are not."""

import io
import os
import subprocess
import sys

import pytest
from numba.core import event

from nsbench.compilation.announcement import announced_compilation
from nsbench.compilation.decorators import inner_kernel
from nsbench.linalg.sparse_ldl import slack


class Terminal(io.StringIO):
    def isatty(self):
        return True


def compile_of(kernel):
    with event.trigger_event("numba:compile", data={"dispatcher": kernel}):
        pass


@inner_kernel
def nothing():
    """Return nothing."""


def test_a_stored_kernel_is_announced_once_a_call(monkeypatch):
    """Kernels that it calls are compiled within, and one that is not stored is no kernel to wait
    for."""
    monkeypatch.setattr(sys, "stderr", Terminal())
    compile_of(slack)
    with announced_compilation("pbd"):
        compile_of(nothing)
        assert sys.stderr.getvalue() == ""
        compile_of(slack)
        compile_of(slack)
        with announced_compilation("error bars"):
            compile_of(slack)
        compile_of(slack)
    compile_of(slack)
    said = sys.stderr.getvalue().splitlines()
    assert [line.split(",")[0] for line in said] == [
        "nsbench: compiling pbd",
        "nsbench: compiling error bars",
    ]


def test_nothing_is_said_to_a_file(monkeypatch):
    """What a program writes is its own."""
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with announced_compilation("pbd"):
        compile_of(slack)
    assert sys.stderr.getvalue() == ""


class Broken(Terminal):
    def write(self, text):
        raise OSError("no terminal any more")


@pytest.mark.parametrize("stream", [None, Broken(), "closed"])
def test_a_stream_that_cannot_be_written_to_stops_nothing(monkeypatch, stream):
    """Programs without a terminal have no stderr, and daemons close it."""
    if stream == "closed":
        stream = io.StringIO()
        stream.close()
    monkeypatch.setattr(sys, "stderr", stream)
    with announced_compilation("pbd"):
        compile_of(slack)


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="no terminals for other processes here")
def test_a_first_call_in_a_terminal_says_that_it_compiles(tmp_path):
    """And the second one, in another process, loads what the first one stored."""
    code = "import nsbench; nsbench.solve('apple_filippov', 'euler', h=0.1)"
    said = [in_terminal(code, tmp_path) for _ in range(2)]
    assert said[0].startswith("nsbench: compiling euler, once") and said[0].count("\n") == 1
    assert said[1] == ""


def in_terminal(code, folder) -> str:
    """Return what a process writes to stderr, which is a terminal."""
    ours, theirs = os.openpty()
    env = os.environ | {"NUMBA_CACHE_DIR": str(folder), "XDG_CACHE_HOME": str(folder)}
    subprocess.run([sys.executable, "-c", code], check=True, stderr=theirs, env=env)
    os.close(theirs)
    found = b""
    while True:
        try:
            part = os.read(ours, 4096)
        except OSError:  # the other end is closed
            break
        if not part:
            break
        found += part
    os.close(ours)
    return found.decode().replace("\r\n", "\n")

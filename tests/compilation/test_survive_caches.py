"""Machine code that others could have written is not run: kernels are kept where nobody else
writes. What was damaged on the disk is compiled again."""

import importlib.util
import marshal
import os
import shutil
import stat
import struct
import subprocess
import sys
from pathlib import Path

import pytest

import nsbench
from nsbench.compilation.numba_cache import has_private_files
from nsbench.results.journal import settled
from nsbench.trajectory import MACHINE, machine_fault

CODE = """
import numba, nsbench.linalg.sparse_ldl as d, numpy as np
d.slack.py_func
print(d.slack._cache.cache_path)
"""


@pytest.mark.survives("no pickle")
@pytest.mark.skipif(not hasattr(os, "getuid"), reason="no owners of files here")
def test_kernels_move_where_others_could_replace_them(tmp_path):
    """A copy of the package in a folder that everybody can write to."""
    home = Path(nsbench.__file__).parent
    shutil.copytree(home, tmp_path / "nsbench", ignore=shutil.ignore_patterns("__pycache__"))
    env = os.environ | {
        "PYTHONPATH": str(tmp_path),
        "XDG_CACHE_HOME": str(tmp_path / "own"),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    env.pop("NUMBA_CACHE_DIR", None)
    place = lambda: Path(
        subprocess.run(
            [sys.executable, "-c", CODE],
            env=env,
            cwd=tmp_path,
            check=True,
            capture_output=True,
            text=True,
        ).stdout.strip()
    )
    kernels = tmp_path / "nsbench" / "linalg"
    kernels.chmod(0o755)
    assert place() == kernels / "__pycache__"
    (kernels / "__pycache__").mkdir(exist_ok=True)
    (kernels / "__pycache__").chmod(0o777)
    moved = place()
    assert moved.is_relative_to(tmp_path / "own" / "nsbench" / "kernels")
    assert stat.S_IMODE((tmp_path / "own" / "nsbench" / "kernels").stat().st_mode) == 0o700


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="no owners of files here")
@pytest.mark.parametrize(
    "mode, good", [(0o700, True), (0o755, True), (0o775, False), (0o777, False), (0o722, False)]
)
def test_who_can_write_to_a_folder(tmp_path, mode, good):
    (tmp_path / "f").mkdir()
    (tmp_path / "f").chmod(mode)
    assert (
        has_private_files(tmp_path / "f")
        == has_private_files(tmp_path / "f" / "not" / "yet")
        == good
    )


FACTOR = 1.3671875  # of the kernel below
KERNEL = f"""
from numba import njit

@njit(cache=True)
def scaled(x):
    return {FACTOR} * x
"""


def cut(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def flip(path):
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 16
    path.write_bytes(data)


def empty(path):
    path.write_bytes(b"")


def zeros(path):
    path.write_bytes(bytes(path.stat().st_size))


def folder(path):
    path.unlink()
    path.mkdir()


def fifo(path):
    path.unlink()
    os.mkfifo(path)


def link(path):
    path.unlink()
    path.symlink_to("nowhere")


DAMAGES = (empty, cut, flip, zeros, folder, fifo, link)


def loaded(place):
    """The kernel of a file as another process imports it."""
    spec = importlib.util.spec_from_file_location("stored_kernel", place / "stored_kernel.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.scaled


def hits(kernel):
    return sum(kernel.stats.cache_hits.values())


@pytest.fixture
def stored(tmp_path):
    """Folder of a kernel, and a function that gives its files of one kind on the disk."""
    (tmp_path / "stored_kernel.py").write_text(KERNEL)
    kernel = loaded(tmp_path)
    assert kernel(2.0) == 2.0 * FACTOR
    cache = Path(kernel._cache.cache_path)
    return tmp_path, lambda kind: sorted(cache.glob(f"*scaled*{kind}"))


@pytest.mark.long
@pytest.mark.survives("damaged cache")
@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no FIFOs here")
@pytest.mark.parametrize("kind", [".nbi", ".nbc"])
@pytest.mark.parametrize("damage", DAMAGES, ids=lambda f: f.__name__)
def test_a_damaged_kernel_is_compiled_again(stored, kind, damage):
    place, files = stored
    again = loaded(place)
    assert again(2.0) == 2.0 * FACTOR and hits(again) == 1
    damage(files(kind)[0])
    mending = loaded(place)
    assert mending(2.0) == 2.0 * FACTOR and hits(mending) == 0
    if damage is not folder:  # which no file can replace
        mended = loaded(place)
        assert mended(2.0) == 2.0 * FACTOR and hits(mended) == 1


@pytest.mark.survives("damaged cache")
def test_a_constant_that_changed_in_stored_code_is_not_computed_with(stored):
    """As bits that flip on a disk do; the file can be read as before."""
    place, files = stored
    path = files(".nbc")[0]
    data = path.read_bytes()
    assert struct.pack("<d", FACTOR) in data
    path.write_bytes(data.replace(struct.pack("<d", FACTOR), struct.pack("<d", 1.35 * FACTOR)))
    assert loaded(place)(2.0) == 2.0 * FACTOR


@pytest.mark.survives("damaged cache")
def test_code_of_another_signature_is_not_taken_for_its_own(stored):
    place, files = stored
    before = {*files(".nbc")}
    assert loaded(place)(2) == 2.0 * FACTOR  # of an integer
    of_float = before.pop()
    of_integer = next(p for p in files(".nbc") if p != of_float)
    shutil.copy(of_integer, of_float)
    kernel = loaded(place)
    assert kernel(0.5) == 0.5 * FACTOR and hits(kernel) == 0
    assert len(files(".nbc")) == 2


@pytest.mark.survives("damaged cache")
def test_a_cache_that_cannot_be_written_costs_time_only(stored):
    place, files = stored
    kernel = loaded(place)
    cache = Path(kernel._cache.cache_path)
    shutil.rmtree(cache)
    cache.write_text("a file")
    assert kernel(2.0) == 2.0 * FACTOR


@pytest.mark.survives("damaged cache")
def test_what_stored_code_raises_is_a_fault_of_the_machine(tmp_path, monkeypatch):
    """Where no checksum is held against it: numba's own files, and Python's."""
    import numba.core.caching

    (plain,) = (
        c
        for c in numba.core.caching.IndexDataCacheFile.__mro__
        if c.__module__ == "numba.core.caching"
    )
    (tmp_path / "kernel.nbi").write_bytes(b"")
    with pytest.raises(EOFError) as raised:
        plain(str(tmp_path), "kernel", "stamp").load("key")
    assert MACHINE in machine_fault(raised.value)
    row = {"status": "error", "why": f"EOFError: {machine_fault(raised.value)}"}
    assert not settled(row, None)  # the next call makes such a run again
    source = tmp_path / "helper.py"
    source.write_text("VALUE = 1.0\n")
    spec = importlib.util.spec_from_file_location("helper", source)
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    spec.loader.get_code("helper")
    code = Path(importlib.util.cache_from_source(str(source)))
    code.write_bytes(code.read_bytes()[:-9])
    with pytest.raises((EOFError, ValueError)) as raised:
        spec.loader.get_code("helper")
    assert MACHINE in machine_fault(raised.value)
    with pytest.raises(EOFError) as raised:
        marshal.loads(b"")
    assert machine_fault(raised.value) == ""  # what a case does itself is its own


def test_a_folder_that_nobody_may_look_at_is_not_private(monkeypatch, tmp_path):
    def deny(self, **_):
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "stat", deny)
    assert not has_private_files(tmp_path)

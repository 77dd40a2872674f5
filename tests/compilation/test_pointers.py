"""A drift that one process has compiled is found by the next one, bit for bit, and never in the
place of another."""

import ctypes
import json
import math
import os
import pickle
import subprocess
import sys

import numpy as np
import pytest
from numba import njit
from numba.core.ccallback import CFunc

from nsbench.compilation import cfunc_cache, disk_cache, factories

X = np.array([0.3, -0.7, 1.9])


def turning(a):
    def drift(xp):
        inner = leaf(a)(xp)
        return lambda t, x: xp.sin(a * t) * x[::-1] + inner(t, x)

    return drift


def leaf(a):
    def drift(xp):
        return lambda t, x: xp.ones_like(x) / (a + xp.abs(x))

    return drift


def plain(c):
    def drift(xp):
        def f(t, x):
            return c * x + t

        return f

    return drift


@njit
def call(f, t, x, out):
    f(t, x, out)


def value(factory, form_of=factories.rhs_cfunc.__wrapped__):
    """(kind of pointer, value) without the memory of this process."""
    pointer = form_of(factory, X.size)
    out = np.full(X.size, 7.0)
    call(pointer, 0.4, X, out)
    return kind_of(pointer), out


def kind_of(pointer):
    """Was the function compiled, or found on disk?"""
    return "compiled" if isinstance(pointer.owner, CFunc) else "found"


@pytest.fixture
def home(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("NSBENCH_CACHE", raising=False)
    disk_cache.cache_folder.cache_clear()
    yield tmp_path / "nsbench" / "pointers"
    monkeypatch.undo()
    disk_cache.cache_folder.cache_clear()


@pytest.mark.long
def test_what_is_found_has_the_bits_of_what_was_compiled(home):
    drifts = [
        plain(2.0),
        plain(3.0),
        turning(1.5),
        turning(0.1),
        leaf(0.5),
    ]  # two of each name, in one process
    first = [value(d) for d in drifts]
    assert [kind for kind, _ in first] == ["compiled"] * 5 and len(list(home.iterdir())) == 5
    again = [value(d) for d in (plain(2.0), plain(3.0), turning(1.5), turning(0.1), leaf(0.5))]
    assert [kind for kind, _ in again] == ["found"] * 5
    for (_, a), (_, b), drift in zip(first, again, drifts, strict=True):
        assert np.array_equal(a, b) and np.abs(b - drift(np)(0.4, X)).max() < 1e-15
    assert value(plain(2.0 + 1e-15))[0] == "compiled"


SCRIPT = """
import json, sys
from nsbench import get_case, solve
from nsbench.compilation import factories as form
c, out = get_case("two_discs"), []
kind = type(form.rhs_cfunc(c.problem.drift, c.n).owner).__name__
for case, spec in (("two_discs", "pbd"), ("sliding", "euler")):
    traj = solve(case, spec, h=0.05)
    out.append([traj.x.tolist(), traj.impulse.tolist()])
print(json.dumps([out, kind]))
"""


@pytest.mark.long
def test_another_process_finds_it(home):
    def run(cache):
        return json.loads(
            subprocess.run(
                [sys.executable, "-c", SCRIPT],
                capture_output=True,
                text=True,
                check=True,
                env=os.environ | {"NSBENCH_CACHE": cache},
            ).stdout
        )

    without = run("off")
    assert not list(home.iterdir()) if home.exists() else True
    first = run("")
    second = run("")
    assert without[0] == first[0] == second[0]
    assert (first[1], second[1]) == ("CFunc", "ExecutionEngine")


@pytest.mark.long
@pytest.mark.parametrize(
    "harm",
    [
        lambda body: b"",
        lambda body: b"{}\n" + body.partition(b"\n")[2],
        lambda body: body.partition(b"\n")[0] + b"\n",
        lambda body: body.partition(b"\n")[0] + b"\nno object file",
        lambda body: b"[1]\n" + body,
        lambda body: b"\xff\xfe\n",
        lambda body: body.replace(b'"name": "', b'"name": "un', 1),
    ],
    ids=["empty", "no name", "no code", "no object", "a list", "no text", "no such function"],
)
def test_a_file_of_no_use_is_compiled_again(home, harm):
    _, right = value(plain(2.0))
    (file,) = home.iterdir()
    name = file.stem
    body = disk_cache.read(home, file.stem)
    disk_cache.write(home, name, harm(body))
    kind, again = value(plain(2.0))
    assert kind == "compiled" and np.array_equal(again, right)
    assert disk_cache.read(home, name) is not None and value(plain(2.0))[0] == "found"
    file.write_bytes(file.read_bytes()[:-1])  # its checksum does not fit
    assert value(plain(2.0))[0] == "compiled"


def test_a_pickle_is_not_read(home):
    value(plain(2.0))
    (file,) = home.iterdir()
    harm = home.parent / "touched"
    disk_cache.write(home, file.stem, pickle.dumps(Harm(harm)))
    assert value(plain(2.0))[0] == "compiled" and not harm.exists()


class Harm:
    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return type(self.path).touch, (self.path,)


def test_what_others_could_write_is_not_run(home):
    value(plain(2.0))
    home.chmod(0o777)
    disk_cache.cache_folder.cache_clear()
    assert value(plain(2.0))[0] == "compiled"


def test_a_compiled_helper_is_told_by_its_source(home):
    def calling(power):
        @njit
        def helper(t):
            return t**power

        def drift(xp):
            return lambda t, x: helper(t) * x

        return drift

    values = [value(calling(p)) for p in (2, 3, 2)]
    assert [kind for kind, _ in values] == ["compiled", "compiled", "found"]
    assert np.abs(values[1][1] - 0.4**3 * X).max() < 1e-15 > np.abs(values[0][1] - 0.4**2 * X).max()
    assert np.array_equal(values[0][1], values[2][1])


def test_an_address_of_this_process_is_not_kept(home):
    there = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(("cos", ctypes.CDLL(None)))

    def drift(xp):
        return lambda t, x: there(t) * x

    assert value(drift)[0] == "compiled" and np.array_equal(value(drift)[1], math.cos(0.4) * X)
    signature = factories.rhs_cfunc.__wrapped__(plain(2.0), 3).signature
    before = set(home.iterdir())

    def fill(t, x, out):
        out[0] = there(t)

    cfunc_cache.compiled("name", signature, fill)
    assert set(home.iterdir()) == before


def test_another_setting_of_numba_is_another_name(home, monkeypatch):
    from numba import config

    f = plain(2.0)(np)
    signature = factories.rhs_cfunc.__wrapped__(plain(2.0), 3).signature
    name = cfunc_cache.name_of(signature, "what", f)
    assert (
        name
        == cfunc_cache.name_of(signature, "what", plain(2.0)(np))
        != cfunc_cache.name_of(signature, "other", f)
    )
    monkeypatch.setattr(config, "BOUNDSCHECK", 1)
    assert cfunc_cache.name_of(signature, "what", f) != name


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("fault", ["x[4]", "1.0 / (t - t)", "raised", "told"])
def test_a_drift_that_raises_leaves_no_number_wherever_it_is_from(home, fault):
    def drift(xp):
        def f(t, x):
            if fault == "1.0 / (t - t)":
                return x * (1.0 / (t - t))
            if fault == "raised" and t > 0.0:
                raise ValueError("a sentence")
            if fault == "told" and t > 0.0:
                raise ValueError("a sentence", t)
            return x * np.linalg.inv(np.zeros((2, 2)))[0, 0]

        return f

    for _ in range(2):
        kind, out = value(drift)
        assert np.all(np.isnan(out))
    assert kind == ("compiled" if fault == "told" else "found")


def test_threads_do_not_change_the_name(monkeypatch):
    """A process bound to fewer processors finds what another one has compiled."""
    from numba import config, float64

    function = turning(0.5)(np)
    name = cfunc_cache.name_of(float64(float64), "threads", function)
    for setting in ("NUMBA_NUM_THREADS", "NUMBA_DEFAULT_NUM_THREADS"):
        monkeypatch.setattr(config, setting, getattr(config, setting) + 1)
        assert cfunc_cache.name_of(float64(float64), "threads", function) == name
    monkeypatch.setattr(config, "OPT", 1)
    assert cfunc_cache.name_of(float64(float64), "threads", function) != name


@pytest.mark.parametrize("error", [OSError("no space is left"), MemoryError()])
def test_an_error_of_the_machine_is_not_said_to_be_of_the_drift(home, monkeypatch, error):
    """A drift that only failed to be stored or compiled for want of room can be compiled."""

    def compiled(*_):
        raise error

    monkeypatch.setattr(cfunc_cache, "compiled", compiled)
    with pytest.raises(type(error)):
        value(turning(1.9))

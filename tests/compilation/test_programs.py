"""A compiled program is found again by what it was made from, in another process too, and never for
something else."""

import functools
import json
import math
import subprocess
import sys

import numpy as np
import pytest

from nsbench import Affine, Complementarity, Distance, get_case, solve
from nsbench.compilation import jax_cache
from nsbench.compilation.disk_cache import cache_folder as kept_folder
from nsbench.compilation.function_digest import Unknown, fingerprint
from nsbench.solvers.penalty import program

SCALE = 2.0
TABLE = {"a": [1.0, 2.0]}


def helper(x):
    return SCALE * x


def make(c, call=helper, power=1.0):
    def drift(xp):
        def f(t, x):
            return -c * call(x) ** power + TABLE["a"][0]

        return f

    return drift


def other(c, call=helper, power=1.0):
    def drift(xp):
        def f(t, x):
            return +c * call(x) ** power + TABLE["a"][0]

        return f

    return drift


def again(number):
    """Two closures of one name, met in different places."""

    def leaf(v):
        return lambda t: v

    a = leaf(1.0)
    b = leaf(2.0)
    return [(a, b, a), (a, b, b)][number]


def test_what_differs_has_another_fingerprint(monkeypatch):
    same = fingerprint(make(1.0))
    assert same == fingerprint(make(1.0)) and len(same) == 64
    different = [
        make(2.0),
        make(1.0, lambda x: SCALE * x),
        make(1.0, power=2.0),
        other(1.0),
        make(np.float64(1.0)),
        make(np.ones(2)),
        make(np.zeros(2)),
        make(np.zeros((2, 1))),
        make(1),
        make(True),
        make(-1.0),
        make(0.0),
        make(-0.0),
        make(1.0, functools.partial(pow, 2.0)),
        make(1.0, np.sin),
        make(1.0, np.cos),
        make(1.0, math.sin),
    ]
    prints = [fingerprint(d) for d in different]
    assert len({*prints, same}) == len(prints) + 1
    assert fingerprint(again(0)) != fingerprint(again(1))
    assert (
        fingerprint(Distance(2.0))
        != fingerprint(Distance(2.0, dim=3))
        != fingerprint(Distance(radii=np.ones(3), dim=3))
    )
    monkeypatch.setitem(TABLE, "a", [3.0, 2.0])
    assert fingerprint(make(1.0)) != same
    monkeypatch.undo()
    monkeypatch.setattr(sys.modules[__name__], "SCALE", 3.0)
    assert fingerprint(make(1.0)) != same


class Foreign:
    def __call__(self, x):
        return x


def test_what_cannot_be_told_has_none():
    def drawing(xp):
        return lambda t, x: np.random.default_rng().normal() + x

    def reading(xp):
        return lambda t, x: float(open("x").read()) + x

    def importing(xp):
        import json

        return lambda t, x: json.loads("1") * x

    for bad in (
        make(Foreign()),
        make(1.0, Foreign()),
        drawing,
        reading,
        importing,
        make(sys.modules[__name__]),
    ):
        with pytest.raises(Unknown):
            fingerprint(bad)


def test_every_case_of_the_catalogue_has_one_and_no_two_share_it():
    from nsbench.study.plan import resolve, suite_cases

    seen = {}
    for key in suite_cases("standard"):
        case = resolve(key)
        seen.setdefault((fingerprint(case.problem), case.n), []).append(key)
    shared = [keys for keys in seen.values() if len(keys) > 1]
    assert (
        all(len({str(get_case(k).problem.constraints) for k in keys}) == 1 for keys in shared)
        if shared
        else True
    )
    assert len(seen) > 35


@pytest.mark.long
def test_a_case_made_again_is_no_other_case():
    a = get_case("discs", n=3)
    b = get_case("discs", n=3)
    assert a.problem is not b.problem
    how = (a.n, len(a.t), "tsit5", "pairs")
    assert program.compiled(a.problem, *how) is program.compiled(b.problem, *how)
    c = get_case("discs", n=3, seed=1)
    assert program.compiled(c.problem, *how) is not program.compiled(a.problem, *how)


SCRIPT = """
import json, sys
from nsbench import solve
traj = solve("three_discs", sys.argv[1], k=200.0)
print(json.dumps([traj.x.tolist(), traj.impulse.tolist(), "diffrax" in sys.modules]))
"""


def spoil(file):
    file.write_bytes(file.read_bytes()[:-100])


@pytest.mark.long
@pytest.mark.parametrize(
    "spec, harm", [("penalty", spoil), ("penalty[method=kvaerno3]", lambda file: file.unlink())]
)
def test_another_process_neither_traces_nor_compiles(tmp_path, monkeypatch, spec, harm):
    """The first one traces, the second finds the program (and LAPACK, which an implicit one calls);
    a spoilt file or none is made again; each gives the same bits."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    def run():
        return json.loads(
            subprocess.run(
                [sys.executable, "-c", SCRIPT, spec], capture_output=True, text=True, check=True
            ).stdout
        )

    first = run()
    second = run()
    (file,) = (tmp_path / "nsbench" / "programs").glob("*.bin")
    assert first[2] and not second[2] and first[:2] == second[:2]
    harm(file)
    third = run()
    assert third[2] and third[:2] == first[:2]


@pytest.mark.long
def test_what_another_cache_gave_is_not_kept(tmp_path, monkeypatch):
    """JAX's own cache, where the user has one, is used but not copied: a copy would lack its
    functions."""
    for name, value in (
        ("JAX_COMPILATION_CACHE_DIR", str(tmp_path / "jax")),
        ("XDG_CACHE_HOME", str(tmp_path)),
        ("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0"),
        ("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1"),
    ):
        monkeypatch.setenv(name, value)
    kept = tmp_path / "nsbench" / "programs"

    def run(cache):
        monkeypatch.setenv("NSBENCH_CACHE", cache)
        return json.loads(
            subprocess.run(
                [sys.executable, "-c", SCRIPT, "penalty"],
                capture_output=True,
                text=True,
                check=True,
            ).stdout
        )

    first = run("off")
    assert list((tmp_path / "jax").iterdir())
    second = run("")
    assert not list(kept.iterdir()) and run("") == second == first


def test_a_kept_program_that_does_not_run_is_compiled_again():
    import jax

    def broken(*_):
        raise jax.errors.JaxRuntimeError("NOT_FOUND: Function fusion not found")

    made = []
    kept = jax_cache.CachedProgram(broken, lambda: made.append(1) or (lambda x: {"y": x}))
    assert kept(3.0) == {"y": 3.0} == kept(3.0) and made == [1]
    with pytest.raises(jax.errors.JaxRuntimeError):
        jax_cache.CachedProgram(broken)(3.0)


def test_what_others_could_write_is_not_run(tmp_path, monkeypatch):
    home = tmp_path / "nsbench" / "programs"
    home.mkdir(parents=True)
    home.chmod(0o777)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    kept_folder.cache_clear()
    try:
        assert jax_cache.folder() is None
        home.chmod(0o700)
        kept_folder.cache_clear()
        assert jax_cache.folder() == home
        monkeypatch.setenv("NSBENCH_CACHE", "off")
        kept_folder.cache_clear()
        assert jax_cache.folder() is None
    finally:
        monkeypatch.undo()
        kept_folder.cache_clear()


def test_without_a_fingerprint_the_text_decides(tmp_path, monkeypatch):
    monkeypatch.setattr(jax_cache, "folder", lambda: tmp_path)
    odd = Foreign()

    def drift(xp):
        return lambda t, x: odd(-x)

    tide = get_case("tide")
    runs = [
        solve(
            tide.replace(problem=Complementarity(drift, (Affine(np.eye(1), np.zeros(1)),))),
            "penalty",
            k=50.0,
        )
        for _ in range(2)
    ]
    assert (
        runs[0].status.ok
        and np.array_equal(runs[0].x, runs[1].x)
        and len(list(tmp_path.glob("*.bin"))) == 1
    )


def test_what_calls_back_into_this_process_is_not_kept(tmp_path, monkeypatch):
    import jax

    monkeypatch.setattr(jax_cache, "folder", lambda: tmp_path)

    def drift(xp):
        return lambda t, x: (
            jax.pure_callback(np.negative, jax.ShapeDtypeStruct(x.shape, x.dtype), x)
            if xp is not np
            else -x
        )

    problem = Complementarity(drift, (Affine(np.eye(1), np.zeros(1)),))
    assert solve(get_case("tide").replace(problem=problem), "penalty", k=50.0).status.ok
    assert not list(tmp_path.iterdir())


@pytest.mark.survives("no pickle")
def test_a_kept_program_is_no_pickle(tmp_path, monkeypatch):
    """A line of JSON and XLA's machine code; reading it never comes near pickle, and a pickle in
    its place is not read."""
    import hashlib
    import pickle
    from pathlib import Path

    import nsbench

    sources = [p for p in Path(nsbench.__file__).parent.rglob("*.py") if p.parent.name != "tests"]
    assert not [
        p.name
        for p in sources
        if "import pickle" in p.read_text() or "serialize_executable import" in p.read_text()
    ]
    monkeypatch.setattr(jax_cache, "folder", lambda: tmp_path)
    harm = tmp_path / "touched"
    body = pickle.dumps(Harm(harm))
    (tmp_path / "name.bin").write_bytes(hashlib.sha256(body).digest() + body)
    assert jax_cache._load("name") is None and not harm.exists()
    pickle.loads(body)
    assert harm.exists()  # what reading it as a pickle would have done


class Harm:
    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return type(self.path).touch, (self.path,)


def test_a_program_that_needs_more_than_its_code_is_not_packed():
    import jax
    import jax.numpy as jnp

    from nsbench.compilation.jax_serialization import pack, unpack

    jax_cache.float64()
    with pytest.raises((ValueError, NotImplementedError)):
        pack(jax.jit(lambda x, *, y: {"a": x + y}).lower(jnp.ones(3), y=2.0).compile(), False)
    made = (
        jax.jit(lambda x, pair: {"b": x + pair[0], "a": 2 * x})
        .lower(jnp.ones(3), (1.0, (jnp.ones(2), 5)))
        .compile()
    )
    again = unpack(pack(made, False))  # two arguments are not used: the program does not have them
    out = again(np.arange(3.0), (2.0, (np.ones(2), 5)))
    assert np.array_equal(out["b"], [2.0, 3.0, 4.0]) and np.array_equal(out["a"], [0.0, 2.0, 4.0])

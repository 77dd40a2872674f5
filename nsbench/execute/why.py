"""Why a run is made again: what of it is not as it was when its row was written."""
from __future__ import annotations

from pathlib import Path

from nsbench import store
from nsbench.keys import Part
from nsbench.study import Spec

NEW, SIZE, OTHER = "new", "new accuracy", "made by a version that did not say of what"
MOST = 3                  # changes that are told; the others are counted


def reasons(specs: list[Spec], parts: dict[Spec, tuple[Part, ...]], keys: dict[Spec, str], known: dict, out: Path,
            force: bool) -> dict[Spec, str]:
    """For every run a few words why it is to be made, "" where its row is reused. known: rows by key that may be reused."""
    made, items = store.read_parts(out)
    rows = store.read_journal(out)
    pairs = {key[:2] for key in made}
    told: dict[tuple, str] = {}           # runs of one case and solver have changed alike
    answer = {}
    for s in specs:
        was = made.get((s.case, s.solver, s.accuracy, repr(float(s.asked))))
        if keys[s] in known and not force:
            answer[s] = ""
        elif was is None:
            answer[s] = SIZE if (s.case, s.solver) in pairs else NEW
        elif keys[s] in rows:
            answer[s] = "forced" if force else f"ended with {rows[keys[s]].get('status')}"
        else:
            now = tuple(p.digest for p in parts[s])
            if (*was, *now) not in told:
                told[*was, *now] = _changes([items.get(d) for d in was], [dict(p.items) for p in parts[s]])
            answer[s] = told[*was, *now]
    return answer


def _changes(old: list[dict | None], new: list[dict]) -> str:
    if not old or any(o is None for o in old):
        return OTHER
    before, after = ({k: v for part in parts for k, v in part.items()} for parts in (old, new))
    words = [_change(k, before.get(k), after.get(k)) for k in sorted(before.keys() | after.keys())
             if before.get(k) != after.get(k)]
    if not words:
        return "asked for otherwise"
    return "; ".join(words[:MOST]) + (f"; {len(words) - MOST} more" if len(words) > MOST else "")


def _change(name: str, old: str | None, new: str | None) -> str:
    """One item in words: a file has changed, a version is another one."""
    if name.endswith(tuple(".py .npz .json .csv .txt".split())) or "/" in name:
        return f"{name} {'is used now' if old is None else 'is used no more' if new is None else 'changed'}"
    return f"{name} {old or 'none'} -> {new or 'none'}"

"""Why a run is made again: what of it is not as it was when its row was written."""

from __future__ import annotations

from pathlib import Path

from nsbench.results.journal import read_journal, read_parts
from nsbench.results.row_reuse import CHANGED_DURING_RUN, READ, changed_data
from nsbench.results.run_key import PACKAGE, VARIABLE, Part
from nsbench.study import Spec

NEW = "new"
SIZE = "new accuracy"
OTHER = "made by a version that did not say of what"
MOST = 3  # changes that are told; the others are counted


def rerun_reasons(
    specs: list[Spec],
    parts: dict[Spec, tuple[Part, ...]],
    keys: dict[Spec, str],
    known: dict,
    out: Path,
    force: bool,
) -> dict[Spec, str]:
    """For every run a few words why it is to be made, "" where its row is reused. known: rows by
    key that may be reused."""
    made, items = read_parts(out)
    rows = read_journal(out)
    data = changed_data(out, specs, keys)
    pairs = {key[:2] for key in made}
    told: dict[tuple, str] = {}  # runs of one case and solver have changed alike
    answer = {}
    for s in specs:
        was = made.get((s.case, s.solver, s.accuracy, repr(float(s.asked))))
        if keys[s] in known and not force:
            answer[s] = ""
        elif was is None:
            answer[s] = SIZE if (s.case, s.solver) in pairs else NEW
        elif s in data and not force:
            answer[s] = "; ".join(f"{name.partition(': ')[2]} changed" for name in data[s])
        elif keys[s] in rows and was and not _touched(was, items):
            answer[s] = "forced" if force else f"ended with {rows[keys[s]].get('status')}"
        else:
            now = tuple(p.digest for p in parts[s])
            if (*was, *now) not in told:
                told[*was, *now] = _changes(
                    [items.get(d) for d in was], [dict(p.items) for p in parts[s]]
                )
            answer[s] = told[*was, *now]
    return answer


def _touched(was: list[str], items: dict[str, dict]) -> str:
    """The files that changed while the last row was made, of which it is therefore not certain what
    made it."""
    return next(
        (items[d][CHANGED_DURING_RUN] for d in was if CHANGED_DURING_RUN in items.get(d, ())), ""
    )


def _changes(old: list[dict | None], new: list[dict]) -> str:
    if not old or any(o is None for o in old):
        return OTHER
    old = [{k: v for k, v in part.items() if not k.startswith(READ)} for part in old]
    if touched := next(
        (part[CHANGED_DURING_RUN] for part in old if CHANGED_DURING_RUN in part), ""
    ):
        return f"{touched} {CHANGED_DURING_RUN}"
    before, after = ({k: v for part in parts for k, v in part.items()} for parts in (old, new))
    words = [
        _change(k, before.get(k), after.get(k))
        for k in sorted(before.keys() | after.keys())
        if before.get(k) != after.get(k)
    ]
    if not words:
        return "asked for otherwise"
    return "; ".join(words[:MOST]) + (f"; {len(words) - MOST} more" if len(words) > MOST else "")


def _change(name: str, old: str | None, new: str | None) -> str:
    """One item in words: a file has changed, a version is another one."""
    of_content = name == PACKAGE or name.startswith(VARIABLE) or "/" in name
    if of_content or name.endswith((".py", ".npz", ".json", ".csv", ".txt")):
        return (
            f"{name} "
            f"{'is used now' if old is None else 'is used no more' if new is None else 'changed'}"
        )
    return f"{name} {old or 'none'} -> {new or 'none'}"

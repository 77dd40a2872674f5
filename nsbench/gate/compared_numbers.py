"""Numbers that `nsbench compare` sets side by side: per folder its facts, orders and seconds.

Facts (nsbench.gate.facts) are what a baseline could hold; seconds are not among them.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from nsbench.gate.facts import Fact, facts
from nsbench.report.data import Data, Runs, read
from nsbench.results.consistency import check

Key = tuple[str, str, str, str]
ORDERS = {"state order": "state half-width", "force order": "force half-width"}


@dataclass(frozen=True)
class Version:
    """Results of one version.

    facts: by (case, solver, parameters, metric). seconds: by (case, solver), of the run in the
    middle of the ladder that all versions compared share. asked: by (case, solver), the accuracies
    that ended well, with their seconds. data: all rows.
    """

    name: str
    data: Data
    facts: dict[Key, Fact]
    asked: dict[tuple[str, str], dict[float, float]]

    def number(self, key: Key) -> float:
        """Return the number of a fact, NaN where it is a word or is not there."""
        fact = self.facts.get(key)
        return math.nan if fact is None or isinstance(fact.value, str) else float(fact.value)

    def half_width(self, key: Key) -> float:
        """Return half the width of the 95 % interval of an order; NaN for any other number."""
        name = ORDERS.get(key[3])
        return self.number((*key[:3], name)) if name else math.nan


def read_versions(folders: Iterable[str]) -> list[Version]:
    """Read folders of results; a version bears the name of its folder.

    Raises what reading results raises, and ValueError where two folders bear one name.
    """
    paths = [Path(f) for f in folders]
    names = [Path(os.path.abspath(p)).name for p in paths]
    if len(set(names)) < len(names):
        names = [str(p) for p in paths]
    return [_version(name, path) for name, path in zip(names, paths, strict=True)]


def _version(name: str, path: Path) -> Version:
    check(str(path))
    data = read(str(path))
    # options of a method may differ between the two: that alone is no difference of numbers
    found = {key: replace(fact, config="") for key, fact in facts(data).items()}
    return Version(name, data, found, {key: _timed(runs) for key, runs in data.runs.items()})


def _timed(runs: Runs) -> dict[float, float]:
    seconds = runs.col["seconds"]
    good = runs.good & np.isfinite(seconds) & np.isfinite(runs.col["asked"])
    return {float(runs.col["asked"][k]): float(seconds[k]) for k in np.flatnonzero(good)}


def common_seconds(versions: list[Version]) -> dict[tuple[str, str], list[float]]:
    """Return by (case, solver) the seconds of every version, of one accuracy that all have.

    Of the accuracies in common the middle one is taken.
    """
    out = {}
    for key in versions[0].asked:
        shared = set.intersection(*({*v.asked.get(key, {})} for v in versions))
        if shared:
            at = sorted(shared)[len(shared) // 2]
            out[key] = [v.asked[key][at] for v in versions]
    return out

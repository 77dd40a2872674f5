"""Test bench for methods on Filippov and complementarity systems: errors, orders, costs."""

from importlib import import_module
from importlib.util import find_spec

_HOME = {
    "Affine": "problem",
    "Distance": "problem",
    "Smooth": "problem",
    "Complementarity": "problem",
    "Filippov": "problem",
    "LCS": "problem",
    "Hybrid": "problem",
    "Transition": "problem",
    "Case": "case",
    "Scale": "case.scale",
    "get_case": "case",
    "from_function": "case.plain_function",
    "load_case": "case",
    "solve": "solvers",
    "errors": "measure",
    "fit_order": "measure",
    "Trajectory": "trajectory",
    "Study": "study",
    "run": "study",
    "write_report": "report",
}
__all__ = list(_HOME)
__version__ = "0.1.0"


def __getattr__(name):
    if name not in _HOME:
        if name.startswith("_") or find_spec(f"nsbench.{name}") is None:
            raise AttributeError(f"module 'nsbench' has no attribute {name!r}")
        return import_module(f"nsbench.{name}")  # nsbench.solvers, nsbench.reference, ...
    value = getattr(import_module(f"nsbench.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__():
    return sorted(__all__)

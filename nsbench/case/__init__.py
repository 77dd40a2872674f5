"""Cases: problems with their data, specs such as ``discs[n=30]``, and the registry of all cases."""

from nsbench.case.definition import Case
from nsbench.case.registry import (
    broken_cases,
    broken_plugin_cases,
    case_module,
    case_names,
    get_case,
    load_case,
    load_module,
    plugin_case_file,
    plugin_case_names,
)
from nsbench.case.selection import SUITES, cases_of
from nsbench.case.spec import format_value, parse_spec, parse_value
from nsbench.input_errors import nearest

__all__ = [
    "SUITES",
    "Case",
    "broken_cases",
    "broken_plugin_cases",
    "case_module",
    "case_names",
    "cases_of",
    "format_value",
    "get_case",
    "load_case",
    "load_module",
    "nearest",
    "parse_spec",
    "parse_value",
    "plugin_case_file",
    "plugin_case_names",
]

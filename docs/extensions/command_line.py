"""Directive `command-line`: every verb with its options, read from the argument parser."""

import argparse

from docutils import nodes
from sphinx.util.docutils import SphinxDirective

from nsbench.cli.arguments import build_parser


def verbs():
    """Return the parsers of the verbs by name, in the order of the help text."""
    parser = build_parser()
    (action,) = (a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    return action.choices


def usage(parser):
    """Return the usage line in one width, whatever the terminal."""
    parser.formatter_class = lambda prog: argparse.HelpFormatter(prog, width=76)
    return parser.format_usage().removeprefix("usage: ").strip()


def arguments(parser):
    """Pairs of names and meaning of the arguments of a verb."""
    for action in parser._actions:
        if isinstance(action, argparse._HelpAction):
            continue
        names = ", ".join(action.option_strings) or action.metavar or action.dest
        if action.option_strings and action.nargs != 0:
            names += f" {action.metavar or action.dest.upper()}"
        text = (action.help or "") % {"default": action.default}
        if action.choices:
            text = f"{text} ({', '.join(map(str, action.choices))})".strip()
        yield names, text


class CommandLine(SphinxDirective):
    """Insert a section for each verb."""

    def run(self):
        """Return the sections."""
        return [section(name, parser) for name, parser in verbs().items()]


def section(name, parser):
    """Build the section of a verb: what it does, its usage, its arguments."""
    out = nodes.section(ids=[f"nsbench-{name}"])
    out += nodes.title(text=f"nsbench {name}")
    out += nodes.paragraph(text=f"{parser.description[0].upper()}{parser.description[1:]}.")
    out += nodes.literal_block(usage(parser), usage(parser), language="text")
    found = nodes.definition_list()
    for names, text in arguments(parser):
        item = nodes.definition_list_item()
        item += nodes.term("", "", nodes.literal(text=names))
        item += nodes.definition("", nodes.paragraph(text=text))
        found += item
    if found.children:
        out += found
    return out


def setup(app):
    """Register the directive."""
    app.add_directive("command-line", CommandLine)
    return {"parallel_read_safe": True}

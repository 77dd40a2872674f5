"""Command line `nsbench`: one module per verb.

Each verb has a module of its name (`list_` for list) with a function `command(args, say) -> exit
code`, which is imported only when the verb is used; `say` prints. The options are declared in
`arguments`, the entry point is `main`.
"""

from nsbench.cli.main import main

__all__ = ["main"]

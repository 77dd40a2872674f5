"""`nsbench show`: describe a case, or run one solver on it and print status, work and errors.

With --html the run is written as a moving scene too, with --gif as a film.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np

from nsbench import solvers
from nsbench.case import Case
from nsbench.cli.exit_codes import FAILED, FINE
from nsbench.cli.option_values import find_one_case, load_solver_files, read_accuracies
from nsbench.execute.progress import EXPECTED_STATUSES
from nsbench.trajectory import Trajectory

MOST_EVENTS = 40  # printed, the first ones


def command(args: argparse.Namespace, say: Callable[[str], None]) -> int:
    """Show a case, or one run of it; 3 if the run ended with a status that is a failure."""
    load_solver_files(args)
    case = find_one_case(args.case)
    say(
        f"{case.key}: {type(case.problem).__name__}, n = {case.n}, t = {case.t[0]:g} .. "
        f"{case.t[-1]:g}, {len(case.t)} samples"
    )
    if args.solver is None:
        if args.html or args.gif:
            raise ValueError("--html and --gif show a run: name its solver with -s")
        say(case.doc)
        for name in solvers.standard():
            say(f"  {name:<32} {solvers.get(name).refuses(case) or 'runs'}")
        return FINE
    return _show_run(case, args, say)


def _show_run(case: Case, args, say) -> int:
    """Print status, counted work, errors and events of one run in this process."""
    traj = solvers.solve(case, args.solver, **read_accuracies(args))
    say(f"{args.solver}: {traj.status.code}. {traj.status}")
    for name, value in {**traj.stats}.items():
        say(f"  {name:<20} {value}")
    if len(traj.t):
        from nsbench.measure import errors, why_reaction

        measures = errors(case, traj)
        below_bound = measures["below"].split()
        for name, value in measures.items():
            if value == "" or value != value:  # NaN: not measured on this case
                continue
            text = f"{value:.6g}" if isinstance(value, float) else str(value)
            if name in below_bound:
                text = "below ten times the bound of the reference"
            say(f"  {name:<20} {text}")
        unique = measures["multipliers_unique"] is not False
        if why := why_reaction(unique, measures["compared"], measures["impulse_floor"]):
            say(f"  {why}")
    for event in traj.events[:MOST_EVENTS]:
        say(f"  t = {event.t:.12g}  {event.kind}  {event.contact}")
    if args.html:
        say(str(_write_player(case, args, traj)))
    if args.gif:
        from nsbench.report.scenes.film import film_gif
        from nsbench.results.atomic_write import write_atomically

        write_atomically(Path(args.gif), film_gif(case, traj))
        say(args.gif)
    return FINE if traj.status.code in EXPECTED_STATUSES else FAILED


def _write_player(case: Case, args, traj: Trajectory) -> Path:
    """Write the page of the run; raises ValueError for a case that is too large to be shown."""
    from nsbench.reference import reference
    from nsbench.report.html_page import render_player_page
    from nsbench.report.scenes.player import MAX_STATE, collect_frames
    from nsbench.results.atomic_write import write_atomically
    from nsbench.solvers.base import default_accuracy

    method = solvers.get(args.solver)
    value = read_accuracies(args).get(method.accuracy) or default_accuracy(method, case)
    known = reference(case)
    states = None if known is None else np.asarray(known.x)
    player = collect_frames(case, states, [(args.solver, value, traj)])
    if player is None:
        raise ValueError(
            f"{case.key} has no moving scene: {case.n} entries of the state, at most {MAX_STATE} "
            "are shown, and a run or a reference has to have samples"
        )
    path = Path(args.html)
    lede = f"{args.solver}, {method.accuracy} = {value:g}: {traj.status.code}. {traj.status}"
    page = render_player_page(f"nsbench show {case.key}", lede, player)
    write_atomically(path, page.encode())
    return path

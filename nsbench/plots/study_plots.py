"""Public face of charts, as `study.plot`: the specifications of report.charts.studies as Charts."""

from __future__ import annotations

from pathlib import Path

from nsbench.plots.chart import Chart
from nsbench.report.charts import studies
from nsbench.trajectory import Trajectory


class StudyPlots:
    """Charts of a study, as `study.plot`.

    case: its key, by default the only one of the study. metric: "state", "force" (impulses, or the
    reaction where that is compared), "violation" or "selection". highlight: a method that
    keeps its colour over the grey background of all others. beside: a folder of results, as of a
    released version, whose methods are drawn too where the study has not run them. Each method
    raises ValueError for a case, metric or method that is not there, and where no run has a number.
    """

    def __init__(self, study: object):
        self._study = study

    def __repr__(self) -> str:
        """Return the charts that there are."""
        return "StudyPlots(error, work_precision, orders)"

    def error(
        self,
        case: str | None = None,
        metric: str = "state",
        highlight: str = "",
        beside: str | Path = "",
    ) -> Chart:
        """Draw an error over the step."""
        return Chart(studies.error_against_step(self._study, case, metric, highlight, beside))

    def work_precision(
        self,
        case: str | None = None,
        metric: str = "state",
        highlight: str = "",
        beside: str | Path = "",
    ) -> Chart:
        """Draw an error over the seconds of a run."""
        return Chart(studies.work_precision(self._study, case, metric, highlight, beside))

    def orders(self, metric: str = "state") -> Chart:
        """Draw all fitted orders with their 95 % intervals, a line per case."""
        return Chart(studies.orders(self._study, metric))


def plot_trajectory(traj: Trajectory, what: str = "state") -> Chart:
    """Draw a trajectory over time; what: "state" or "impulse".

    Raises ValueError for another word, and for a run without samples.
    """
    if not len(traj.t):
        raise ValueError(f"nothing to draw: the run has no samples. {traj.status}")
    return Chart(studies.trajectory(traj, what))

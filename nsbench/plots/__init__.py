"""Charts of a run or a study as objects: a Vega-Lite specification that shows itself in a notebook.

    nsbench.solve("tide", "pbd").plot()                       coordinates over time
    study.plot.error(), study.plot.work_precision(), study.plot.orders()

The specifications are those of nsbench.report.charts.studies. Nothing here runs a method.
"""

from nsbench.plots.chart import Chart
from nsbench.plots.study_plots import StudyPlots, plot_trajectory

__all__ = ["Chart", "StudyPlots", "plot_trajectory"]

"""Panels of studies: a legend of many or wide lines takes no room from its panel."""

import pytest

from nsbench.studies.curves import (
    LEGEND_LINE,
    MOST_INSIDE,
    PANEL_INCHES,
    Curve,
    Panel,
    make_figure,
)


@pytest.mark.parametrize("count", [2, MOST_INSIDE, MOST_INSIDE + 2])
def test_panels_stay_as_wide_whatever_their_legend(count):
    curves = tuple(
        Curve(f"pbd[order=reverse], against {k}", (0.002, 0.1), (1.0 + k, 2.0))
        for k in range(count)
    )
    figure = make_figure([Panel("teaser", curves, "h", "error")])
    (axes,) = figure.axes
    width = axes.get_position().width * figure.get_figwidth()
    assert 0.6 * PANEL_INCHES[0] < width < PANEL_INCHES[0]
    assert not axes.get_legend().get_window_extent().overlaps(axes.get_window_extent())


@pytest.mark.parametrize("count", [2, MOST_INSIDE])
def test_a_legend_of_few_short_names_lies_inside_its_panel(count):
    curves = tuple(Curve(f"n = {k}", (0.002, 0.1), (1.0 + k, 2.0)) for k in range(count))
    (axes,) = make_figure([Panel("teaser", curves, "h", "error")]).axes
    assert axes.get_legend().get_window_extent().overlaps(axes.get_window_extent())


def test_a_legend_makes_its_own_row_higher_and_no_other():
    many = tuple(Curve(f"method {k}", (0.1, 1.0), (1.0, 2.0 + k)) for k in range(9))
    panels = [Panel(name, curves, "h", "error") for name, curves in (("a", many), ("b", many[:1]))]
    figure = make_figure(panels, columns=1)
    heights = [a.get_position().height * figure.get_figheight() for a in figure.axes]
    assert heights[0] == pytest.approx(heights[1], rel=0.1)
    assert figure.get_figheight() == pytest.approx(2 * PANEL_INCHES[1] + 9 * LEGEND_LINE)

"""Charts are drawn without a browser, with the same bytes twice."""

import pytest
from report_rows import made

from nsbench.plots import StudyPlots
from nsbench.report.charts import files

TIDE = [r for r in made() if r["case"] == "tide"]
CHARTS = {
    "work_precision": lambda: StudyPlots(TIDE).work_precision(),
    "error": lambda: StudyPlots(TIDE).error(metric="impulse"),
    "orders": lambda: StudyPlots(TIDE).orders(),
}


@pytest.mark.parametrize("name", CHARTS)
def test_a_chart_has_the_same_bytes_twice_as_svg_pdf_and_json(name, tmp_path):
    for suffix in files.FORMATS:
        one = files.write_chart(CHARTS[name]().spec, tmp_path / f"one{suffix}").read_bytes()
        other = files.write_chart(CHARTS[name]().spec, tmp_path / f"other{suffix}").read_bytes()
        assert one == other and len(one) > 1000, suffix


def test_another_ending_is_refused(tmp_path):
    with pytest.raises(ValueError, match=".svg, .pdf, .json"):
        files.write_chart(CHARTS["error"]().spec, tmp_path / "chart.bmp")

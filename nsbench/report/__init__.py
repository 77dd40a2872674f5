"""Write the report of a study: one self-contained page, the same as Markdown, and figures.

    write_report("results", "results/report.html")

reads results/runs.parquet (and cases.json, solvers.json, env.json, extra.json, studies/*.json,
figures/scene_*.svg where they exist) and writes the page, the Markdown with the same content, and
one SVG per case in ``figures/``. Nothing here runs a solver.
"""

from __future__ import annotations

from pathlib import Path

__all__ = ["write_report"]


def write_report(
    study: object, path: str | Path | None = None, *, unfinished: bool = False
) -> Path:
    """Write the report of `study` and return the path of the page.

    The Markdown and the figures are written to the same folder.
    study: a folder of results, a list of folders, a study with ``.rows``, a DataFrame or a list of
    dict rows. A study in which every run failed has a report like any other.
    path: a file or an existing folder; by default ``report.html`` in the study's folder, or here.
    unfinished: the study is a folder whose last run has written no tables; its rows are taken from
    the journal, and the page says how many are missing.
    Raises FileNotFoundError for a folder without rows and ValueError, naming the file, for one that
    cannot be read.
    """
    from nsbench.report.assemble import assemble_content, draw_figures
    from nsbench.report.data import read, read_unfinished
    from nsbench.report.html_page import render_page
    from nsbench.report.markdown import render_markdown
    from nsbench.report.study_pages import read_studies
    from nsbench.results.atomic_write import replace

    folder = (
        Path(study) if isinstance(study, (str, Path)) else Path(getattr(study, "dir", None) or ".")
    )
    path = Path(path) if path is not None else folder / "report.html"
    path = path / "report.html" if path.is_dir() else path
    data = read_unfinished(folder) if unfinished else read(study)
    drawn = draw_figures(data)
    content = assemble_content(data, drawn, read_studies(folder))
    path.parent.mkdir(parents=True, exist_ok=True)
    (path.parent / "figures").mkdir(exist_ok=True)
    for name, svg in drawn.files.items():
        replace(path.parent / "figures" / f"{name}.svg", svg.encode())
    replace(path.with_suffix(".md"), render_markdown(content).encode())
    replace(path, render_page(content).encode())
    return path

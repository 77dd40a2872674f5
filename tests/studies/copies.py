"""Copies of the checkout for breaking them on purpose."""

import contextlib
import shutil
import subprocess
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def copy(to: Path) -> None:
    """Every file of the checkout but the reports, into the folder `to`."""
    names = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.splitlines()
    for name in names:
        if (ROOT / name).is_file() and not name.startswith("reports/"):
            (to / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, to / name)


@contextlib.contextmanager
def broken(*replacements, copied=copy):
    """A copy in which, for the time of a with-block, of each (file, text, other) the other stands
    for the text in its file;
    LookupError if a text does not stand there exactly once."""
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        copied(folder)
        for file, text, other in replacements:
            source = (folder / file).read_text(encoding="utf-8")
            if source.count(text) != 1:
                raise LookupError(
                    f"does not apply: {text!r} stands {source.count(text)} times in {file}"
                )
            (folder / file).write_text(source.replace(text, other), encoding="utf-8")
        yield folder

"""Copies of the checkout for breaking them on purpose."""

import contextlib
import os
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
        with broken_in(folder, *replacements):
            yield folder


@contextlib.contextmanager
def broken_in(folder, *replacements):
    """The same in a folder that is there already; its files are as before, to the time of their
    last change, after the with-block."""
    before = {}
    try:
        for file, text, other in replacements:
            path = folder / file
            source = path.read_text(encoding="utf-8")
            if source.count(text) != 1:
                raise LookupError(
                    f"does not apply: {text!r} stands {source.count(text)} times in {file}"
                )
            before.setdefault(path, (path.read_bytes(), path.stat()))
            path.write_text(source.replace(text, other), encoding="utf-8")
        yield
    finally:
        for path, (content, state) in before.items():
            path.write_bytes(content)
            os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns))

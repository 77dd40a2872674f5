"""Copies of the checkout for breaking them on purpose."""

import contextlib
import os
import shutil
import subprocess
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
def broken_in(folder, *replacements):
    """For the time of a with-block, of each (file, text, other) the other stands for the text in
    its file in a copy; then the files are as before, to the time of their last change.

    LookupError if a text does not stand there exactly once.
    """
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


def is_kernel(file) -> bool:
    """Does an edit of the file compile all kernels anew?"""
    from nsbench.compilation import numba_cache

    root = numba_cache.ROOT.parent
    return file in {p.relative_to(root).as_posix() for p in numba_cache.kernel_files()}

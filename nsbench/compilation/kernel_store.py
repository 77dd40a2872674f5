"""Files in which numba stores a compiled kernel, with checksums: damaged code is never run.

numba keeps an index NAME.nbi for each kernel (its stamp, and which signature has its code in which
file), and files NAME.*.nbc with the code. Neither has a checksum: a byte that changed on the disk
would be another constant in a kernel, or an exception in every run. Here a digest stands at the end
of an index, and the name of a file of code is the digest of its content, so that an index never
refers to the code of another signature, or to an older version of it.

A file that is not as it was written counts as none: the kernel is compiled and stored again. Both
kinds of file can be read by numba alone, which ignores what follows a pickle.
"""

from __future__ import annotations

import contextlib
import glob
import hashlib
import io
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from numba.core import caching

from nsbench.source_files.regular_files import read_bytes

MARK = b"nsbench index 1\n"  # before the digest at the end of an index
MAX_CODE_BYTES = 256 << 20  # of one file: the largest kernels take some megabytes
DIGEST = 64  # hexadecimal digits in the name of a file of code


class CheckedFiles(caching.IndexDataCacheFile):
    """Index and code of one kernel on the disk; takes the place of numba's class of that role."""

    def load(self, key: tuple) -> object:
        """Return what was saved for the key; None where that is nothing, or of no use."""
        try:
            name = self._load_index().get(key)
            if name is None or fault_of(Path(self._data_path(name))):
                return None
            return self._load_data(name)
        except Exception:  # as written, but by another version of a library
            return None

    def save(self, key: tuple, data: object) -> None:
        """Save data under the key: the code before the index, which then refers to whole files.

        Files of code that no signature refers to any more are deleted. Raises OSError.
        """
        body = self._dump(data)
        stem = self._index_name.removesuffix(".nbi")
        name = f"{stem}.{hashlib.sha256(body).hexdigest()}.nbc"
        with self._open_for_write(self._data_path(name)) as file:
            file.write(body)
        overloads = self._load_index()
        overloads[key] = name
        self._save_index(overloads)
        folder = Path(self._cache_path)
        for old in folder.glob(f"{glob.escape(stem)}.*.nbc"):
            if old.name not in overloads.values():
                with contextlib.suppress(OSError):
                    old.unlink()

    def _load_index(self) -> dict:
        path = Path(self._index_path)
        try:
            return {} if fault_of(path) else super()._load_index()
        except Exception:  # as written, but by another version of a library
            return {}

    @contextlib.contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[BinaryIO]:
        buffer = io.BytesIO()
        yield buffer
        body = buffer.getvalue()
        if filepath == self._index_path:
            body += MARK + _index_digest(self._index_name, body)
        with super()._open_for_write(filepath) as file:
            file.write(body)


def _index_digest(name: str, body: bytes) -> bytes:
    return hashlib.sha256(name.encode() + b"\0" + body).digest()


def fault_of(path: Path) -> str:
    """Return why a file of a stored kernel cannot be used, as a sentence that names it; "" if it
    is as it was written.
    """
    try:
        data = read_bytes(path, MAX_CODE_BYTES)
    except (OSError, ValueError) as e:
        return str(e)
    if path.suffix == ".nbc":
        whole = hashlib.sha256(data).hexdigest() == path.stem[-DIGEST:]
    else:
        body, _, digest = data.rpartition(MARK)
        whole = digest == _index_digest(path.name, body)
    return "" if whole else f"{path} is not as its checksum says, or has none"


def faults_in(folder: Path) -> list[str]:
    """Return why files of stored kernels in a folder cannot be used, one sentence each."""
    return [fault for p in sorted(folder.glob("*.nb[ic]")) if (fault := fault_of(p))]


@contextlib.contextmanager
def _cost_time_only(self: caching.Cache) -> Iterator[None]:
    """Pass over errors of the disk while a kernel is loaded or stored: it is compiled again."""
    with contextlib.suppress(OSError):
        yield


def install() -> None:
    """Have numba store all kernels that this process compiles in checked files."""
    caching.IndexDataCacheFile = CheckedFiles
    caching.Cache._guard_against_spurious_io_errors = _cost_time_only

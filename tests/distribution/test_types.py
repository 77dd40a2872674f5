"""The public modules pass the type checker, so that users' checkers can rely on their types."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.long
def test_public_modules_pass_mypy():
    pytest.importorskip("mypy", reason="mypy checks the types: pip install 'nsbench[test]'")
    command = [sys.executable, "-m", "mypy"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-3000:]

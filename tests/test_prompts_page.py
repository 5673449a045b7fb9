"""The page of whole requests in the documentation."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.system
def test_the_page_shows_what_is_sent() -> None:
    command = [sys.executable, "tools/write_prompts.py", "--check"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, encoding="utf-8", check=False)
    assert done.returncode == 0, f"run python tools/write_prompts.py: {done.stderr}"

"""The benchmarks that documents name run, and say what they should."""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def test_a_checkout_beside_itself_draws_and_measures_the_same_and_says_how_long_it_took(
    tmp_path: Path,
) -> None:
    """In the place of another checkout: a folder with this environment."""
    (tmp_path / ".venv").symlink_to(sys.prefix)
    script = str(ROOT / "benchmarks" / "paired.py")
    command = [sys.executable, script, str(tmp_path), "--only", "look colour", "--turns", "1"]
    ran = subprocess.run(command, capture_output=True, encoding="utf-8", check=True)
    assert re.search(r"look colour \(n = 1\): [\d.]+ ms, here [\d.]+ ms: [\d.]+ x", ran.stdout)

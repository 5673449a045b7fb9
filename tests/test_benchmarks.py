"""The benchmarks that documents name run, and say what they should."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

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


@pytest.mark.system
@pytest.mark.parametrize(
    ("script", "options", "said"),
    [
        ("memory.py", ["--trials", "3"], r"\| 3 \| rectangle \| \d+ \|"),
        (
            "workers.py",
            ["--trials", "1", "--pairs", "1", "--lines", "100"],
            r"100 lines .* read",
        ),
        ("profiled.py", ["--level", "L0", "--trials", "1"], r"within .* calls"),
    ],
)
def test_a_benchmark_runs_and_says_what_it_measured(
    script: str, options: list[str], said: str
) -> None:
    command = [sys.executable, str(ROOT / "benchmarks" / script), *options]
    ran = subprocess.run(command, capture_output=True, encoding="utf-8", check=False)
    assert ran.returncode == 0, ran.stderr
    assert re.search(said, ran.stdout)

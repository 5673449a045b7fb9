"""The documents show the stored results, and nothing else."""

import subprocess
import sys

from documents import ROOT, blocks


def test_every_table_in_the_documents_is_pasted_from_the_stored_results() -> None:
    check = [sys.executable, "tools/paste_results.py", "--check"]
    done = subprocess.run(check, cwd=ROOT, capture_output=True, encoding="utf-8", check=False)
    assert done.returncode == 0, f"run tools/paste_results.py: {done.stdout}{done.stderr}"


def test_the_readmes_python_example_is_short() -> None:
    (example,) = (b for b in blocks(ROOT / "README.md") if b.language == "python")
    assert len(example.code.strip().splitlines()) <= 12

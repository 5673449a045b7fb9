"""The documents show the stored results, and nothing else."""

import subprocess
import sys
from pathlib import Path

import av
import numpy as np
import pytest
from documents import ROOT, blocks


def test_every_table_in_the_documents_is_pasted_from_the_stored_results() -> None:
    check = [sys.executable, "tools/paste_results.py", "--check"]
    done = subprocess.run(check, cwd=ROOT, capture_output=True, encoding="utf-8", check=False)
    assert done.returncode == 0, f"run tools/paste_results.py: {done.stdout}{done.stderr}"


def test_the_readmes_python_example_is_short() -> None:
    (example,) = (b for b in blocks(ROOT / "README.md") if b.language == "python")
    assert len(example.code.strip().splitlines()) <= 12


def test_the_readme_is_read_in_five_minutes() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 150


def test_the_readmes_picture_moves_and_is_quickly_there() -> None:
    path = ROOT / "docs" / "images" / "recovery.gif"
    assert path.stat().st_size <= 3e6
    with av.open(str(path)) as film:
        assert sum(1 for _ in film.decode(video=0)) > 100


@pytest.mark.system
def test_the_readmes_picture_is_drawn_again_by_its_script(tmp_path: Path) -> None:
    again = tmp_path / "again.gif"
    script = [sys.executable, "tools/draw_recovery.py", str(again)]
    subprocess.run(script, cwd=ROOT, check=True, capture_output=True)
    with av.open(str(ROOT / "docs/images/recovery.gif")) as shown, av.open(str(again)) as drawn:
        pairs = zip(shown.decode(video=0), drawn.decode(video=0), strict=True)
        for one, other in pairs:
            apart = np.abs(
                one.to_ndarray(format="gray").astype(int) - other.to_ndarray(format="gray")
            )
            assert apart.mean() < 5

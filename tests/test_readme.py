"""The documents show the stored results, and nothing else."""

import subprocess
import sys
from pathlib import Path

import av
import numpy as np
import pytest
from documents import ROOT, blocks
from numpy.typing import NDArray


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
def test_the_readmes_picture_is_drawn_by_its_script(tmp_path: Path) -> None:
    again = tmp_path / "again.gif"
    script = [sys.executable, "tools/draw_recovery.py", str(again)]
    subprocess.run(script, cwd=ROOT, check=True, capture_output=True)
    shown, drawn = (pictures(path) for path in (ROOT / "docs/images/recovery.gif", again))
    assert len(drawn) == pytest.approx(len(shown), rel=0.05)  # noise may be drawn anew
    for one, other in ((shown[0], drawn[0]), (shown[-1], drawn[-1])):
        assert np.abs(one - other).mean() < 5


def pictures(path: Path) -> list[NDArray[np.int64]]:
    with av.open(str(path)) as film:
        return [frame.to_ndarray(format="gray").astype(int) for frame in film.decode(video=0)]

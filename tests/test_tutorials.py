"""The tutorial of your own robot as a reader follows it, at an emulated UR5e; and the tutorials'
pictures are what their script draws."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from documents import ROOT, Block, blocks

from pliant.emulator.client import started
from pliant.pictures import decoded

pytestmark = pytest.mark.system
HOST, SHOWN_HOST = "127.0.0.93", "127.0.0.1"  # the page's own may be another test's
PAGE = ROOT / "docs" / "tutorials" / "own-robot.md"
SAYS = {
    "check-cell": (r"^ready$",),
    "--dry-run": (r"insertion",),
    "--air": (r"insertion",),
    "--condition none": (r"^inserted \(ground truth: 2\d\.\d mm deep; judged yes\)",),
}
PICTURES = ("loop.png", "first-peg.png", "first-peg-goes-in.png", "own-robot.png")


def test_what_is_shown_of_your_own_robot_comes_true_at_the_emulated_one(tmp_path: Path) -> None:
    shown = {block.name: block for block in blocks(PAGE)}
    (begun,) = (name for name in shown if name.startswith("python -m pliant.emulator"))
    steps = [name for name in shown if name.startswith("pliant ") and "cell.yaml" in name]
    printed = ""
    with started(*shlex.split(begun)[3:], "--host", HOST, "--mode", "fast"):
        ran(snippet(shown["python 1"]), tmp_path)
        file = (tmp_path / "cell.yaml").read_text(encoding="utf-8")
        assert "z_mm: 55.0," in file  # numbers as a person writes them
        assert not re.search(r"\de-\d", file)
        for step, expected in zip(steps, SAYS.items(), strict=True):
            name, patterns = expected
            assert name in step
            said = ran(["-m", *shlex.split(step)], tmp_path)
            for pattern in patterns:
                assert re.search(pattern, said, re.MULTILINE), said
            printed += said
    lines = [" ".join(line.split()) for line in printed.splitlines()]
    for line in shown["text 1"].code.replace(SHOWN_HOST, HOST).splitlines():
        kind = " ".join(line.split())
        assert re.sub(r"[+\d.-]+ mm", "N mm", kind) in [
            re.sub(r"[+\d.-]+ mm", "N mm", one) for one in lines
        ]


def snippet(block: Block) -> list[str]:
    return ["-c", block.code.replace(SHOWN_HOST, HOST)]


def ran(arguments: list[str], folder: Path) -> str:
    """What a command printed, which ended well."""
    done = subprocess.run(
        [sys.executable, *arguments], cwd=folder, capture_output=True, encoding="utf-8"
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


def test_the_tutorials_pictures_are_drawn_by_their_script(tmp_path: Path) -> None:
    script = [sys.executable, "tools/draw_tutorials.py", str(tmp_path)]
    subprocess.run(script, cwd=ROOT, check=True, capture_output=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(PICTURES)
    for name in PICTURES:
        shown, drawn = (
            decoded((folder / name).read_bytes()).astype(int)
            for folder in (ROOT / "docs/images", tmp_path)
        )
        assert shown.shape == drawn.shape
        assert np.abs(shown - drawn).mean() < 3

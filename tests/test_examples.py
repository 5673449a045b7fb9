"""Every example does what it is there to show, as it stands."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parent.parent / "examples"
PRINTS = {
    "01_one_trial": (
        r"^fit +False",
        "slide further in the same direction",
        "^inserted inserted: True$",
    ),
    "02_one_skill_and_its_checks": (r"^fit reached", r"^table_i +False", "^in truth: True$"),
    "03_your_own_reasoner": (r"^inserted \d executions$",),
    "04_your_own_peg": (r", none: [01] of 3 inserted$", ", rules: 3 of 3 inserted$"),
    "05_read_results": (r"^rules \[True, True, True, True\]", r"^none \[.*False.*\]"),
    "06_learned_skill": ("as taught: .*in 4 of 6", "as learned: .*in [56] of 6"),
    "07_learned_reasoner": (
        r"^22 recoveries recorded",
        "rules: +inserted 6/6",
        "nearest: +inserted [56]/6",
    ),
    "08_one_check": ("^vote True: success$", "^vote None: no hole: no red region in the picture$"),
    "09_one_recovery": (
        r"^rules: .*y -12\.0 mm",
        r"^messages: p_gy was too big",
        "^sweep: .*retreat",
    ),
    "10_your_own_segmentation": (
        "shipped colours: stopped .* 3 of them unseen",
        "learned: inserted .* 0 of them",
    ),
    "11_your_own_check": (
        "^align: .* vote True; conflict: compression, pose, springs_back disagreed$",
        "^align: .* vote True; conflict: None$",
    ),
    "12_your_own_method": (
        r"^inserted by 12_your_own_method.py:TwoStages$",
        r"^tip -1\d\.\d mm$",
        r"^tip -24\.\d mm$",
    ),
    "14_a_vlm": (
        r"^fit failure by vlm$",
        r"^   how: \S",
        r"^inserted after [45] calls to judge$",
    ),
    "13_your_own_cell": ("^sim: inserted", "^out_of_focus: inserted, inserted True"),
}


def test_what_each_example_prints_is_said() -> None:
    assert {path.stem for path in EXAMPLES.glob("*.py")} == set(PRINTS)


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda p: p.stem)
def test_an_example_shows_what_it_is_there_for(path: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, str(path)],
        cwd=tmp_path,
        capture_output=True,
        encoding="utf-8",
        check=False,
    )
    assert done.returncode == 0, done.stderr
    for pattern in PRINTS[path.stem]:
        assert re.search(pattern, done.stdout, re.MULTILINE), (pattern, done.stdout)

"""`pliant bench-reasoner` at the command line: tables, JSON, and how it refuses."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

PLIANT = Path(sys.executable).parent / "pliant"
EXAMPLES = Path(__file__).parent.parent / "examples"


def bench(*words: str | Path) -> "subprocess.CompletedProcess[str]":
    command = [str(PLIANT), "bench-reasoner", *map(str, words)]
    return subprocess.run(command, capture_output=True, encoding="utf-8", check=False, timeout=120)


def test_several_reasoners_stand_side_by_side_in_tables_and_json(tmp_path: Path) -> None:
    mine = f"{EXAMPLES / '03_your_own_reasoner.py'}:Bold"
    out = tmp_path / "new" / "scores.json"
    done = bench("rules", "coin", mine, "--limit", "5", "--out", out)
    assert done.returncode == 0, done.stderr
    for heading in ("## Judging", "## Planning, after true failures", "## By kind of case"):
        assert heading in done.stdout
    document = json.loads(out.read_text(encoding="utf-8"))
    assert list(document["reasoners"]) == ["rules", "coin", Path(mine).name]
    assert document["cases"]["n"] == 5
    assert all(name in done.stdout for name in document["reasoners"])


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ((), "name"),
        (("gpt",), "valid are rules, messages"),
        (("missing.py:Mine",), "does not exist"),
        (("rules", "--limit", "0"), "above 0"),
        (("rules", "--cases", "missing.zip"), "cannot be read"),
        (("rules", "--model", "openai:gpt-4o"), "add vlm"),
        (("vlm", "--base-url", "ftp://x", "--model", "m"), "http"),
        (("rules", "--out", "."), "cannot be written"),
        (("rules", "--out", "/proc/nothing/scores.json"), "cannot be written"),
    ],
)
def test_bad_input_is_one_line_and_exit_status_two(words: tuple[str, ...], says: str) -> None:
    done = bench(*words)
    assert done.returncode == 2, done.stdout
    assert says in done.stderr
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1, done.stderr


def test_interrupted_it_writes_nothing(tmp_path: Path) -> None:
    slow = tmp_path / "slow.py"
    slow.write_text(
        "import time\n"
        "from pathlib import Path\n"
        "from pliant.reasoners.rules import Rules\n"
        "class Slow(Rules):\n"
        "    def judge(self, case):\n"
        f"        Path({str(tmp_path / 'began')!r}).touch()\n"
        "        time.sleep(60)\n",
        encoding="utf-8",
    )
    out = tmp_path / "scores.json"
    heed = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    code = f"{heed}; from pliant.cli import main; main()"
    words = ["bench-reasoner", f"{slow}:Slow", "--out", str(out)]
    command = [sys.executable, "-c", code, *words]
    with subprocess.Popen(command, stderr=subprocess.PIPE, encoding="utf-8") as running:
        until = time.monotonic() + 60
        while not (tmp_path / "began").exists() and time.monotonic() < until:
            time.sleep(0.05)
        running.send_signal(signal.SIGINT)
        _, said = running.communicate(timeout=30)
    assert running.returncode == 130, said
    assert said.splitlines()[-1] == "pliant: interrupted"
    assert sorted(p.name for p in tmp_path.iterdir() if p.is_file()) == ["began", "slow.py"]

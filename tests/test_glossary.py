"""The glossary names files that are there, and each word once."""

import re
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parent.parent
ROWS = re.findall(
    r"^\| (?!word|---)(.+?) \| .+ \| `(.+?)` \|$",
    (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8"),
    re.MULTILINE,
)


def test_every_word_of_the_glossary_is_defined_once_and_lives_where_it_says() -> None:
    assert len(ROWS) >= 40
    assert max(Counter(word for word, _ in ROWS).values()) == 1
    for word, place in ROWS:
        assert (ROOT / "src" / "pliant" / place).exists(), word

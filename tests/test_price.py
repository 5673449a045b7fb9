"""The price of a hosted model is estimated before anything is spent."""

import sys
from pathlib import Path
from typing import Any

import pytest

from pliant.cli import main
from pliant.experiment.plan import from_fields
from pliant.experiment.price import Estimate, estimate


def cost(reasoners: Any = "vlm", **settings: Any) -> Estimate | None:
    fields = {"pegs": "circle", "conditions": "all", "reasoners": reasoners, "trials": 10}
    return estimate(from_fields({**fields, "vlm": {"model": "openai:gpt-4o", **settings}}))


def test_a_hosted_model_s_price_is_known_and_grows_with_what_it_is_asked() -> None:
    whole = cost()
    assert whole is not None
    assert whole.usd is not None
    cheaper = [
        cost(picture=False),
        cost(detail="low"),
        cost(one_call=True),
        cost(judge="rules"),
        cost(recover="rules"),
    ]
    assert all(c is not None and c.usd is not None and c.usd < whole.usd for c in cheaper)
    assert 0.2 < whole.usd < 2.0


def test_thoughts_are_paid_for_too() -> None:
    prices = [cost(model="openai:gpt-5", effort=effort) for effort in (None, "low", "high")]
    dollars = [price.usd for price in prices if price is not None and price.usd is not None]
    assert len(dollars) == 3
    assert dollars == sorted(set(dollars))


def test_a_price_given_by_hand_counts() -> None:
    free, own = cost(usd_per_million=(0, 0)), cost(usd_per_million=(5, 20))
    published = cost()
    assert free is not None
    assert own is not None
    assert published is not None
    assert published.usd is not None
    assert free.usd == 0
    assert own.usd == pytest.approx(2 * published.usd)


def test_what_is_not_known_is_not_guessed() -> None:
    strange = cost(model="openai:made-up")
    assert strange is not None
    assert strange.usd is None
    assert "not known" in str(strange)


def test_rules_and_a_server_of_one_s_own_cost_nothing() -> None:
    assert cost("rules") is None
    assert cost(base_url="http://localhost:8000/v1") is None


def test_where_nobody_can_be_asked_the_price_stands_in_the_one_line_that_refuses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("OPENAI_API_KEY", "none")
    words = ["experiment", "--reasoners", "vlm", "--model", "openai:gpt-4o"]
    monkeypatch.setattr(sys, "argv", ["pliant", *words])
    with pytest.raises(SystemExit):
        main()
    printed, said = capsys.readouterr()
    assert printed == ""
    assert len(said.splitlines()) == 1
    assert said.startswith("pliant: a hosted model costs money, 30 trials ask a model about ")
    assert said.rstrip().endswith(" USD: add --yes to agree")

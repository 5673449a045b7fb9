"""Why a decision is not the model's own, as a person reads it: the cause, and what to set."""

import json
import ssl
from collections.abc import Callable
from typing import Any

import pytest
from loopback import Fields, Handler, Loopback, completion, loopback
from pydantic_ai.exceptions import ModelConnectionError
from vlm_cases import simulated
from voices import judgement

from pliant.errors import InputError
from pliant.reasoners import vlm
from pliant.reasoners.rules import Rules
from pliant.reasoners.vlm.causes import said, why
from pliant.reasoners.vlm.settings import Output, Settings
from pliant.records import Verdict

THOUGHTS = {"role": "assistant", "content": None, "reasoning_content": "hm " * 40}


@pytest.fixture(autouse=True)
def own_server() -> None:
    """See conftest.py."""


def right() -> Fields:
    """What is right to say of the case that is judged."""
    return judgement(Rules().judge(simulated().put[0]))


def answering(
    status: int = 200, body: Any = None, *, message: Fields | None = None, finish: str = "stop"
) -> Callable[[Loopback, Handler], None]:
    def behave(server: Loopback, handler: Handler) -> None:
        if body is not None:
            handler.send(json.dumps(body).encode(), status=status)
            return
        reply = json.loads(completion(handler.received.body, "{}"))
        reply["choices"][0] |= {"message": message, "finish_reason": finish}
        handler.send(json.dumps(reply).encode())

    return behave


def judged(behave: Callable[[Loopback, Handler], None], **settings: Any) -> tuple[Verdict, int]:
    """A verdict, and how many requests it took."""
    with loopback(behave) as server:
        chosen = {"picture": False, "deadline_s": 20, **settings}
        mind = vlm(Settings(model="small", base_url=server.base_url, **chosen))
        return mind.judge(simulated().put[0]), len(server.received)


def says(text: str) -> Fields:
    return {"role": "assistant", "content": text}


@pytest.mark.parametrize(
    ("behave", "cause"),
    [
        (answering(400, {"error": "'type' must be 'text'"}), "400: 'type' must be 'text'"),
        (answering(404, {"error": {"message": "no such model"}}), "404: no such model"),
        (answering(401, {"detail": "who are you?"}), "401: who are you?"),
        (answering(403, [{"error": {"message": "not you"}}]), "403: not you"),
        (
            answering(200, {"error": {"message": "upstream overloaded", "code": 502}}),
            "502: upstream overloaded",
        ),
        (answering(200, {"error": "out of memory"}), "out of memory"),
        (
            answering(message=THOUGHTS, finish="length"),
            "its thoughts took the whole reply, which was cut at 8000 tokens: give more with"
            " --reply-tokens",
        ),
        (
            answering(message=says('{"pose_check": "succ'), finish="length"),
            "the reply was cut at 8000 tokens: give more with --reply-tokens",
        ),
        (answering(message=THOUGHTS), "the reply holds thoughts and no answer"),
        (answering(message=says("")), "the reply is empty"),
        (
            answering(message=says('Hm.\n</think>\n{"success": true}')),
            "not the structure that was asked for: pose_check: Field required",
        ),
    ],
)
def test_the_cause_is_told_in_the_words_of_who_knows_it(
    behave: Callable[[Loopback, Handler], None], cause: str
) -> None:
    verdict, _ = judged(behave)
    assert verdict.by == "rules"
    assert verdict.fallback.startswith(cause)
    assert verdict.exchanges[-1].refused.startswith(cause)


@pytest.mark.parametrize("output", [Output.NATIVE, Output.PROMPTED])
def test_thoughts_that_nothing_began_are_set_apart(output: Output) -> None:
    thoughtful = says(f"The tip is low, {{so}}.\n</think>\n\n{json.dumps(right())}")
    verdict, requests = judged(answering(message=thoughtful), output=output)
    assert (verdict.by, verdict.fallback, requests) == ("vlm", "", 1)


def test_the_mark_within_a_value_is_not_taken_for_the_end_of_thoughts() -> None:
    told = right() | {"reason": "it said </think> there"}
    verdict, _ = judged(answering(message=says(json.dumps(told))))
    assert verdict.reason == "it said </think> there"


def test_a_server_that_wants_the_other_name_of_the_longest_reply_gets_it() -> None:
    def behave(server: Loopback, handler: Handler) -> None:
        if "max_tokens" in handler.received.body:
            told = "Unsupported parameter: 'max_tokens'. Use 'max_completion_tokens' instead."
            handler.send(json.dumps({"error": {"message": told}}).encode(), status=400)
        else:
            assert handler.received.body["max_completion_tokens"] == 8000
            handler.send(completion(handler.received.body, json.dumps(right())))

    with loopback(behave) as server:
        mind = vlm(Settings(model="small", base_url=server.base_url, picture=False, deadline_s=20))
        verdicts = [mind.judge(simulated().put[0]) for _ in range(2)]
    assert [v.by for v in verdicts] == ["vlm", "vlm"]
    assert len(server.received) == 3  # it is told so once


@pytest.mark.parametrize(
    ("address", "cause"),
    [
        ("http://127.0.0.1:9/v1", "connection to http://127.0.0.1:9/v1 failed: Connection refused"),
        ("http://[::1]:9/v1", "connection to http://[::1]:9/v1 failed: "),
        ("http://no-such-host.invalid/v1", "connection to http://no-such-host.invalid/v1 failed: "),
    ],
)
def test_of_a_connection_that_fails_the_systems_words_are_kept(address: str, cause: str) -> None:
    mind = vlm(Settings(model="small", base_url=address, picture=False, deadline_s=20))
    told = mind.judge(simulated().put[0]).fallback
    assert told.startswith(cause)
    assert "All connection attempts" not in told


def test_a_certificate_that_is_not_trusted_is_named() -> None:
    cause = ssl.SSLCertVerificationError(1, "[SSL: CERTIFICATE_VERIFY_FAILED] …")
    cause.verify_message = "self-signed certificate"
    error = ModelConnectionError("m", "Connection error.")
    error.__cause__ = cause
    told = why(error, "https://user:secret@lab.example/v1?key=secret")
    assert (
        told == "connection to https://lab.example/v1 failed: certificate refused: self-signed"
        " certificate"
    )


def test_a_silent_model_is_given_up_with_the_reason_for_its_silence() -> None:
    case = simulated().put[0]
    with loopback(answering(404, {"error": "no such model"})) as server:
        mind = vlm(Settings(model="small", base_url=server.base_url, picture=False))
        told = [mind.judge(case).fallback for _ in range(4)][-1]
    assert told == (
        "not asked: the model was silent 3 times in a row, last for 404: no such model; see that"
        " --model and the address are right"
    )


def test_the_package_that_a_socks_proxy_needs_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ALL_PROXY", "socks5://127.0.0.1:1080")
    with pytest.raises(InputError, match="'socksio' is missing: pip install socksio"):
        vlm(Settings(model="small", base_url="http://192.0.2.1/v1"))


def test_a_servers_words_are_found_wherever_it_puts_them() -> None:
    assert said({"type": "error", "error": {"type": "x", "message": "credit too low"}}) == (
        "credit too low"
    )
    assert said('{"error": {"message": "as text"}}') == "as text"
    assert said("plain words") == "plain words"
    assert said({"unknown": 1}) == '{"unknown": 1}'
    assert said(None) == said({}) == ""

"""A real HTTP server and a real client: what is sent, and every way in which no answer comes."""

import base64
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from loopback import Handler, Loopback, completion, loopback
from vlm_cases import asked as stage
from vlm_cases import simulated
from voices import analysis, bounded, judgement

from pliant.errors import InputError
from pliant.formations import Formation
from pliant.pictures import name_of
from pliant.reasoners import vlm
from pliant.reasoners.rules import Rules
from pliant.reasoners.vlm.settings import Output, Settings
from pliant.records import Case

pytestmark = pytest.mark.usefixtures("own_server")

DEADLINE_S = 2.0
LATE_S = 20.0  # on a loaded machine; without the deadline it would be for ever
KEY, OTHER = "sk-pliant-0123456789", "sk-openai-9876543210"
Behaviour = Callable[[Loopback, Handler], None]


@pytest.fixture
def own_server(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keys and names as a user may have them; see conftest.py."""
    monkeypatch.setenv("PLIANT_VLM_KEY", KEY)
    monkeypatch.setenv("PLIANT_VLM_KEY_FOR", "https://vlm.example.org/v1")
    monkeypatch.setenv("OPENAI_API_KEY", OTHER)
    monkeypatch.setenv("OPENAI_ADMIN_KEY", OTHER)
    monkeypatch.setenv("OPENAI_ORG_ID", "org-9876543210")
    monkeypatch.setenv("OPENAI_PROJECT_ID", "project-9876543210")


def inserted() -> Case:
    case = simulated().put[-1]
    assert case.outcome.step.formation is Formation.INSERTION
    return case


def asked(server: Loopback, **settings: Any) -> Any:
    chosen = {"deadline_s": DEADLINE_S, "goal_picture": False, **settings}
    return vlm(Settings(model="small", base_url=server.base_url, **chosen))


# --- what is sent ------------------------------------------------------------------------------


def speaks_for_the_rules(server: Loopback, handler: Handler) -> None:
    said = json.dumps(handler.received.body)
    case, verdict = simulated().recovered[0]
    recovery = Rules().recover(case, verdict)
    assert recovery is not None
    if stage(said).startswith("judge"):
        fields = judgement(Rules().judge(inserted()))
    elif stage(said).startswith("analyse"):
        fields = analysis(recovery, case)
    else:
        fields = bounded(recovery, case)
    handler.send(completion(handler.received.body, json.dumps(fields)))


@pytest.mark.parametrize("output", list(Output))
def test_a_server_is_asked_with_both_pictures_and_its_answer_counts(output: Output) -> None:
    case, (failed, verdict) = inserted(), simulated().recovered[0]
    with loopback(speaks_for_the_rules) as server:
        mind = asked(server, output=output, goal_picture=True, deadline_s=30)
        judged = mind.judge(case)
        recovery = mind.recover(failed, verdict)
    assert judged.by == "vlm"
    assert judged.success
    assert recovery is not None
    assert recovery.by == "vlm"
    (exchange,) = judged.exchanges
    assert (exchange.input_tokens, exchange.cached_tokens, exchange.output_tokens) == (900, 512, 60)
    assert exchange.model == "small"
    body = server.received[0].body
    parts = [part for message in body["messages"] for part in message["content"]]
    urls = [p["image_url"]["url"] for p in parts if isinstance(p, dict) and "image_url" in p]
    assert len(urls) == len(exchange.pictures) == 2
    for url, picture in zip(urls, exchange.pictures, strict=True):
        start, _, content = url.partition(",")
        assert start == "data:image/png;base64"
        assert base64.b64decode(content).startswith(b"\x89PNG")
        assert picture.shape == (480, 640, 3)
    shown = case.outcome.looks[-1].observation.views["side"].image
    assert name_of(exchange.pictures[1]) == name_of(shown)
    assert (body["max_tokens"], body["temperature"]) == (8000, 0)
    assert ("tools" in body) == (output is Output.TOOL)
    if output is Output.NATIVE:
        assert body["response_format"]["json_schema"]["strict"]


def test_the_key_travels_in_one_header_and_nothing_else_of_the_environment_does(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with loopback(speaks_for_the_rules) as server:
        monkeypatch.setenv("PLIANT_VLM_KEY_FOR", server.base_url)
        asked(server, deadline_s=30).judge(inserted())
    (received,) = server.received
    assert received.headers.pop("authorization") == f"Bearer {KEY}"
    everything = json.dumps([received.path, received.headers, received.body])
    for secret in (KEY, OTHER, "org-9876543210", "project-9876543210"):
        assert secret not in everything


def test_without_a_key_for_the_server_no_other_key_is_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PLIANT_VLM_KEY", "")
    with loopback(speaks_for_the_rules) as server:
        asked(server, deadline_s=30).judge(inserted())
    assert server.received[0].headers["authorization"] == "Bearer none"


def test_a_key_goes_to_the_server_that_it_is_for_and_to_no_other(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with loopback(speaks_for_the_rules) as mine, loopback(speaks_for_the_rules) as theirs:
        monkeypatch.setenv("PLIANT_VLM_KEY_FOR", mine.base_url.removesuffix("/v1") + "/")
        for server in (mine, theirs):
            assert asked(server, deadline_s=30).judge(inserted()).by == "vlm"
    assert [r.headers["authorization"] for r in mine.received] == [f"Bearer {KEY}"]
    assert [r.headers["authorization"] for r in theirs.received] == ["Bearer none"]
    assert KEY not in json.dumps([r.headers for r in theirs.received])


def test_a_key_for_no_server_is_refused_before_anything_is_sent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with loopback(speaks_for_the_rules) as server:
        monkeypatch.delenv("PLIANT_VLM_KEY_FOR")
        with pytest.raises(InputError, match=f"set PLIANT_VLM_KEY_FOR .*{server.base_url}"):
            asked(server)
        for given in ("localhost:8000", KEY):
            monkeypatch.setenv("PLIANT_VLM_KEY_FOR", given)
            with pytest.raises(InputError, match=r"^PLIANT_VLM_KEY_FOR holds no") as refused:
                asked(server)
            assert given not in str(refused.value).partition("such as")[0]
    assert server.received == []


@pytest.mark.parametrize(("words", "told"), [(b"not now", "not now"), (b"", "no reason given")])
def test_a_server_that_wants_a_key_and_got_none_is_told_with_the_reason(
    words: bytes, told: str
) -> None:
    def wants_a_key(server: Loopback, handler: Handler) -> None:
        handler.send(words, status=401)

    with loopback(wants_a_key) as server:
        fallback = asked(server, picture=False).judge(inserted()).fallback
    assert f"401: {told}; no key was sent to http://127.0.0.1:" in fallback
    assert "PLIANT_VLM_KEY is for https://vlm.example.org" in fallback
    assert "\n" not in fallback


@pytest.mark.parametrize("model", ["openai:gpt-4o", "openai-chat:gpt-4o"])
def test_a_variable_does_not_lead_a_providers_key_elsewhere(
    model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with loopback(speaks_for_the_rules) as server:
        monkeypatch.setenv("OPENAI_BASE_URL", server.base_url)
        with pytest.raises(InputError, match=f"points its provider to {server.base_url}, and"):
            vlm(Settings(model=model))
    assert server.received == []


@pytest.mark.parametrize("code", [301, 302, 307, 308])
def test_a_redirect_is_not_followed_and_its_target_is_named(
    code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    with loopback(speaks_for_the_rules) as theirs:
        target = f"{theirs.base_url}/chat/completions"
        with loopback(status(code, Location=f"{target}?key=secret")) as mine:
            monkeypatch.setenv("PLIANT_VLM_KEY_FOR", mine.base_url)
            verdict = asked(mine, picture=False, deadline_s=30).judge(inserted())
    assert len(mine.received) == 1
    assert theirs.received == []
    assert f"{mine.base_url} sends what it is asked on to {target}: it is not" in verdict.fallback
    assert "secret" not in verdict.fallback
    assert "\n" not in verdict.fallback


def test_headers_meant_for_openai_are_not_sent_elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENAI_CUSTOM_HEADERS", "X-Secret: 1")
    with pytest.raises(InputError, match="OPENAI_CUSTOM_HEADERS is set"):
        vlm(Settings(model="small", base_url="http://localhost:8000/v1"))


def test_a_key_that_the_server_sends_back_stays_out_of_every_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def echo(server: Loopback, handler: Handler) -> None:
        if len(server.received) == 1:
            handler.send(f"no such key: {handler.headers['authorization']}".encode(), status=401)
        else:
            handler.send(completion(handler.received.body, f"your key is {KEY}"))

    tape = tmp_path / "tape.jsonl"
    with loopback(echo) as server:
        monkeypatch.setenv("PLIANT_VLM_KEY_FOR", server.base_url)
        settings = Settings(model="small", base_url=server.base_url, deadline_s=30)
        mind = vlm(settings, record=tape)
        verdicts = [mind.judge(inserted()) for _ in range(2)]
    assert "<PLIANT_VLM_KEY>" in verdicts[0].fallback
    assert "<PLIANT_VLM_KEY>" in verdicts[1].exchanges[0].reply
    assert KEY not in tape.read_text(encoding="utf-8")
    assert KEY not in repr(verdicts)


def test_connections_are_closed_when_the_answer_is_there() -> None:
    with loopback(speaks_for_the_rules) as server:
        mind = asked(server, deadline_s=30)
        mind.judge(inserted())
        assert mind.asked.provider.client.is_closed()
        assert mind.judge(inserted()).by == "vlm"  # and opened again


# --- what may come back --------------------------------------------------------------------------


def status(code: int, **headers: str) -> Behaviour:
    def behave(server: Loopback, handler: Handler) -> None:
        handler.send(b'{"error": {"message": "not now"}}', status=code, **headers)

    return behave


def dropped(server: Loopback, handler: Handler) -> None:
    handler.drop()


def half(server: Loopback, handler: Handler) -> None:
    content = completion(handler.received.body, "{}")
    handler.wfile.write(
        b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\n"
        + f"Content-Length: {len(content)}\r\n\r\n".encode()
        + content[: len(content) // 2]
    )
    handler.drop()


def drip(server: Loopback, handler: Handler) -> None:
    """A byte now and then, so that no read of the client ever takes long."""
    handler.wfile.write(b"HTTP/1.1 200 OK\r\nContent-Length: 100000\r\n\r\n")
    while not server.stopped.wait(0.05):
        handler.wfile.write(b" ")


def never(server: Loopback, handler: Handler) -> None:
    server.stopped.wait()
    handler.drop()


def not_json(server: Loopback, handler: Handler) -> None:
    handler.send(b"<html>It works!</html>", kind="text/html")


def wrong_type(server: Loopback, handler: Handler) -> None:
    handler.send(completion(handler.received.body, "{}"), kind="text/plain")


def other_json(server: Loopback, handler: Handler) -> None:
    handler.send(b'{"choices": []}')


def megabyte(server: Loopback, handler: Handler) -> None:
    handler.send(completion(handler.received.body, "x" * 1_000_000))


@pytest.mark.parametrize(
    ("behave", "tries", "says"),
    [
        (status(429), 3, "429"),
        (status(429, Retry_After="0"), 3, "429"),
        (status(429, Retry_After="86400"), 1, "429"),
        (status(500), 3, "500"),
        (status(503), 3, "503"),
        (status(401), 1, "401"),
        (status(404), 1, "404"),
        (dropped, 3, "onnection"),
        (half, 3, ""),
        (drip, 1, "no usable reply within 2 s"),
        (never, 1, "no usable reply within 2 s"),
        (not_json, 1, "JSON"),
        (wrong_type, 2, "Field required"),
        (other_json, 1, ""),
        (megabyte, 2, "JSON"),
    ],
    ids=lambda value: getattr(value, "__name__", None),
)
def test_a_server_that_fails_costs_a_few_tries_and_no_more_than_the_deadline(
    behave: Behaviour, tries: int, says: str
) -> None:
    case = inserted()
    with loopback(behave) as server:
        mind = asked(server, picture=False)
        started = time.monotonic()
        verdict = mind.judge(case)
        took_s = time.monotonic() - started
    assert (verdict.by, verdict.success) == ("rules", Rules().judge(case).success)
    assert says in verdict.fallback
    assert len(server.received) == tries
    assert verdict.exchanges[-1].refused
    assert took_s < DEADLINE_S + LATE_S
    assert all(len(exchange.reply) < 25_000 for exchange in verdict.exchanges)


def test_a_server_that_is_not_there_is_an_answer_too() -> None:
    with loopback(never) as server:
        address = server.base_url
    mind = vlm(Settings(model="small", base_url=address, deadline_s=DEADLINE_S, picture=False))
    assert "onnection" in mind.judge(inserted()).fallback


def test_a_server_that_stays_silent_is_not_asked_for_ever() -> None:
    case = inserted()
    with loopback(status(404)) as server:
        mind = asked(server, picture=False)
        verdicts = [mind.judge(case) for _ in range(5)]
    assert len(server.received) == 3
    assert "not asked" in verdicts[-1].fallback
    assert all(verdict.by == "rules" for verdict in verdicts)


def test_a_server_that_recovers_is_heard() -> None:
    def later(server: Loopback, handler: Handler) -> None:
        (status(503) if len(server.received) == 1 else speaks_for_the_rules)(server, handler)

    with loopback(later) as server:
        verdict = asked(server, deadline_s=30).judge(inserted())
    assert verdict.by == "vlm"
    assert len(verdict.exchanges) == 1

"""The model that comes with pliant: how it is chosen, what it brings, and the server behind it."""

import json
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.error import URLError
from urllib.request import urlopen

import pytest
import tyro
from documents import ROOT
from local_model import NAME, weights_in
from pydantic_ai.messages import ModelResponse, TextPart

from pliant.cli import main
from pliant.cli.model import ModelOptions
from pliant.errors import InputError
from pliant.experiment import plan, price
from pliant.experiment.cells import Experiment
from pliant.experiment.trust import Named
from pliant.reasoners import vlm
from pliant.reasoners.vlm import local
from pliant.reasoners.vlm.models import model_of
from pliant.reasoners.vlm.settings import SHIPPED, Output, Plans, Settings, from_fields
from pliant.reasoners.vlm.tape import Recorder, Reply, Request

pytest_plugins = ["local_model"]

PLIANT = Path(sys.executable).with_name("pliant")
LONGEST_S = 60.0
BROUGHT = (Output.NATIVE, 192, True, 3)


def brought(settings: Settings) -> tuple[object, ...]:
    return settings.output_mode, settings.picture_px, settings.brief, settings.history


# --- how it is chosen ----------------------------------------------------------------------------


def planned(*words: str, **fields: object) -> Experiment:
    """What `pliant experiment` plans of these options beside a file's fields."""
    given = {"pegs": "circle", "conditions": "none", "reasoners": "vlm", "trials": 1}
    options = tyro.cli(ModelOptions, args=words)
    return plan.from_fields({**given, **fields}, {"vlm": options.given}, unnamed=options.unnamed)


def settings_of(*words: str, **fields: object) -> Settings:
    (spec,) = planned(*words, **fields).specs()
    assert spec.vlm is not None
    return spec.vlm


@pytest.mark.parametrize("words", [(), ("--model", "local"), ("--model", SHIPPED)])
def test_without_another_model_it_is_the_one_that_comes_with_pliant(words: tuple[str, ...]) -> None:
    settings = settings_of(*words)
    assert (settings.name, settings.is_local, settings.base_url) == (SHIPPED, True, None)
    assert brought(settings) == BROUGHT
    assert planned(*words).fingerprint == planned().fingerprint


def test_a_tuned_one_is_a_folder_that_counts_from_where_it_is_named(tmp_path: Path) -> None:
    settings = from_fields({"model": "local:mine"})
    assert settings.folder == Path.cwd() / "mine"
    assert settings.name == "local:mine"
    assert brought(settings) == BROUGHT
    file = tmp_path / "plan.yaml"
    file.write_text(
        "pegs: circle\nconditions: none\nreasoners: [vlm, {name: b, model: 'local:b'}]\n"
        "vlm: {model: 'local:a'}\n",
        encoding="utf-8",
    )
    read = plan.load(file, agree=lambda named: None)
    folders = [cell.vlm.folder for cell in read.cells if cell.vlm is not None]
    assert folders == [tmp_path / "a", tmp_path / "b"]
    assert read.models == ["local:a", "local:b"]


@pytest.mark.parametrize(
    "words",
    [("--model", "openai:gpt-4o"), ("--base-url", "http://h/v1", "--model", "m")],
)
def test_another_model_gets_nothing_of_what_it_brings(words: tuple[str, ...]) -> None:
    settings = settings_of(*words)
    assert not settings.is_local
    assert (settings.picture_px, settings.brief, settings.history) == (None, False, 5)


@pytest.mark.parametrize("name", [SHIPPED, "local:mine"])
def test_what_the_model_said_is_replayed_without_naming_it(name: str, tmp_path: Path) -> None:
    folder = tmp_path / "talks"
    for tape in (tmp_path / "talk.jsonl", folder / "L0-circle-all-vlm-1.jsonl"):
        said = ModelResponse(parts=[TextPart("yes")], model_name=name)
        reply = Reply(message=said, error="", latency_s=0.0)
        Recorder(tape).keep(Request(words={}, pictures=()), reply)
    for given in (tmp_path / "talk.jsonl", folder):
        settings = settings_of("--replay", str(given))
        assert settings == tyro.cli(ModelOptions, args=["--replay", str(given)]).settings
        assert settings.name == name
        assert brought(settings) == BROUGHT


def test_a_recording_of_another_model_brings_nothing() -> None:
    stored = str(ROOT / "tests" / "recordings" / "circle-all-6.jsonl")
    assert settings_of("--replay", stored).model is None
    assert not settings_of("--replay", stored).brief
    assert settings_of("--replay", stored, "--model", "local").brief


def test_served_elsewhere_under_its_name_it_brings_the_same() -> None:
    settings = settings_of("--base-url", "http://127.0.0.1:1/v1", "--model", SHIPPED)
    assert not settings.is_local
    assert brought(settings) == BROUGHT


def test_what_is_given_wins_over_what_it_brings_and_that_over_a_preset() -> None:
    paper = settings_of("--preset", "paper")
    assert (paper.plan, paper.fallback) == (Plans.ABSOLUTE, False)
    assert brought(paper) == BROUGHT
    given = "--no-brief", "--history", "5", "--picture-px", "None", "--output", "tool"
    own = settings_of(*given, "--preset", "paper")
    assert brought(own) == (Output.TOOL, None, False, 5)
    in_a_file = settings_of(vlm={"brief": False, "preset": "paper", "history": 0})
    assert brought(in_a_file) == (Output.NATIVE, 192, False, 0)
    hosted = settings_of("--preset", "paper", vlm={"model": "openai:gpt-4o"})
    assert settings_of("--history", "5", vlm={"history": 0}).history == 5
    assert (hosted.history, hosted.output_mode) == (0, Output.TOOL)


def test_it_costs_nothing_and_a_file_may_name_it(tmp_path: Path) -> None:
    assert price.estimate(planned()) is None
    assert price.estimate(planned("--model", "local:mine")) is None
    told: list[Named] = []
    file = tmp_path / "theirs.yaml"
    for model in ("local", "local:weights"):
        file.write_text(
            f"pegs: circle\nconditions: none\nreasoners: vlm\nvlm: {{model: '{model}'}}\n",
            encoding="utf-8",
        )
        plan.load(file, agree=told.append)
    assert [named.servers for named in told] == [(), (f"local:{tmp_path / 'weights'}",)]


# --- where something is missing ------------------------------------------------------------------


def ended(*words: str, patch: pytest.MonkeyPatch) -> int | str | None:
    patch.setattr(sys, "argv", ["pliant", *words])
    with pytest.raises(SystemExit) as end:
        main()
    return end.value.code


@pytest.mark.parametrize(
    "words",
    [
        ("run", "--reasoner", "vlm", "--out", "out"),
        ("experiment", "--reasoners", "vlm", "--trials", "1", "--out", "out"),
        ("bench-reasoner", "vlm", "--limit", "1"),
        ("serve-model",),
    ],
)
@pytest.mark.parametrize("missing", ["xllamacpp", "pliant_vlm", "pliant_vlm/model.gguf"])
def test_what_is_missing_is_one_line_that_names_the_extra_and_nothing_moves(
    words: tuple[str, ...],
    missing: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def found(name: str) -> object:
        return None if name == missing else sys  # whose file is in a folder without weights

    monkeypatch.setattr(local, "find_spec", found)
    monkeypatch.setattr(local, "_shipped", lambda: tmp_path if found("pliant_vlm") else None)
    monkeypatch.chdir(tmp_path)
    assert ended(*words, patch=monkeypatch) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert f"'local' ({missing} is missing)" in said
    assert "pliant[local]" in said or "'.[local]'" in said
    assert "--model" in said
    assert [*tmp_path.iterdir()] == []


@pytest.mark.parametrize("server", [sys, None], ids=["with the extra", "without it"])
def test_a_folder_without_weights_is_one_line_that_names_it(
    server: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(local, "find_spec", lambda name: server)
    for name in (local.MODEL, local.PROJECTOR):
        with pytest.raises(InputError, match=rf"'{tmp_path / name}' is not there"):
            vlm(from_fields({"model": f"local:{tmp_path}"}))
        (tmp_path / name).touch()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--port", "70000"), "from 0 to 65535"),
        (("--weights", "a.gguf"), "--weights and --projector belong together"),
    ],
)
def test_a_server_that_is_asked_for_wrongly_is_one_line(
    words: tuple[str, ...],
    says: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert ended("serve-model", *words, patch=monkeypatch) == 2
    assert says in capsys.readouterr().err


# --- the server ----------------------------------------------------------------------------------


@pytest.fixture
def chosen(local_model: Path) -> Iterator[Settings]:
    """Settings of a model that this process serves; its server ends with the test."""
    yield from_fields({"model": f"local:{local_model}"})
    local.close()


def answers(url: str) -> bool:
    try:
        with urlopen(f"{url}/models") as reply:
            return reply.status == 200
    except (URLError, ConnectionError):
        return False


def ends(url: str) -> bool:
    end = time.monotonic() + LONGEST_S
    while answers(url):
        if time.monotonic() > end:
            return False
        time.sleep(0.05)
    return True


@pytest.mark.system
def test_a_process_has_one_server_that_any_number_of_models_ask(chosen: Settings) -> None:
    one, other = model_of(chosen), model_of(chosen)
    assert one.base_url == other.base_url
    with urlopen(f"{str(one.base_url).rstrip('/')}/models") as reply:
        (served,) = json.load(reply)["data"]
    assert served["id"] == chosen.name == one.model_name == f"local:{NAME}"


@pytest.mark.system
def test_another_model_takes_the_servers_place(
    chosen: Settings, local_model: Path, tmp_path: Path
) -> None:
    first = local.base_url(chosen)
    for name in (local.MODEL, local.PROJECTOR):
        (tmp_path / name).symlink_to(local_model / name)
    second = local.base_url(from_fields({"model": f"local:{tmp_path}"}))
    assert answers(second)
    assert ends(first)


@pytest.mark.system
def test_it_listens_on_the_loopback_address_alone(chosen: Settings) -> None:
    host, _, port = (
        local.base_url(chosen).removeprefix("http://").removesuffix("/v1").partition(":")
    )
    assert host == "127.0.0.1"
    for address in ("127.0.0.2", socket.gethostbyname(socket.gethostname())):
        if address != host:
            with pytest.raises(ConnectionRefusedError):
                socket.create_connection((address, int(port)), timeout=5)


@pytest.mark.system
def test_a_key_for_another_server_neither_stops_it_nor_is_sent(
    chosen: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PLIANT_VLM_KEY", "secret")
    assert model_of(chosen).client.api_key == "none"  # type: ignore[attr-defined]


@pytest.mark.system
def test_a_server_that_cannot_start_says_why(local_model: Path, tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=rf"did not start: .*{port}") as raised:
            local.Server(weights_in(local_model), port)
    assert "\n" not in str(raised.value)
    (tmp_path / local.MODEL).write_bytes(b"no weights")
    (tmp_path / local.PROJECTOR).symlink_to(local_model / local.PROJECTOR)
    with pytest.raises(InputError, match=r"did not start: .*failed to load model") as raised:
        vlm(from_fields({"model": f"local:{tmp_path}"}))
    assert "\n" not in str(raised.value)


@pytest.mark.system
def test_a_server_that_ends_by_itself_is_one_line(chosen: Settings) -> None:
    url = local.base_url(chosen)
    server = local._own  # noqa: SLF001, nobody else can end it
    assert server is not None
    server._process.kill()  # noqa: SLF001
    server._process.wait()  # noqa: SLF001
    assert not answers(url)
    with pytest.raises(InputError, match="ended by itself"):
        local.base_url(chosen)


@pytest.mark.system
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_it_ends_with_the_process_that_started_it(how: signal.Signals, local_model: Path) -> None:
    code = (
        "import sys, time\n"
        "from pliant.reasoners.vlm import local\n"
        "from pliant.reasoners.vlm.settings import from_fields\n"
        "print(local.base_url(from_fields({'model': f'local:{sys.argv[1]}'})), flush=True)\n"
        "time.sleep(600)"
    )
    command = [sys.executable, "-c", code, str(local_model)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, encoding="utf-8") as run:
        assert run.stdout is not None
        url = run.stdout.readline().strip()
        assert answers(url)
        run.send_signal(how)
        run.communicate()
    assert ends(url)


@pytest.mark.system
def test_it_is_served_until_ctrl_c_and_says_how_to_ask_it(local_model: Path) -> None:
    files = "--weights", local_model / local.MODEL, "--projector", local_model / local.PROJECTOR
    pipe = subprocess.PIPE
    with subprocess.Popen(
        [PLIANT, "serve-model", *files], stdout=pipe, stderr=pipe, encoding="utf-8"
    ) as run:
        assert run.stdout is not None
        url = run.stdout.readline().strip()
        assert answers(url)
        run.send_signal(signal.SIGINT)
        _, said = run.communicate()
    assert run.returncode == 0
    assert f"--base-url {url} --model local:{NAME}" in said
    assert ends(url)


@pytest.mark.system
def test_every_worker_of_an_experiment_has_a_server_and_the_trials_name_the_model(
    local_model: Path, tmp_path: Path
) -> None:
    words = "experiment", "--conditions", "none", "--reasoners", "vlm", "--trials", "2"
    few = "--max-requests", "1", "--workers", "2", "--recover", "rules", "--reply-tokens", "200"
    command = [str(PLIANT), *words, *few, "--model", f"local:{local_model}"]
    command += ["--out", str(tmp_path / "e")]
    done = subprocess.run(command, capture_output=True, encoding="utf-8", check=False)
    assert done.returncode == 0, done.stderr
    journal = (tmp_path / "e" / "journal.jsonl").read_text(encoding="utf-8")
    assert journal.count(f'"model": "local:{NAME}"') + journal.count(f'"model":"local:{NAME}"') == 2
    again = subprocess.run(command, capture_output=True, encoding="utf-8", check=False)
    assert again.returncode == 0, again.stderr  # the same, at another port
    assert "resuming: 2 of 2 trials are there" in again.stderr

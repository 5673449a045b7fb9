"""What every test needs before it is collected."""

import os
import signal
from collections.abc import Iterator

import pydantic_ai.models
import pytest
from hypothesis import settings

import pliant.sim  # noqa: F401, chooses the OpenGL back end before a test imports MuJoCo

settings.register_profile("local", deadline=None)  # a first picture takes a second
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "local")

pydantic_ai.models.ALLOW_MODEL_REQUESTS = False

if "PYTEST_XDIST_WORKER" in os.environ:  # what a test starts says what it says to a user
    os.environ.pop("PYTHONWARNDEFAULTENCODING", None)

for number in (signal.SIGINT, signal.SIGHUP):
    # A background job ignores them, and so would all that it starts; a handler is not inherited.
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, lambda *_: None)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What takes minutes begins first, so that no worker waits for it in the end."""
    items.sort(key=lambda item: item.get_closest_marker("long") is None)


@pytest.fixture(autouse=True)
def _only_own_servers_are_asked(request: pytest.FixtureRequest) -> Iterator[None]:
    """No test asks a real model, but those that start a server of their own: marked `system`, or
    using `own_server`."""
    own = "own_server" in request.fixturenames or request.node.get_closest_marker("system")
    with pydantic_ai.models.override_allow_model_requests(bool(own)):
        yield

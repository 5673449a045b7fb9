"""Robust and resilient object insertion with a soft robotic wrist."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pliant.experiment.compared import Results as Results
    from pliant.experiment.compared import compare as compare
    from pliant.experiment.one import run as run

    __version__: str


def __getattr__(name: str) -> Any:
    """Import a public name when it is asked for, so that `import pliant` alone takes no time."""
    if name == "run":
        from pliant.experiment.one import run

        return run
    if name in ("compare", "Results"):
        from pliant.experiment import compared

        return getattr(compared, name)
    if name == "__version__":
        from importlib.metadata import version

        return version(__name__)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")

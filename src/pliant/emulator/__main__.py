"""`python -m pliant.emulator`: serve an emulated UR5e cell until it is stopped."""

import asyncio
import selectors
import sys

import tyro

from pliant.console import complain, say
from pliant.emulator.emulator import Options
from pliant.emulator.serving import serve
from pliant.ending import in_a_line
from pliant.text import replace_unshowable
from pliant.usage import HELP, Usage, page, refuse_repeats, taken

_PROGRAM = "python -m pliant.emulator"


def main() -> None:
    """Run the program. Exit status: 0 stopped, 2 wrong usage or a port that is taken, 130
    interrupted before it was ready."""
    replace_unshowable(sys.stdout, sys.stderr)
    with in_a_line("pliant.emulator"):
        _served(sys.argv[1:])


def _served(words: list[str]) -> None:
    flags = (tyro.conf.EnumChoicesFromValues, tyro.conf.FlagCreatePairsOff)
    if any(word in HELP for word in words):
        say(page(_PROGRAM, Options, Usage()))
        return
    refuse_repeats(words, Options)
    options = taken(
        words, Options, lambda: tyro.cli(Options, prog=_PROGRAM, config=flags), _PROGRAM
    )
    is_loopback = options.is_loopback()  # refuses what is no address

    def tell(ready: str) -> None:
        if not is_loopback:
            complain(
                f"warning: {options.host} can be reached from other machines, and nothing here"
                " asks for a password"
            )
        say(ready)

    # The default selector rounds waits up to milliseconds, which are most of a tick.
    with asyncio.Runner(
        loop_factory=lambda: asyncio.SelectorEventLoop(selectors.SelectSelector())
    ) as runner:
        runner.run(serve(options, tell))


if __name__ == "__main__":
    main()

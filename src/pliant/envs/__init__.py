"""Gymnasium environments on the simulated cell: `pliant/Insertion-v0` and `pliant/Recovery-v0`.

Importing this package registers both. It needs the extra `gym`; MuJoCo is imported when the first
environment is made.
"""

from pliant.errors import InputError, installing

try:
    import gymnasium
except ModuleNotFoundError as error:
    raise InputError(f"the environments need the extra 'gym': {installing('gym')}") from error

_HERE = "pliant.envs"

gymnasium.register(
    "pliant/Insertion-v0", entry_point=f"{_HERE}.insertion:InsertionEnv", max_episode_steps=1000
)
gymnasium.register(
    "pliant/Recovery-v0", entry_point=f"{_HERE}.recovery:RecoveryEnv", max_episode_steps=20
)

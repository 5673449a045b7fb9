"""The Gymnasium environments keep Gymnasium's rules and the project's: same seed, same episode; no
truth in an observation; everything through the envelope."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from stand_ins import UNSEEN, case_after, outcome_of, scene_of, verdict_of

from pliant.cell import Motion
from pliant.conditions import Condition, Setup, condition
from pliant.envelope import Limits
from pliant.envs.decision import ACTION, FIELDS, as_action, as_recovery, numbers
from pliant.envs.insertion import STATE, STEP_M, STEP_RAD, InsertionEnv
from pliant.envs.recovery import EXECUTION_COST, RecoveryEnv
from pliant.errors import InputError, RobotFault, installing
from pliant.experiment.one import Spec, perform
from pliant.formations import RECOVERABLE, Formation
from pliant.pose import Axis, Pose
from pliant.reasoners.rules import Rules
from pliant.recovery import admit
from pliant.sim.cell import SimCell
from pliant.sim.stream import Streamed
from pliant.task import load_task
from pliant.teaching import shipped

INSERTION, RECOVERY = "pliant/Insertion-v0", "pliant/Recovery-v0"
FAILS = 1  # a seed of the circle under `all` in which Fit fails


def insertion(**options: Any) -> InsertionEnv:
    env = gymnasium.make(INSERTION, **options).unwrapped
    assert isinstance(env, InsertionEnv)
    return env


def recovery(**options: Any) -> RecoveryEnv:
    env = gymnasium.make(RECOVERY, **options).unwrapped
    assert isinstance(env, RecoveryEnv)
    return env


def actions(n: int, size: int) -> NDArray[np.float32]:  # (n, size)
    return np.random.default_rng(0).uniform(-1, 1, (n, size)).astype(np.float32)


def known(reset: tuple[Any, dict[str, Any]]) -> dict[str, Any]:
    truth = reset[1]["truth"]
    assert isinstance(truth, dict)
    return truth


# --- Gymnasium's own rules ---------------------------------------------------------------------


@pytest.mark.parametrize(
    "make",
    [
        insertion,
        lambda: insertion(observation="both", axes=["x", "yaw"], start="contact"),
        lambda: insertion(observation="picture", picture_width=32, reward="shaped"),
        recovery,
    ],
    ids=["state", "both", "picture", "recovery"],
)
def test_gymnasiums_checker_finds_nothing_to_warn_of(
    make: Callable[[], gymnasium.Env[Any, Any]],
) -> None:
    check_env(make())


@pytest.mark.parametrize(("name", "size", "n"), [(INSERTION, 3, 60), (RECOVERY, len(ACTION), 2)])
def test_vectors_in_one_process_and_in_several_give_the_same(name: str, size: int, n: int) -> None:
    chosen = actions(2 * n, size).reshape(n, 2, size)
    seen = []
    for mode, options in (("sync", {}), ("async", {"context": "spawn"})):
        vector = gymnasium.make_vec(
            name, num_envs=2, vectorization_mode=mode, vector_kwargs=options
        )
        first, info = vector.reset(seed=FAILS)
        steps = [vector.step(action) for action in chosen]
        truths = [s[4]["truth"]["hole_y"].tolist() for s in steps] + [info["truth"]["hole_y"]]
        seen.append((first.tobytes(), [(s[0].tobytes(), *map(list, s[1:4])) for s in steps]))
        assert np.ptp(truths[0]) > 0  # each has a seed of its own
        vector.close()
    assert seen[0] == seen[1]


# --- seeds -------------------------------------------------------------------------------------


def episode(env: gymnasium.Env[Any, Any], seed: int | None, n: int) -> list[bytes]:
    """The bits of the observations and rewards of up to n steps."""
    assert env.action_space.shape is not None
    observation, _ = env.reset(seed=seed)
    bits = [observation.tobytes()]
    for action in actions(n, env.action_space.shape[0]):
        observation, reward, terminated, truncated, _ = env.step(action)
        bits.append(observation.tobytes() + np.float64(reward).tobytes())
        if terminated or truncated:
            break
    return bits


@pytest.mark.parametrize(("make", "n"), [(insertion, 150), (recovery, 2)])
def test_the_same_seed_and_actions_give_the_same_bits_whatever_came_before(
    make: Callable[[], gymnasium.Env[Any, Any]], n: int
) -> None:
    env = make()
    first, then = episode(env, FAILS, n), episode(env, None, n)
    env.reset(seed=4)  # and left in the middle
    assert (episode(env, FAILS, n), episode(env, None, n)) == (first, then)
    assert episode(make(), FAILS, n) == first
    assert then != first


def test_a_seed_draws_the_trial_that_an_experiment_runs() -> None:
    env = insertion(condition="all")
    _, info = env.reset(seed=7)
    assert info["seed"] == 7
    drawn = condition("all").draw(7).quantities()
    assert {name: info["truth"][name] for name in drawn} == drawn


def test_the_observation_at_rest_does_not_depend_on_where_the_hole_is() -> None:
    at = [Condition(name="here", ranges={"hole_y": (y, y)}) for y in (-0.02, 0.02)]
    one, two = (insertion(condition=c).reset(seed=0) for c in at)
    assert one[0].tobytes() == two[0].tobytes()
    assert known(one)["hole_y"] != known(two)["hole_y"]


# --- Insertion-v0 ------------------------------------------------------------------------------


def drive(env: InsertionEnv, to: Pose, *, steps: int = 400) -> dict[str, Any]:
    """Step the set point straight to a pose, in y, z and roll; what the last step returned."""
    axes, scale = (Axis.Y, Axis.Z, Axis.ROLL), (STEP_M, STEP_M, STEP_RAD)
    total, here = 0.0, Pose(z=load_task("circle").tip_below_hinge + 0.06)
    for _ in range(steps):
        change = np.array([(to[a] - here[a]) / s for a, s in zip(axes, scale, strict=True)])
        change = np.clip(change, -1, 1)
        observation, reward, terminated, truncated, info = env.step(change)
        total += reward
        here = here.updated(
            {a: here[a] + c * s for a, c, s in zip(axes, change, scale, strict=True)}
        )
        if terminated or truncated or np.abs(change).max() < 1e-9:
            break
    assert not truncated
    return {"observation": observation, "total": total, "terminated": terminated, **info}


def test_a_peg_over_its_hole_is_inserted_by_going_down_and_that_ends_it() -> None:
    env = insertion(condition="none")
    env.reset(seed=0)
    ended = drive(env, Pose(z=0.16))
    assert ended["terminated"]
    assert ended["truth"]["inserted"]
    assert ended["truth"]["depth_m"] == pytest.approx(0.010, abs=0.002)
    assert 0.9 < ended["total"] < 1.0  # one for the peg, less the time


def test_a_full_action_moves_the_set_point_by_the_documented_step() -> None:
    env = insertion(condition="none", axes=("y", "yaw"))
    first, _ = env.reset(seed=0)
    for _ in range(20):
        last, *_ = env.step(np.array([-1.0, 1.0]))
    for _ in range(20):
        last, *_ = env.step(np.zeros(2))
    moved = last - first
    assert moved[STATE.index("y")] == pytest.approx(-20 * STEP_M, abs=2e-4)
    assert moved[STATE.index("yaw")] == pytest.approx(20 * STEP_RAD, abs=2e-3)
    assert moved[STATE.index("z")] == pytest.approx(0.0, abs=2e-4)
    assert moved[STATE.index("goal_y")] == pytest.approx(20 * STEP_M, abs=2e-4)


def test_pushing_on_and_on_beside_the_hole_never_presses_past_the_limit() -> None:
    hole_far = Condition(name="far", ranges={"hole_y": (0.04, 0.04)})
    env = insertion(condition=hole_far)
    env.reset(seed=0)
    stops, pressed = [], []
    for _ in range(400):
        observation, *_, info = env.step(np.array([0.0, -1.0, 0.0]))
        stops.append(observation[STATE.index("stopped")] == 1.0)
        pressed.append(observation[STATE.index("compression")])
        assert stops[-1] == (info["stop"] == "compression")
    assert sum(stops) > 100
    assert max(pressed) < Limits().compression_m + 0.0007


def test_the_workspaces_border_is_not_passed() -> None:
    env = insertion(condition="none", axes=("y", "z"))
    env.reset(seed=0)
    for _ in range(300):
        observation, _, terminated, truncated, info = env.step(np.array([1.0, 1.0]))
        assert (terminated, truncated, info["fault"]) == (False, False, "")
    assert observation[STATE.index("y")] == pytest.approx(Limits().high.y, abs=1e-3)
    assert observation[STATE.index("z")] == pytest.approx(Limits().high.z, abs=1e-3)


def test_the_shaped_reward_adds_the_progress_of_the_tip() -> None:
    totals, away = [], []
    for reward in ("sparse", "shaped"):
        env = insertion(reward=reward)
        infos = [env.reset(seed=0)[1]]
        total = 0.0
        for action in actions(100, 3):
            _, gained, _, _, info = env.step(action)
            total += gained
            infos.append(info)
        totals.append(total)
        truths = (infos[0]["truth"], infos[-1]["truth"])
        away = [np.hypot(t["tip_y"] - t["hole_y"], t["depth_m"] - 0.010) for t in truths]
    assert totals[0] == pytest.approx(-0.1)
    assert totals[1] - totals[0] == pytest.approx(10.0 * (away[0] - away[1]), abs=1e-9)


def test_a_start_after_a_formation_is_where_the_taught_skill_ends() -> None:
    env = insertion(condition="none", start="contact")
    observation, info = env.reset(seed=0)
    taught = shipped().goals
    pose = Pose(**{a: float(observation[STATE.index(a)]) for a in Axis})
    error = taught.target(Formation.CONTACT).error(pose, list(Axis))
    assert all(abs(e) < (0.005 if a.is_angle else 0.001) for a, e in error.items())
    assert observation[STATE.index("compression")] > 0.003
    assert info["time_s"] > 1.0


def test_a_fault_cuts_the_episode_short_and_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    env = insertion()
    env.reset(seed=0)

    def broken(*_: object, **__: object) -> Motion:
        raise RobotFault("lost", "scripted")

    monkeypatch.setattr(Streamed, "move_to", broken)
    _, _, terminated, truncated, info = env.step(np.zeros(3))
    assert (terminated, truncated, info["fault"]) == (False, True, "scripted")


def test_rendering_gives_a_picture_and_takes_nothing_from_the_episode() -> None:
    seen = []
    for mode in (None, "rgb_array"):
        env = insertion(render_mode=mode)
        env.reset(seed=0)
        drawn = env.render()
        seen.append(env.step(np.ones(3))[0].tobytes())
    assert drawn is not None
    assert drawn.shape == (480, 640, 3)
    assert drawn.std() > 10
    assert seen[0] == seen[1]


# --- a stream of set points --------------------------------------------------------------------


def test_a_streamed_motion_takes_its_period_or_as_long_as_its_speed_asks() -> None:
    robot = SimCell().prepare(load_task("circle"), Setup(seed=0))
    stream, here = Streamed(robot, 0.02), robot.set_point()
    slow = here.updated({Axis.Y: 0.003})
    times = []
    for pose in (here.updated({Axis.Y: 0.001}), slow):
        motion = stream.move_to(pose, speed_m_s=0.05, stop_at_compression_m=0.02)
        times.append(motion.ended_s - motion.started_s)
    assert times == pytest.approx([0.02, 0.04])
    stream.settle(0.3)
    assert robot.pose().y == pytest.approx(0.003, abs=2e-4)


# --- Recovery-v0 -------------------------------------------------------------------------------


def test_answering_as_the_rules_do_runs_the_rules_trial() -> None:
    env = recovery()
    observation, info = env.reset(seed=FAILS)
    assert (info["seed"], info["formation"], info["executions"]) == (FAILS, "fit", 3)
    total, done = 0.0, False
    while not done:
        case, verdict = env.question.case, env.question.verdict
        assert numbers(case, verdict).tobytes() == observation.tobytes()
        answer = Rules().recover(case, verdict)
        assert answer is not None
        observation, reward, done, truncated, info = env.step(as_action(answer, case))
        assert not truncated
        total += reward
    spec = Spec(task=load_task("circle"), condition=condition("all"), seed=FAILS, reasoner="rules")
    trial = perform(spec, SimCell(), shipped())
    assert info["executions"] == len(trial.executions)
    assert info["end_reason"] == trial.end_reason == "inserted"
    assert total == pytest.approx(1.0 - EXECUTION_COST * (len(trial.executions) - 3))


def test_a_plan_that_is_refused_changes_nothing_and_costs_one_execution() -> None:
    env = recovery()
    before, _ = env.reset(seed=FAILS)
    refused = ""
    for _ in range(2):  # the second such step would leave the workspace
        asked = env.question
        after, reward, *ended, info = env.step(np.array([-1.0, 1.0, 1.0, 0.0, 0.0]))
        refused = info["refused"]
        if refused:
            break
        before = after
    assert "is outside the workspace" in refused
    assert env.question is asked
    assert after.tobytes() == before.tobytes()
    assert reward == -EXECUTION_COST
    assert ended == [False, False]


def test_losing_patience_is_cut_short_not_ended() -> None:
    env = recovery()
    env.reset(seed=FAILS)
    for _ in range(12):  # align back and forth, out of the hole
        side = -0.1 if env.question.case.goals.formations[Formation.ALIGN][Axis.Y] > 0 else 0.1
        _, _, terminated, truncated, info = env.step(np.array([0.0, 1.0, 0.0, side, 0.0]))
        if truncated:
            break
    assert (terminated, truncated) == (False, True)
    assert info["end_reason"] == "exhausted"
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(5))


def test_a_condition_under_which_nothing_fails_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pliant.envs.recovery._DRAWS", 2)
    env = recovery(condition="none")
    with pytest.raises(InputError, match="condition 'none': nothing failed in 2 trials; choose"):
        env.reset(seed=0)


# --- decisions in numbers ----------------------------------------------------------------------


@given(st.lists(st.floats(-1, 1), min_size=5, max_size=5), st.sampled_from(RECOVERABLE))
def test_an_action_is_the_recovery_it_stands_for(values: list[float], failed: Formation) -> None:
    case, action = case_after(outcome_of(failed)), np.array(values)
    planned = as_recovery(action, case, verdict_of(False), "agent")
    again = as_recovery(as_action(planned, case), case, verdict_of(False), "agent")
    assert [s.formation for s in again.steps] == [s.formation for s in planned.steps]
    assert [s.retreat for s in again.steps] == [s.retreat for s in planned.steps]
    for one, other in zip(planned.steps, again.steps, strict=True):
        assert dict(one.goal) == pytest.approx(dict(other.goal), abs=1e-12)
    assert admit(planned, case, Limits()).steps[:1] == planned.steps[:1] or planned.steps[0].retreat


def test_every_name_is_documented() -> None:
    text = (Path(__file__).parent.parent / "docs" / "environments.md").read_text(encoding="utf-8")
    missing = [name for name in (*STATE, *FIELDS, *ACTION) if f"`{name}`" not in text]
    assert not missing


def test_what_was_not_seen_is_nought_and_masked() -> None:
    seen = scene_of(tip_y=0.01, hole_y=-0.02)
    for scene, mask in ((UNSEEN, 0.0), (seen, 1.0)):
        told = numbers(case_after(outcome_of(Formation.FIT, scene=scene)), verdict_of(False))
        values = dict(zip(FIELDS, told.tolist(), strict=True))
        assert (values["peg_seen"], values["hole_seen"]) == (mask, mask)
        assert values["tip_y"] == pytest.approx(0.01 * mask)
        assert values["hole_y"] == pytest.approx(-0.02 * mask)
        assert values["hole_believed"] == 0.0
        assert values["failed_fit"] == 1.0
        assert values["failures"] == values["executions"] == 1.0


# --- what a user gets wrong --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        (INSERTION, {"peg": "star"}, "unknown peg 'star': valid are circle, d_shape, hexagon"),
        (INSERTION, {"level": "L99"}, "unknown level 'L99': valid are L0"),
        (INSERTION, {"condition": "wind"}, "unknown condition 'wind': valid are none, friction"),
        (INSERTION, {"axes": []}, r"axes \[\]: give a list of different ones of x, y, z, roll"),
        (INSERTION, {"axes": "yz"}, "axes 'yz': give a list"),
        (INSERTION, {"axes": ["y", "y"]}, r"axes \['y', 'y'\]: give a list of different ones"),
        (INSERTION, {"axes": ["tilt"]}, "unknown axis 'tilt': valid are x, y, z, roll"),
        (INSERTION, {"observation": "depth"}, "unknown observation 'depth': valid are state, pict"),
        (INSERTION, {"picture_width": 33}, "picture_width is 33: it must be a multiple of 4 from"),
        (INSERTION, {"picture_width": 4000}, "picture_width is 4000: it must be"),
        (INSERTION, {"reward": "dense"}, "unknown reward 'dense': valid are sparse, shaped"),
        (INSERTION, {"start": "insertion"}, "unknown start 'insertion': valid are home, approach"),
        (RECOVERY, {"peg": "star"}, "unknown peg 'star'"),
        (RECOVERY, {"level": "L99"}, "unknown level 'L99'"),
        (RECOVERY, {"condition": "wind"}, "unknown condition 'wind'"),
    ],
)
def test_a_bad_option_is_refused_in_one_line(
    name: str, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message) as refused:
        gymnasium.make(name, **options)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("env", [InsertionEnv, RecoveryEnv])
def test_a_bad_render_mode_option_or_action_is_refused_in_one_line(
    env: type[InsertionEnv | RecoveryEnv],
) -> None:
    with pytest.raises(InputError, match="unknown render_mode 'human': valid are rgb_array"):
        env(render_mode="human")
    made = env(render_mode="rgb_array")
    with pytest.raises(gymnasium.error.ResetNeeded):
        made.render()
    with pytest.raises(InputError, match="reset has no option 'hole_y': give the seed alone"):
        made.reset(seed=FAILS, options={"hole_y": 0.0})
    made.reset(seed=FAILS)
    assert made.action_space.shape is not None
    size = made.action_space.shape[0]
    with pytest.raises(InputError, match=rf"action has shape \(2,\): it must be \({size},\)"):
        made.step(np.zeros(2))
    with pytest.raises(InputError, match="is not finite: give numbers from -1 to 1"):
        made.step(np.full(size, np.nan))


# --- what importing costs ----------------------------------------------------------------------


def run(program: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", program], capture_output=True, encoding="utf-8", check=False
    )


def test_pliant_alone_does_not_import_gymnasium_nor_the_environments_mujoco() -> None:
    program = "import sys, pliant.trial; assert 'gymnasium' not in sys.modules\n"
    program += "import pliant.envs; assert not {'mujoco', 'cv2.gapi'} & set(sys.modules)\n"
    program += f"import gymnasium; gymnasium.spec({INSERTION!r}); gymnasium.spec({RECOVERY!r})"
    done = run(program)
    assert done.returncode == 0, done.stderr


def test_without_gymnasium_the_error_names_the_extra_in_one_line() -> None:
    done = run("import sys; sys.modules['gymnasium'] = None\nimport pliant.envs")
    assert done.stderr.splitlines()[-1] == (
        f"pliant.errors.InputError: the environments need the extra 'gym': {installing('gym')}"
    )


def test_without_opengl_the_state_can_still_be_had() -> None:
    program = "import os; os.environ['MUJOCO_GL'] = 'disabled'\n"
    program += "import gymnasium, numpy, pliant.envs\n"
    program += f"env = gymnasium.make({INSERTION!r}); env.reset(seed=0); env.step(numpy.zeros(3))"
    done = run(program)
    assert done.returncode == 0, done.stderr

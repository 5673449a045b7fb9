"""What a stored trial's motion is sampled as: what the robot read, not what was true."""

from dataclasses import replace

import numpy as np
import pytest
from stand_ins import cell_for

from pliant.conditions import Condition
from pliant.experiment.one import Spec, perform
from pliant.export.track import Track, track
from pliant.records import Trial
from pliant.task import load_task
from pliant.teaching import shipped


def performed(**drawn: float) -> Trial:
    of = Condition(name="mine", ranges={name: (value, value) for name, value in drawn.items()})
    spec = Spec(task=load_task("circle"), condition=of, seed=1, reasoner="none")
    return perform(spec, cell_for("circle"), shipped())


def tracked(**drawn: float) -> Track:
    return track(performed(**drawn), cell_for("circle").trajectory(), 10)


def test_the_compression_is_the_one_that_was_read() -> None:
    """Where the sensor is right that is the joint's; where it is noisy it is not."""
    true = tracked().compression_m
    assert true.max() > 0.003
    noise = tracked(compression_noise=0.0003).compression_m - true
    assert 0.0001 < noise.std() < 0.0006


def test_a_sensor_that_reads_too_little_is_sampled_as_it_read() -> None:
    trial = performed(compression_scale=0.9)
    read, pressed = (
        track(known, cell_for("circle").trajectory(), 10).compression_m
        for known in (trial, replace(trial, drawn={}))
    )
    loaded = pressed > 0.002
    assert np.median(read[loaded] / pressed[loaded]) == pytest.approx(0.9, abs=0.02)


def test_a_dead_sensor_ends_the_trial_before_anything_that_it_read_could_be_sampled() -> None:
    dead = performed(compression_dead=1.0)
    assert dead.end_reason == "fault:sensor"
    assert dead.executions == ()

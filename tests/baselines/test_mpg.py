"""Multi-policy grounding: which weights it ends with."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mpge_bench.baselines.mpg import GroundingSettings, ground
from mpge_bench.baselines.problem import Problem
from mpge_bench.envs import get_task

TASK = get_task("biased_pendulum")
SETTINGS = GroundingSettings(steps=512, worlds=4, batch_size=128, warm_up=0, checkpoint=128)


@pytest.fixture
def grounded(pendulum_policies, tmp_path):
    """grounded(averaged=...) gives πg's weights after each batch and at the end."""

    def made(**changes):
        problem = Problem(TASK, pendulum_policies, 60, seed=0)
        target, shares = problem.demonstrations(pendulum_policies), problem.shares(len(pendulum_policies))
        return ground(TASK.source, pendulum_policies, target, shares, dataclasses.replace(SETTINGS, **changes), 0, tmp_path, lambda steps: None)

    return made


@pytest.mark.parametrize(("averaged", "count"), [(0.0, 1), (0.3, 2), (0.5, 2), (1.0, 4)])
def test_it_ends_with_the_mean_of_the_last_weights(grounded, averaged, count):
    plain, found = grounded(), grounded(averaged=averaged)
    assert list(found) == [128, 256, 384, 512]
    for name, end in found[512].items():
        np.testing.assert_allclose(end, np.mean([plain[steps][name] for steps in list(plain)[-count:]], axis=0), rtol=1e-9, atol=1e-12, err_msg=name)
        np.testing.assert_array_equal(found[256][name], plain[256][name], err_msg=name)
    assert (plain[512]["action_net.weight"] != plain[384]["action_net.weight"]).any()

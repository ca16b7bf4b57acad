"""What methods make of lifting and of falling once both are in their data: the property behind the paper's Figure 5.

Here the data is scripted and random play; what agents that trained by themselves make of it is docs/probes.md's matter.
"""

import numpy as np
import pytest
import torch

from curiobench.methods.icm import ICM
from curiobench.methods.mi import MI
from curiobench.methods.reward import Transitions
from curiobench.probe.episodes import play_scripts, reference_transitions, transitions
from curiobench.probe.steps import falling, lifting

UPDATES = 500
PARTS = ("observation", "action", "next_observation")
AT_THE_CAP = 500
"""An epoch in which MI's weight of conservativeness has stopped growing."""


@pytest.fixture(scope="module")
def trained():
    """MI and ICM that learned from lifts, falls and random play, and lifting and falling steps from other starts."""
    played = [transitions(p.episodes) for p in play_scripts("stack2", "gripper", 20, seed=1)]
    reference = reference_transitions("stack2", "gripper", seed=1)
    played.append({name: getattr(reference, name).numpy() for name in PARTS})
    data = {name: np.concatenate([part[name] for part in played]) for name in PARTS}
    mean, std = data["observation"].mean(0), data["observation"].std(0).clip(1e-2)

    def seen(arrays) -> Transitions:
        before, action, after = (arrays[name] for name in PARTS)
        states = [((state - mean) / std).clip(-5, 5) for state in (before, after)]
        tensors = (torch.as_tensor(array, dtype=torch.float32) for array in (states[0], action, states[1]))
        tensors = list(tensors)
        return Transitions(*tensors, AT_THE_CAP, particles=tensors[-1][:512])

    everything, rng = seen(data), np.random.default_rng(0)
    sizes = everything.state.shape[1], everything.action.shape[1]
    methods = [cls(*sizes, cls.Config(), torch.Generator().manual_seed(0)) for cls in (MI, ICM)]
    for _ in range(UPDATES):
        batch = everything.rows(torch.from_numpy(rng.integers(len(everything.state), size=256)))
        for method in methods:
            method.update(batch)
    stack, push = play_scripts("stack2", "gripper", 10, seed=2)
    lifts, falls = (
        seen(transitions(p.episodes)).rows(torch.from_numpy(find(p.track).ravel()))
        for p, find in ((stack, lifting), (push, falling))
    )
    return *methods, lifts, falls


def test_conservativeness_prefers_controlled_lifts_to_falls(trained):
    mi, _, lifts, falls = trained
    with torch.no_grad():
        of_lifts, of_falls = (mi.conservativeness(mi.log_density(steps)).mean() for steps in (lifts, falls))
    spread = mi.moments.std[1]
    assert (of_lifts - of_falls) / spread > 0.5


def test_a_prediction_error_prefers_falls(trained):
    _, icm, lifts, falls = trained
    assert icm.reward(falls).mean() > 1.5 * icm.reward(lifts).mean()

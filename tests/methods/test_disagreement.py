"""Disagreement: values in plain numpy; models agree on what they learned, and on noise."""

import numpy as np
import torch
from curiosity import fresh, plain, random_transitions, transitions_of, with_random_biases

from curiobench.methods.disagreement import Disagreement


def some_method(**config) -> Disagreement:
    method = fresh(Disagreement, models=3, **config)
    return with_random_biases(method, *method.models)


def predictions(method: Disagreement, batch) -> np.ndarray:
    """(K, B, D)."""
    inputs = np.hstack([batch.state.double().numpy(), batch.action.double().numpy()])
    return np.stack([plain(model, inputs) for model in method.models])


def test_reward_and_loss_in_numpy():
    """Each model does without every third transition, counted from its own number on."""
    method, batch = some_method(), random_transitions(7)
    found = predictions(method, batch)
    np.testing.assert_allclose(method.reward(batch), found.var(axis=0).mean(axis=1), rtol=1e-4)
    errors = ((found - batch.next_state.double().numpy()) ** 2).mean(axis=2)
    losses = [np.mean([errors[k, i] for i in range(7) if i % 3 != k]) for k in range(3)]
    np.testing.assert_allclose(method.update(batch)["disagreement_loss"], np.mean(losses), rtol=1e-4)


def test_models_agree_on_what_they_learned_and_on_noise():
    """The room is in the first number; in room 1 the next state is noise, and room 4 was never seen."""
    rng, method = np.random.default_rng(0), fresh(Disagreement, hidden=32)

    def room(number: float, noise: float, size: int = 64):
        state = np.column_stack([np.full(size, number), rng.normal(size=(size, 2))])
        action = rng.uniform(-1, 1, (size, 2))
        return transitions_of(
            state, action, np.column_stack([state[:, 0], action + noise * rng.normal(size=(size, 2))])
        )

    batches = [(room(0, 0), room(1, 1)) for _ in range(400)]
    before = method.reward(batches[0][1]).mean()
    for known, noisy in batches:
        parts = [torch.cat([getattr(b, name) for b in (known, noisy)]) for name in ("state", "action", "next_state")]
        order = torch.from_numpy(rng.permutation(128))
        method.update(transitions_of(*(part[order] for part in parts)))
    assert method.reward(batches[-1][1]).mean() < 0.3 * before
    assert method.reward(room(4, 0)).mean() > 3 * method.reward(batches[-1][0]).mean()

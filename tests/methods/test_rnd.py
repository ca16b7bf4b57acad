"""RND: values in plain numpy, a fixed target, rewards that fall where it has been."""

import copy

import numpy as np
import torch
from curiosity import fresh, mutated, plain, random_transitions, shaken, transitions_of

from curiobench.methods.rnd import RND


def expected(method: RND, next_state: torch.Tensor) -> np.ndarray:
    """Mean over features of (target - predictor)² (B,)."""
    state = next_state.double().numpy()
    return ((plain(method.target, state) - plain(method.predictor, state)) ** 2).mean(1)


def some_method(cls: type[RND] = RND, **config) -> RND:
    method = fresh(cls, features=3, **config)
    return shaken(method, method.target, method.predictor)


def test_reward_and_loss_in_numpy():
    method, batch = some_method(), random_transitions(6)
    values = expected(method, batch.next_state)
    np.testing.assert_allclose(method.reward(batch), values, rtol=1e-4)
    np.testing.assert_allclose(method.update(batch)["rnd_loss"], values.mean(), rtol=1e-4)


def test_rewarding_the_state_before_the_step_fails_the_values():
    mistaken = some_method(
        mutated(RND, "return self.error(transitions.next_state)", "return self.error(transitions.state)")
    )
    batch = random_transitions(6)
    assert not np.allclose(mistaken.reward(batch), expected(mistaken, batch.next_state), rtol=0.1)


def test_predictor_is_deeper_than_the_target_and_both_are_orthogonal():
    method = fresh(RND, sizes=(40, 4), hidden=32, features=16)
    assert len(method.predictor[::2]) == len(method.target[::2]) + 1
    for network in (method.target, method.predictor):
        for layer in network[::2]:
            weight = layer.weight.detach()
            rows = weight @ weight.T if len(weight) <= weight.shape[1] else weight.T @ weight
            torch.testing.assert_close(rows, 2 * torch.eye(len(rows)), atol=1e-5, rtol=0)


def test_training_moves_the_predictor_by_adam_and_never_the_target():
    method, batch = some_method(learning_rate=1e-4), random_transitions(6)
    target, predictor = copy.deepcopy(method.target.state_dict()), copy.deepcopy(method.predictor.state_dict())
    method.update(batch)
    assert all(torch.equal(target[name], value) for name, value in method.target.state_dict().items())
    moved = torch.cat([(v - predictor[n]).abs().flatten() for n, v in method.predictor.state_dict().items()])
    assert 0.9e-4 < moved.max() < 1.1e-4  # Adam's first step is the learning rate, whatever the gradient


def test_reward_falls_on_revisited_states_and_less_elsewhere():
    method, rng = fresh(RND, hidden=32, learning_rate=1e-3), np.random.default_rng(0)
    often, never = rng.normal(size=(32, 3)), 4 + rng.normal(size=(32, 3))
    at = {name: transitions_of(states, np.zeros((32, 2)), states) for name, states in (("o", often), ("n", never))}
    before = {name: method.reward(batch).mean() for name, batch in at.items()}
    for _ in range(300):
        method.update(at["o"])
    assert method.reward(at["o"]).mean() < 0.05 * before["o"]
    assert method.reward(at["n"]).mean() > 5 * method.reward(at["o"]).mean()


def test_reward_of_a_state_does_not_depend_on_the_batch_it_comes_in():
    """With batch normalisation it would."""

    def depends(cls: type[RND]) -> bool:
        method, batch = fresh(cls), random_transitions(6)
        alone = transitions_of(batch.state[:3], batch.action[:3], batch.next_state[:3])
        return not torch.allclose(method.reward(batch)[:3], method.reward(alone), rtol=1e-4)

    assert not depends(RND)
    with_batch_norm = (
        "(lambda x: torch.nn.functional.batch_norm(x, None, None, training=True))(self.target(next_state))"
    )
    assert depends(mutated(RND, "self.target(next_state)", with_batch_norm))

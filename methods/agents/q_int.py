"""Q_int(s, a): the value of the intrinsic reward, in the two normalisations that the paper compares (Figure 6A and B).

    PopArt  : y = r_int + gamma · Q'_int(s', a'),            a' ~ pi_c;  learned as n_PopArt(y)
    z-score : y = n_r(r_int) + gamma · Q'^n_r_int(s', a'),   the same a'; learned without PopArt

Neither depends on a goal, because novelty does not. Both are members of one network on the flat normalised state, not a
Deep Set over pairs: r_int is not a symmetric function of the blocks (one may be familiar and another not), pairs
contain the goal, and a flat network is much cheaper. Both are always trained, at little cost, and can be read by
`HybridAgent.q_int`; the agent chooses which of them is in Q_c.

Each has one critic, not the minimum of two. A minimum guards against values that are too high everywhere, and PopArt
subtracts such an offset.
"""

import copy
from typing import Any, get_args

import torch
from torch import Tensor

from curiobench.methods.agents.deepsets import DeepSets
from curiobench.methods.agents.losses import Metrics, critic_loss
from curiobench.methods.agents.pairs import PairLayout
from curiobench.methods.agents.popart import PopArt
from curiobench.methods.agents.settings import QIntNormalisation, SACConfig

MEMBERS = get_args(QIntNormalisation)
"""The two values, in the order of the network's members."""


class IntrinsicValues:
    """Both values, their target networks, and PopArt's statistics."""

    _STATEFUL = ("net", "target_net", "popart")

    def __init__(self, layout: PairLayout, config: SACConfig, popart_rate: float, generator: torch.Generator) -> None:
        """
        Args:
            layout: columns of body and blocks in a state, and the size of actions.
            config: number of hidden units, layer norm and discount.
            popart_rate: share of a batch in PopArt's statistics.
            generator: draws the weights, on its device.
        """
        self.layout, self.gamma = layout, config.gamma
        context, blocks = layout.body_size + layout.action_size, layout.n_blocks * layout.block_size
        self.net = DeepSets(len(MEMBERS), context, blocks, config.hidden, 1, config.layer_norm, generator)
        self.target_net = copy.deepcopy(self.net).requires_grad_(False)
        popart = MEMBERS.index("popart")
        layers = [(net.out_weights[popart], net.out_bias[popart]) for net in (self.net, self.target_net)]
        self.popart = PopArt(layers, popart_rate, device=generator.device)

    def __call__(self, state: Tensor, actions: Tensor, trained: int | None = None) -> Tensor:
        """Outputs (2, K, B), n_PopArt(Q_int) and Q^n_r_int, of states (B, D) and K actions in each (K, B, A).

        Gradients of the first `trained` actions' outputs reach the weights; those of the others reach the actions. By
        default all reach the weights.
        """
        return self._outputs(self.net, state, actions, trained)

    def _outputs(self, net: DeepSets, state: Tensor, actions: Tensor, trained: int | None = None) -> Tensor:
        body, blocks = state.tensor_split([self.layout.body_size], dim=1)
        contexts = torch.cat([body.expand(len(actions), -1, -1), actions], dim=2)
        return net(contexts, blocks.unsqueeze(0), trained).squeeze(-1)  # a set of one element: all blocks together

    @torch.no_grad()
    def targets(self, next_state: Tensor, next_action: Tensor, raw: Tensor, normalised: Tensor) -> Tensor:
        """y (2, B), float64, from next states (B, D), pi_c's actions there (B, A), and r_int (B,) raw and z-scored.

        Targets have no entropy: Q_c already has it from Q_ext and the policy's own loss, and here it would need a
        weight in r_int's arbitrary unit.
        """
        of_raw, of_normalised = self._outputs(self.target_net, next_state, next_action.unsqueeze(0)).squeeze(1)
        values = torch.stack([self.popart.denormalise(of_raw), of_normalised.double()])
        return torch.stack([raw, normalised]) + self.gamma * values

    @torch.no_grad()
    def adapt(self, targets: Tensor) -> Tensor:
        """Update PopArt by finite targets (2, B); returns the targets in the unit of the rescaled outputs, float32."""
        self.popart.update(targets[0])
        return torch.stack([self.popart.normalise(targets[0]), targets[1]]).float()

    def loss(self, stored: Tensor, targets: Tensor) -> tuple[Tensor, Metrics]:
        """Loss () of the outputs (2, B) of stored actions against adapted targets (2, B), and metrics.

        Metrics: q_int_loss; q_int_popart and q_int_zscore, mean outputs; popart_mean and popart_scale.
        """
        loss, _ = critic_loss(stored, targets)
        means = stored.detach().mean(1)
        metrics = {"q_int_loss": loss.detach(), "q_int_popart": means[0], "q_int_zscore": means[1]}
        return loss, metrics | {"popart_mean": self.popart.mean.clone(), "popart_scale": self.popart.scale}

    def state_dict(self) -> dict[str, Any]:
        """Weights of both networks, and PopArt's statistics."""
        return {name: getattr(self, name).state_dict() for name in self._STATEFUL}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore a `state_dict`. Raises KeyError or RuntimeError if sizes differ."""
        for name in self._STATEFUL:
            getattr(self, name).load_state_dict(state[name])

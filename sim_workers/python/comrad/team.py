"""The same team behind other interfaces: agents in turn (PettingZoo's AECEnv), and all of them as one Gymnasium Env."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from pettingzoo import AECEnv
from pettingzoo.utils import parallel_to_aec
from pettingzoo.utils.wrappers import OrderEnforcingWrapper

from .parallel import ComradParallelEnv


def in_turn(env: ComradParallelEnv) -> AECEnv:
    """PettingZoo's AECEnv of a team: agents choose one after another, and the world steps after the last."""
    return OrderEnforcingWrapper(parallel_to_aec(env))


class ComradTeamEnv(gymnasium.Env):
    """A team as one Gymnasium Env, as EPyMARL's GymMA and Level-based Foraging have it: spaces are Tuples over the N agents,
    observations tuples, actions sequences, rewards a list of N floats; terminated and truncated are the episode's.

    `env` plays. gymnasium.make("comrad/LavaPit-v1", **options) makes both, with flat_actions=True, as GymMA requires Discrete actions.
    info holds `active` and `episode_return` (lists), `score`, `ceiling`, `score_share`, `episode_length` and `length_tics`. state() and state_space are ComradParallelEnv's; n_agents is N.
    """

    def __init__(self, env: ComradParallelEnv) -> None:
        self.env = env
        self.metadata, self.render_mode = env.metadata, env.render_mode
        self.agents = list(env.possible_agents)
        self.n_agents = len(self.agents)
        self.observation_space = spaces.Tuple([env.observation_space(agent) for agent in self.agents])
        self.action_space = spaces.Tuple([env.action_space(agent) for agent in self.agents])
        self.state_space = env.state_space

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[tuple[Any, ...], dict[str, Any]]:
        """As ComradParallelEnv.reset()."""
        super().reset(seed=seed)
        seen, infos = self.env.reset(seed=seed, options=options)
        return self._rows(seen), self._info(infos)

    def step(self, action: Sequence[Any]) -> tuple[tuple[Any, ...], list[float], bool, bool, dict[str, Any]]:  # type: ignore[override]
        """`action`: one of each agent, in the agents' order. Raises ValueError for another count."""
        if len(action) != self.n_agents:
            raise ValueError(f"{len(action)} actions were given for {self.n_agents} agents")
        seen, rewards, terminated, truncated, infos = self.env.step(dict(zip(self.agents, action)))
        return self._rows(seen), list(self._rows(rewards)), any(terminated.values()), any(truncated.values()), self._info(infos)

    def state(self) -> np.ndarray:
        return self.env.state()

    def render(self) -> np.ndarray | None:  # type: ignore[override]
        return self.env.render()

    def close(self) -> None:
        self.env.close()

    def _rows(self, values: dict[str, Any]) -> tuple[Any, ...]:
        return tuple(values[agent] for agent in self.agents)

    def _info(self, infos: dict[str, dict]) -> dict[str, Any]:
        of_each = {"active", "episode_return"}
        first = infos[self.agents[0]]
        return {name: [infos[agent][name] for agent in self.agents] if name in of_each else value for name, value in first.items()}

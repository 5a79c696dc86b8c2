#!/usr/bin/env python3
"""Starts Sample Factory 2.1.1 on one ViZDoom .cfg; beside_sample_factory.py starts this with that one's Python.

    sample_factory_game.py NAME CFG ACTIONS --env=NAME [Sample Factory's flags]

ACTIONS: the number of choices of each action head, as 3,2. The reward is the .cfg's own: no shaping by wrappers, no scaling.
"""
import sys

from gymnasium.spaces import Discrete, Tuple
from sample_factory.train import run_rl
from sf_examples.vizdoom import train_vizdoom
from sf_examples.vizdoom.doom.doom_utils import DOOM_ENVS, DoomSpec


def main():
    name, cfg, actions = sys.argv[1:4]
    heads = [Discrete(int(count)) for count in actions.split(',')]
    DOOM_ENVS.append(DoomSpec(name, cfg, heads[0] if len(heads) == 1 else Tuple(heads)))
    train_vizdoom.register_vizdoom_components()
    return run_rl(train_vizdoom.parse_vizdoom_cfg(sys.argv[4:]))


if __name__ == '__main__':
    sys.exit(main())

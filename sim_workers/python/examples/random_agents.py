"""Two agents that press at random, and what they earned: python3 random_agents.py [scenario]"""

import sys

import comrad

scenario = sys.argv[1] if len(sys.argv) > 1 else "stag_hunt_arena"
env = comrad.parallel_env(scenario, observations=("measurements", "action_mask") if comrad.describe(scenario)["measurements"] else ("action_mask",))
observations, infos = env.reset(seed=1)
for agent in env.possible_agents:
    env.action_space(agent).seed(1)
decisions = 0
while env.agents and decisions < 500:
    actions = {agent: env.action_space(agent).sample(mask=observations[agent]["action_mask"]) for agent in env.agents}
    observations, rewards, terminations, truncations, infos = env.step(actions)
    decisions += 1
print(f"{scenario}: {decisions} decisions, state:")
for name, value in zip(env.state_names, env.state()):
    print(f"  {name:24} {value:10.2f}")
env.close()

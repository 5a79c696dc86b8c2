"""COMRAD's engine in Python: cooperative first-person Doom scenarios for 2 to 8 agents, and ViZDoom's own games.

    import comrad
    env = comrad.parallel_env("stag_hunt_arena", num_agents=2)      # PettingZoo
    env = comrad.gym_env("basic")                                   # Gymnasium, one player, a ViZDoom .cfg
    envs = comrad.vector_env("coop_puzzle", num_envs=64)            # batched arrays, threads
    policy = comrad.load_policy("train_dir/RUN")                    # a torch.nn.Module of a trained policy
    run = comrad.Run("train_dir/RUN")                               # settings, metrics, checkpoints

`scenarios()` names the scenarios, `describe(name)` says what one is. Errors of arguments and files are ValueError and
FileNotFoundError with words; what the machine lacks (OSMesa, an IWAD) is RuntimeError or FileNotFoundError saying what to install.
"""

import importlib.metadata
import importlib.util
import os
import pathlib
from typing import Any

# An installed package brings the scenarios along; in a build folder the engine knows the sources.
_data = pathlib.Path(__file__).parent / "data"
if _data.is_dir():
    os.environ.setdefault("COMRAD_HOME", str(_data))

try:
    from ._engine import SavedState, describe as _describe, list_scenarios as _list_scenarios
except ImportError as _failure:
    from .missing import explained

    raise explained(_failure) from None
from .episode import Episode, load_episode  # noqa: E402
from .labels import Label  # noqa: E402
from .maps import draw_map, vizdoom_cfg  # noqa: E402
from .run import Run  # noqa: E402

try:
    __version__ = importlib.metadata.version(__name__)
except importlib.metadata.PackageNotFoundError:  # in a build folder
    __version__ = "0"

__all__ = [
    "Episode",
    "Label",
    "Run",
    "SavedState",
    "describe",
    "draw_map",
    "gym_env",
    "load_episode",
    "load_policy",
    "parallel_env",
    "save_policy",
    "scenarios",
    "vector_env",
    "vizdoom_cfg",
]


def scenarios() -> list[str]:
    """Names of the scenarios, sorted; those of COMRAD_SCENARIO_PATH are among them."""
    return _list_scenarios()


def describe(scenario: str, folder: str | os.PathLike | None = None) -> dict[str, Any]:
    """What a scenario is: title, heads (their buttons; choice 0 of a head presses nothing), measurements, rewards, team sizes,
    limit_tics; of a ViZDoom .cfg also the buffers that it enables and warnings of what is not served. `scenario`: a name, the path
    of a folder with a scenario.toml, or of a .cfg, or a .cfg's name, in `folder` where one is given."""
    return _describe(vizdoom_cfg(scenario, folder))


def _need(module: str) -> None:
    if importlib.util.find_spec(module) is None:
        raise ImportError(f"comrad needs the package {module} for this; run: pip install {module}")


def parallel_env(scenario: str, **options: Any) -> "Any":
    """A PettingZoo ParallelEnv; see comrad.parallel.ComradParallelEnv for the options."""
    _need("pettingzoo")
    from .parallel import ComradParallelEnv

    return ComradParallelEnv(scenario, **options)


def gym_env(config: str, **options: Any) -> "Any":
    """A Gymnasium Env of one player; see comrad.single.ComradGymEnv for the options."""
    _need("gymnasium")
    from .single import ComradGymEnv

    return ComradGymEnv(config, **options)


def vector_env(scenario: str, **options: Any) -> "Any":
    """Many environments at once, a Gymnasium VectorEnv; see comrad.vector.ComradVectorEnv for the options."""
    _need("gymnasium")
    from .vector import ComradVectorEnv

    return ComradVectorEnv(scenario, **options)


def load_policy(path: str | os.PathLike, agent: int = 0) -> "Any":
    """A trained policy as a torch.nn.Module; see comrad.policy.load_policy."""
    _need("torch")
    from . import policy

    return policy.load_policy(path, agent)


def save_policy(policies: "Any", like: str | os.PathLike, path: str | os.PathLike) -> None:
    """A policy that was trained in Python, as a checkpoint that `comrad eval` plays; see comrad.policy.save_policy."""
    _need("torch")
    from . import policy

    policy.save_policy(policies, like, path)


def _register() -> None:
    """Gymnasium's names: gymnasium.make("comrad/basic-v0") plays that .cfg of the vizdoom package."""
    if importlib.util.find_spec("gymnasium") is None:
        return
    from gymnasium.envs.registration import register, registry

    for name in (
        "basic",
        "deadly_corridor",
        "defend_the_center",
        "defend_the_line",
        "health_gathering",
        "health_gathering_supreme",
        "my_way_home",
        "predict_position",
        "take_cover",
    ):
        if f"comrad/{name}-v0" not in registry:
            register(f"comrad/{name}-v0", entry_point="comrad.single:ComradGymEnv", kwargs={"config": name})


_register()

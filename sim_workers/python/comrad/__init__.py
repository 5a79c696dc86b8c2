"""COMRAD's engine in Python: cooperative first-person Doom scenarios for 2 to 8 agents, and ViZDoom's own games.

    import comrad
    env = comrad.parallel_env("stag_hunt_arena", num_agents=2)      # PettingZoo; comrad.env(...): agents in turn (AEC)
    env = gymnasium.make("comrad/StagHuntArena-v1")                 # the team as one Gymnasium Env; comrad.team_env(...)
    env = comrad.gym_env("basic")                                   # Gymnasium, one player, a ViZDoom .cfg
    envs = comrad.vector_env("coop_puzzle", num_envs=64)            # batched arrays, threads
    policy = comrad.load_policy("train_dir/RUN")                    # a torch.nn.Module of a trained policy
    comrad.export_encoder(module, "encoder.pt")                     # an encoder of your own, for comrad train --encoder encoder.pt
    run = comrad.Run("train_dir/RUN")                               # settings, metrics, checkpoints

`scenarios()` names the scenarios, `describe(name)` describes one. Errors of arguments and files are ValueError and
FileNotFoundError with words; what the machine lacks (a library, an IWAD) is RuntimeError or FileNotFoundError saying what to install.
"""

import functools
import importlib.metadata
import importlib.util
import os
import pathlib
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

if TYPE_CHECKING:
    from torch import nn

# An installed package brings the scenarios along; in a build folder the engine finds the sources.
_data = pathlib.Path(__file__).parent / "data"
if _data.is_dir():
    os.environ.setdefault("COMRAD_HOME", str(_data))
# The package comrad-freedoom goes before the system's IWAD.
if _freedoom := importlib.util.find_spec("comrad_freedoom"):
    os.environ.setdefault("COMRAD_IWAD", str(pathlib.Path(str(_freedoom.origin)).with_name("freedoom2.wad")))

try:
    import gymnasium  # noqa: F401
    import pettingzoo  # noqa: F401

    from ._engine import SavedState, describe as _describe, list_scenarios as _list_scenarios
except ImportError as _failure:
    from .missing import explained

    raise explained(_failure) from None
from gymnasium.envs.registration import register, registry  # noqa: E402

from .actions import FlatActions  # noqa: E402
from .episode import Episode, load_episode  # noqa: E402
from .labels import Label  # noqa: E402
from .maps import draw_map, id_of, vizdoom_cfg  # noqa: E402
from .parallel import ComradParallelEnv  # noqa: E402
from .run import Run  # noqa: E402
from .single import ComradGymEnv  # noqa: E402
from .team import ComradTeamEnv, in_turn  # noqa: E402
from .vector import ComradVectorEnv  # noqa: E402

try:
    __version__ = importlib.metadata.version(__name__)
except importlib.metadata.PackageNotFoundError:  # in a build folder
    __version__ = "0"

__all__ = [
    "ComradGymEnv",
    "ComradParallelEnv",
    "ComradTeamEnv",
    "ComradVectorEnv",
    "Episode",
    "FlatActions",
    "Label",
    "Run",
    "SavedState",
    "describe",
    "draw_map",
    "env",
    "export_encoder",
    "gym_env",
    "load_episode",
    "load_policy",
    "parallel_env",
    "save_policy",
    "scenarios",
    "team_env",
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


parallel_env = ComradParallelEnv
gym_env = ComradGymEnv
vector_env = ComradVectorEnv

Options = ParamSpec("Options")
Made = TypeVar("Made")


def _converted(convert: Callable[[ComradParallelEnv], Made], make: Callable[Options, ComradParallelEnv]) -> Callable[Options, Made]:
    """A function with the options of `make` that returns what `convert` makes of the environment."""

    @functools.wraps(make, updated=())
    def converted(*arguments: Options.args, **options: Options.kwargs) -> Made:
        return convert(make(*arguments, **options))

    converted.__doc__ = f"{convert.__doc__}\n\nThe options are ComradParallelEnv's."
    return converted


env = _converted(in_turn, ComradParallelEnv)
team_env = _converted(ComradTeamEnv, ComradParallelEnv)


def _need_torch() -> None:
    if importlib.util.find_spec("torch") is None:
        raise ImportError("comrad needs the package torch for this; run: pip install torch")


def load_policy(path: str | os.PathLike, agent: int = 0, module: "nn.Module | None" = None) -> "Any":
    """A trained policy as a comrad.policy.Policy, or in your own `module`; see comrad.policy.load_policy."""
    _need_torch()
    from . import policy

    return policy.load_policy(path, agent, module)


def save_policy(policies: "nn.Module | list[nn.Module]", like: str | os.PathLike, path: str | os.PathLike) -> None:
    """A policy that was trained in Python, as a checkpoint that `comrad eval` plays; see comrad.policy.save_policy."""
    _need_torch()
    from . import policy

    policy.save_policy(policies, like, path)


def export_encoder(module: "nn.Module", path: str | os.PathLike, measurement_count: int = 0) -> int:
    """A pixel encoder of your own as a file for `comrad train --encoder FILE.pt`; see comrad.encoder.export_encoder."""
    _need_torch()
    from . import encoder

    return encoder.export_encoder(module, path, measurement_count)


def _register() -> None:
    """Gymnasium's ids: gymnasium.make("comrad/LavaPit-v1") is a team, gymnasium.make("comrad/basic-v0") a .cfg of the vizdoom package."""
    for scenario in scenarios():
        if id_of(scenario) not in registry:
            options = {"scenario": scenario, "flat_actions": True}
            # Rewards are a list, which Gymnasium's checker would warn about in every step.
            register(id_of(scenario), entry_point="comrad:team_env", kwargs=options, disable_env_checker=True)
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

"""Which WADs are played: drawn from a seed, or files."""

import atexit
import functools
import os
import pathlib
import re
import shutil
import tempfile
from collections.abc import Mapping, Sequence

from . import _engine
from .arguments import checked_seed, checked_whole

Layout = int | str | os.PathLike | Mapping[str, int | str] | Sequence[str | os.PathLike]
DEFAULT_SEED = 42
GAME_VERSION = 0  # of all ids of ViZDoom's games


@functools.cache
def _folder() -> pathlib.Path:
    """Where this process keeps the maps that it draws."""
    folder = pathlib.Path(tempfile.mkdtemp(prefix="comrad_maps_"))
    process = os.getpid()

    def leave() -> None:
        if os.getpid() == process:  # not in a child that inherited this
            shutil.rmtree(folder, ignore_errors=True)

    atexit.register(leave)
    return folder


def id_of(scenario: str) -> str:
    """A scenario's id in registries, with the version of its rules: "comrad/LavaPit-v1" of lava_pit."""
    return f"comrad/{scenario.title().replace('_', '')}-v{_engine.describe(scenario)['version']}"


def _named_by(text: str) -> str:
    """The scenario or .cfg that an id names; other texts as they are. Raises ValueError for another version."""
    match = re.fullmatch(r"comrad/(\w+)-v(\d+)", text)
    if match is None:
        return text
    by_name = {id_of(scenario).removeprefix("comrad/").rpartition("-v")[0]: scenario for scenario in _engine.list_scenarios()}
    found = by_name.get(match[1])
    version = _engine.describe(found)["version"] if found else GAME_VERSION
    if int(match[2]) != version:
        raise ValueError(f"{text}: this package has version {version} of it: comrad/{match[1]}-v{version}")
    return found or match[1]


def vizdoom_cfg(name: str | os.PathLike, folder: str | os.PathLike | None = None) -> str:
    """The path of a ViZDoom .cfg: itself, or a file of that name, with or without .cfg, in the folders of COMRAD_VIZDOOM_PATH (parted
    by ':') or of the vizdoom package. With a `folder` it is looked for there alone. Names of COMRAD's scenarios come back as they
    are, ids ("comrad/LavaPit-v1") as the names that they mean. Raises FileNotFoundError where a .cfg is nowhere."""
    text = _named_by(os.fspath(name))
    if folder is not None:
        return _cfg_in(pathlib.Path(folder), text)
    if os.sep in text or os.path.exists(text):
        return text
    stem = text.removesuffix(".cfg")
    if stem.partition("@")[0] in _engine.list_scenarios():  # "stag_hunt_arena@reference" is one's variant
        return text
    for folder in filter(None, os.environ.get("COMRAD_VIZDOOM_PATH", "").split(os.pathsep)):
        if os.path.exists(path := os.path.join(folder, stem + ".cfg")):
            return path
    try:
        import vizdoom  # for its files alone
    except ImportError:
        if not text.endswith(".cfg"):
            return text  # the engine names the nearest scenario
        raise FileNotFoundError(f"{text}: no such file; the package vizdoom brings ViZDoom's .cfg files: pip install vizdoom") from None
    path = os.path.join(vizdoom.scenarios_path, stem + ".cfg")
    if os.path.exists(path):
        return path
    if text.endswith(".cfg"):
        raise FileNotFoundError(f"{text}: no such file, and none of that name in {vizdoom.scenarios_path}")
    return text


def _cfg_in(folder: pathlib.Path, name: str) -> str:
    """A .cfg of that name in a folder."""
    if not folder.is_dir():
        raise FileNotFoundError(f"folder {folder}: no such folder")
    path = folder / (name.removesuffix(".cfg") + ".cfg")
    if path.is_file():
        return str(path)
    there = sorted(file.stem for file in folder.glob("*.cfg"))
    raise FileNotFoundError(f"{path}: no such file; {folder} has " + (", ".join(there[:20]) if there else "no .cfg"))


def draw_map(scenario: str, seed: int = DEFAULT_SEED, num_agents: int = 0, **parameters: int | str) -> bytes:
    """A scenario's map as the bytes of a WAD, the same on every machine. `parameters`: of its recipe, as `comrad doomgen` lists
    them. `num_agents` must find a start; 0: as many as the recipe prepares. Raises ValueError for what no map can be made of."""
    agents = checked_whole("num_agents", num_agents)
    wad, file = _engine.draw_map(vizdoom_cfg(scenario), checked_seed(seed), agents, [(key, str(value)) for key, value in parameters.items()])
    return pathlib.Path(file).read_bytes() if file else wad


def wads_of(scenario: str, layout: Layout | None, num_agents: int) -> list[str]:
    """The files that `layout` means: None or a seed, a mapping of recipe parameters (with `seed` among them), a WAD, a folder
    of WADs in the order of their names, or several WADs. Of one WAD with several maps, where a .cfg has no doom_map, a file for
    each. Drawn maps lie in a folder that goes when the process ends."""
    if layout is None:
        layout = DEFAULT_SEED
    if isinstance(layout, bool):
        raise TypeError("layout is a seed, parameters of the map, a WAD, a folder of WADs, or several WADs")
    if isinstance(layout, int) or isinstance(layout, Mapping):
        wanted = dict(layout) if isinstance(layout, Mapping) else {"seed": layout}
        seed = checked_seed(wanted.pop("seed", DEFAULT_SEED), "layout seed")
        return [_drawn(scenario, seed, num_agents, tuple(sorted((key, str(value)) for key, value in wanted.items())))]
    if isinstance(layout, (str, os.PathLike)):
        path = pathlib.Path(layout)
        if path.is_dir():
            found = sorted(str(file) for file in path.iterdir() if file.suffix.lower() == ".wad")
            if not found:
                raise FileNotFoundError(f"{path}: a folder without a .wad")
            return found
        return _maps_of(_existing(path), scenario)
    if isinstance(layout, Sequence):
        if not layout:
            raise ValueError("layout: no map was named")
        return [_existing(pathlib.Path(one)) for one in layout]
    raise TypeError(f"layout is a {type(layout).__name__}; give a seed, parameters of the map, a WAD, a folder of WADs, or several WADs")


def _existing(path: pathlib.Path) -> str:
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such WAD")
    return str(path)


@functools.cache
def _maps_of(path: str, scenario: str) -> list[str]:
    """The WAD itself, or, where a .cfg leaves the choice among several maps, a WAD for each."""
    if _engine.describe(scenario).get("names_map", True):
        return [path]
    wads = _engine.split_wad(path, tempfile.mkdtemp(prefix="maps_", dir=_folder()))
    return wads if len(wads) > 1 else [path]


@functools.cache
def _drawn(scenario: str, seed: int, num_agents: int, parameters: tuple[tuple[str, str], ...]) -> str:
    wad, file = _engine.draw_map(scenario, seed, num_agents, list(parameters))
    if file:
        return file
    handle, path = tempfile.mkstemp(prefix=f"{pathlib.Path(scenario).name}_{seed}_", suffix=".wad", dir=_folder())
    with os.fdopen(handle, "wb") as out:
        out.write(wad)
    return path

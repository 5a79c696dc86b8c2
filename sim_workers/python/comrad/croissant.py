"""Croissant descriptions (mlcommons.org/croissant/1.0) of folders of maps and of recorded episodes.

    python3 -m comrad.croissant FOLDER       writes FOLDER/croissant.json, and prints what it describes

FOLDER was written by `comrad doomgen NAME --pool ... -o FOLDER` or by `comrad eval --episodes_dir FOLDER`. Every file is listed with its
SHA-256; records are the maps, or the episodes (whose first lines it gathers in FOLDER/episodes.jsonl). Repeated, it writes the same bytes.
"""

import argparse
import datetime
import hashlib
import json
import os
import pathlib
from typing import Any

from .episode import load_episode

VOCABULARY = "http://mlcommons.org/croissant/"
TERMS = (
    "citeAs column equivalentProperty extract field fileObject fileProperty fileSet format includes isLiveDataset jsonPath key md5 parentField "
    "path recordSet references regex repeated replace samplingRate separator source subField transform"
)
CONTEXT = {  # the standard's own
    "@language": "en",
    "@vocab": "https://schema.org/",
    "conformsTo": "dct:conformsTo",
    "cr": VOCABULARY,
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "rai": VOCABULARY + "RAI/",
    "sc": "https://schema.org/",
    **{term: f"cr:{term}" for term in TERMS.split()},
}
REGISTRY, EPISODES = "batch_registry.json", "episodes.jsonl"
FORMATS = {".json": "application/json", ".jsonl": "application/jsonlines", ".wad": "application/x-doom", ".comrad": "application/octet-stream"}
OF_MAPS = {  # fields of the records, with what they are
    "id": ("sc:Text", "name of the map"),
    "filename": ("sc:Text", "its WAD"),
    "scenario": ("sc:Text", "the scenario that it is played in"),
    "scenario_version": ("sc:Integer", "the scenario's when it was drawn"),
    "split": ("sc:Text", "train or eval; no map is in both"),
    "seed": ("sc:Integer", "what it was drawn from"),
    "content_hash": ("sc:Text", "of geometry, things and named numbers; decides the split"),
    "map_hash": ("sc:Text", "of the whole map"),
}
OF_EPISODES = {
    "file": ("sc:Text", "the episode's file: a line of JSON, then the choices u8 [decisions, agents, heads]"),
    "scenario": ("sc:Text", "the scenario"),
    "scenario_version": ("sc:Integer", "its version; scores of different ones do not compare"),
    "map": ("sc:Text", "the WAD that was played"),
    "episode_seed": ("sc:Integer", "with map and choices it gives the same episode again, to the bit"),
    "num_agents": ("sc:Integer", "size of the team"),
    "frame_skip": ("sc:Integer", "tics of 1/35 s that a choice is held"),
    "decisions": ("sc:Integer", "choices of each agent"),
    "length_tics": ("sc:Integer", "length of the episode"),
    "score": ("sc:Float", "the scenario's score J"),
    "state_hash": ("sc:Text", "of the world at the end"),
}


def _file(folder: pathlib.Path, path: pathlib.Path) -> dict[str, Any]:
    name = path.relative_to(folder).as_posix()
    return {
        "@type": "cr:FileObject",
        "@id": name,
        "name": name,
        "contentUrl": name,
        "contentSize": f"{path.stat().st_size} B",
        "encodingFormat": FORMATS[path.suffix],
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
    }


def _records(name: str, file: str, fields: dict[str, tuple[str, str]]) -> dict[str, Any]:
    def source(field: str) -> dict[str, Any]:
        extract = {"jsonPath": f"$[*].{field}"} if file == REGISTRY else {"column": field}
        return {"fileObject": {"@id": file}, "extract": extract}

    return {
        "@type": "cr:RecordSet",
        "@id": name,
        "name": name,
        "field": [
            {"@type": "cr:Field", "@id": f"{name}/{field}", "name": field, "description": words, "dataType": kind, "source": source(field)}
            for field, (kind, words) in fields.items()
        ],
    }


def _versions(records: list[dict[str, Any]]) -> str:
    """The scenarios of the records with their versions. Raises KeyError where one lacks them."""
    return ", ".join(sorted({f"{one['scenario']} (version {one['scenario_version']})" for one in records}))


def description_of(folder: str | os.PathLike) -> dict[str, Any]:
    """The description of a folder, as its croissant.json has it; writes episodes.jsonl beside episodes. Raises FileNotFoundError for a
    folder with neither maps nor episodes, ValueError for damaged ones."""
    home = pathlib.Path(folder)
    registry, episodes = home / REGISTRY, sorted(home.glob("*.comrad"))
    if registry.is_file():
        try:
            entries = json.loads(registry.read_text(encoding="utf-8"))
            data = [registry, *(home / str(entry["filename"]) for entry in entries)]
            scenarios = _versions(entries)
        except (ValueError, KeyError, TypeError) as error:
            raise ValueError(f"{registry}: not as comrad doomgen writes it: {error}") from None
        name, what = "maps", f"{len(entries)} maps of {scenarios}, drawn by comrad doomgen"
        records = _records(name, REGISTRY, OF_MAPS)
    elif episodes:
        loaded = [load_episode(file) for file in episodes]
        lines = [{"file": one.path.name, "scenario_version": 1, **one.about} for one in loaded]  # older files do not say it
        (home / EPISODES).write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
        data = [home / EPISODES, *episodes, *sorted({one.map for one in loaded})]
        name, what = "episodes", f"{len(loaded)} episodes of {_versions(lines)}, recorded by comrad eval"
        records = _records(name, EPISODES, OF_EPISODES)
    else:
        raise FileNotFoundError(f"{home}: neither {REGISTRY} of comrad doomgen --pool nor episodes of comrad eval --episodes_dir are there")
    missing = [file for file in data if not file.is_file()]
    if missing:
        raise FileNotFoundError(f"{missing[0]}: no such file, but {home} lists it")
    newest = max(file.stat().st_mtime for file in data if file.name != EPISODES)
    return {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": VOCABULARY + "1.0",
        "name": f"comrad-{home.resolve().name}",
        "description": f"{what}. Rules, rewards and scores: the scenario's page in COMRAD.",
        "license": "https://spdx.org/licenses/MIT",
        "citeAs": "COMRAD: A Benchmark for Embodied Cooperative Multi-Agent Reinforcement Learning",
        "datePublished": datetime.datetime.fromtimestamp(newest, datetime.timezone.utc).date().isoformat(),
        "version": "1.0.0",
        "distribution": [_file(home, file) for file in data],
        "recordSet": [records],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", help="of comrad doomgen --pool, or of comrad eval --episodes_dir")
    folder = pathlib.Path(parser.parse_args().folder)
    try:
        about = description_of(folder)
        (folder / "croissant.json").write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
    except (OSError, ValueError) as error:
        raise SystemExit(f"comrad.croissant: {error}") from None
    print(f"{folder / 'croissant.json'}: {about['description']}")


if __name__ == "__main__":
    main()

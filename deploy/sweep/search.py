#!/usr/bin/env python3
"""Chooses the settings of a sweep's trials with Optuna; one trial is one run of the sweep.

    search.py create FOLDER                                             makes the study files that are missing
    search.py ask FOLDER RUN [--trial N]                                prints {"trial": N, "settings": {NAME: TEXT}}
    search.py report FOLDER RUN --trial N --env_frames F --score J      prints {"pruned": BOOL}
    search.py tell FOLDER RUN --trial N [--score J]                     without a score: the run failed

FOLDER is the sweep's. Its sweep.json states what is searched and which study a run belongs to; the study is the file
search/<study>.log, which many of these programs may use at once, from several hosts. Every command may be given again, as after
a SIGKILL, and then gives the same answer. The exit code is 1, with one line on stderr, where the study file is missing or damaged.
"""

import argparse
import json
import pathlib
import signal
import sys
import time
import warnings

import optuna
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import TrialState


class Refused(Exception):
    """A sentence for the user."""


def study_path(folder: pathlib.Path, study: str) -> pathlib.Path:
    return folder / "search" / f"{study}.log"


def storage_of(path: pathlib.Path) -> JournalStorage:
    """Raises Refused for a file that ends within a line, to which Optuna would append. Another program may be writing it now."""
    for _ in range(20):
        if not path.exists() or not path.stat().st_size or path.read_bytes()[-1:] == b"\n":
            return JournalStorage(JournalFileBackend(str(path)))
        time.sleep(0.1)
    raise Refused(f"the study file {path} is damaged: it ends within a line; restore it, or give the sweep another name")


def create(folder: pathlib.Path, studies: list[str]) -> None:
    """A study that exists is read, so that a damaged one is found before anything starts."""
    for study in studies:
        path = study_path(folder, study)
        with naming(path):
            optuna.create_study(
                storage=storage_of(path), study_name="study", direction="maximize", load_if_exists=True
            ).get_trials(deepcopy=False)


class naming:
    """Turns whatever goes wrong with a study file into a sentence that names it."""

    def __init__(self, path: pathlib.Path):
        self.path = path

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        if isinstance(error, Exception) and not isinstance(error, Refused):
            words = f"{kind.__name__}: {error}".splitlines()[0]
            raise Refused(
                f"the study file {self.path} cannot be used ({words}); restore it, or give the sweep another name"
            ) from error


class Search:
    """The study of one run. A sampler is seeded by the run's number, because each process makes its own."""

    def __init__(self, folder: pathlib.Path, plan: dict, run: dict):
        self.search, self.run = plan["search"], run["name"]
        self.path = study_path(folder, run["study"])
        if not self.path.is_file():
            raise Refused(f"the study file {self.path} is missing; restore it, or give the sweep another name")
        seed = (self.search["seed"] * 1_000_003 + run["number"]) % 2**32
        method = self.search["method"]
        if method == "tpe":
            sampler = optuna.samplers.TPESampler(seed=seed, multivariate=True, constant_liar=True)
        else:
            sampler = optuna.samplers.RandomSampler(seed=seed)
        pruner = optuna.pruners.NopPruner()
        if method == "halving":
            pruner = optuna.pruners.SuccessiveHalvingPruner(
                min_resource=int(self.search["first_env_frames"]), reduction_factor=self.search["reduction"]
            )
        self.study = optuna.load_study(
            storage=storage_of(self.path), study_name="study", sampler=sampler, pruner=pruner
        )

    def trials(self) -> list:
        """The run's own, oldest first."""
        return [one for one in self.study.get_trials(deepcopy=False) if one.user_attrs.get("run") == self.run]

    def trial(self, number: int | None):
        """The trial of this number, or the run's newest; None where it has none. Raises Refused for a number it has not."""
        own = self.trials()
        if number is None:
            return own[-1] if own else None
        for one in own:
            if one.number == number:
                return one
        raise Refused(
            f"{self.run} is trial {number}, which {self.path} does not hold; restore that file, or give the sweep "
            "another name"
        )

    def ask(self, number: int | None) -> dict:
        """A run that failed before is tried again with the same settings, as a new trial."""
        known = self.trial(number)
        if known is not None and known.state == TrialState.FAIL:
            self.study.add_trial(
                optuna.trial.create_trial(
                    state=TrialState.RUNNING,
                    params=known.params,
                    distributions=known.distributions,
                    user_attrs={"run": self.run},
                )
            )
            known = self.trials()[-1]
        if known is not None and known.state != TrialState.RUNNING:
            settings = {one["setting"]: as_text(known.params[one["setting"]]) for one in self.search["space"]}
            return {"trial": known.number, "settings": settings}
        if known is None:
            trial = self.study.ask()
            trial.set_user_attr("run", self.run)
        else:
            trial = optuna.trial.Trial(self.study, known._trial_id)
        return {"trial": trial.number, "settings": {one["setting"]: suggest(trial, one) for one in self.search["space"]}}

    def report(self, number: int, env_frames: int, score: float) -> dict:
        known = self.trial(number)
        if known.state == TrialState.RUNNING:
            trial = optuna.trial.Trial(self.study, known._trial_id)
            if env_frames not in known.intermediate_values:
                trial.report(score, step=env_frames)
            if trial.should_prune():
                self.study.tell(number, state=TrialState.PRUNED)
        return {"pruned": self.trial(number).state == TrialState.PRUNED}

    def tell(self, number: int, score: float | None) -> dict:
        self.trial(number)
        state = TrialState.FAIL if score is None else TrialState.COMPLETE
        self.study.tell(number, score, state=state, skip_if_finished=True)
        return {}


def as_text(value) -> str:
    return value if isinstance(value, str) else repr(value)


def suggest(trial, one: dict) -> str:
    """A setting's value as text."""
    name = one["setting"]
    if one.get("choices"):
        return trial.suggest_categorical(name, one["choices"])
    low, high, step, log = one["low"], one["high"], one["step"], one["log"]
    if one["whole"]:
        return str(trial.suggest_int(name, int(low), int(high), step=int(step) or 1, log=log))
    return repr(float(trial.suggest_float(name, low, high, step=step or None, log=log)))


def main(words: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="search.py", description=__doc__, allow_abbrev=False)
    parser.add_argument("command", choices=("create", "ask", "report", "tell"))
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("run", nargs="?", default="")
    parser.add_argument("--trial", type=int)
    parser.add_argument("--env_frames", type=int)
    parser.add_argument("--score", type=float)
    arguments = parser.parse_args(words)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # a second's work; the study's lock must not stay behind
    warnings.simplefilter("ignore")
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    try:
        plan = json.loads((arguments.folder / "sweep.json").read_text(encoding="utf-8"))
        if arguments.command == "create":
            create(arguments.folder, sorted({run["study"] for run in plan["runs"]}))
            return 0
        run = next((one for one in plan["runs"] if one["name"] == arguments.run), None)
        if run is None:
            raise Refused(f"{arguments.folder} has no run {arguments.run}")
        with naming(study_path(arguments.folder, run["study"])):
            search = Search(arguments.folder, plan, run)
            if arguments.command == "ask":
                answer = search.ask(arguments.trial)
            elif arguments.command == "report":
                answer = search.report(arguments.trial, arguments.env_frames, arguments.score)
            else:
                answer = search.tell(arguments.trial, arguments.score)
    except (Refused, OSError, ValueError, KeyError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print(json.dumps(answer))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""Policies of COMRAD's checkpoints as PyTorch modules, and the way back: a module trained in Python as a checkpoint."""

import os
import pathlib
import pickle
import tomllib
import types
from typing import Any, Final

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from ._engine import encoder_layers
from .encoder import Encoder, buffers_of, linear_of, norm_of, read_module

NETWORK, ARCHITECTURE = "network", "architecture"  # sections of a checkpoint
MODULE = "module"  # what ARCHITECTURE calls an encoder that export_encoder wrote


def newest_checkpoint(run: pathlib.Path) -> pathlib.Path:
    """The newest periodic checkpoint of a run's folder. Raises FileNotFoundError."""
    found = sorted((run / "checkpoint").glob("checkpoint_*.pt"))
    if not found:
        raise FileNotFoundError(f"{run}: no checkpoint/checkpoint_*.pt in this folder")
    return found[-1]


class Normalizer(nn.Module):
    """(x - mean) / sqrt(variance + 1e-5), clipped to +-5, element by element; statistics are buffers, float64."""

    mean: Tensor
    var: Tensor

    def __init__(self, size: int) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(size, dtype=torch.float64))
        self.register_buffer("var", torch.ones(size, dtype=torch.float64))
        self.register_buffer("count", torch.zeros(1, dtype=torch.float64))

    def forward(self, x: Tensor) -> Tensor:
        whole = x.flatten(1)
        return ((whole - self.mean) / (self.var + 1e-5).sqrt()).clamp(-5.0, 5.0).float().view_as(x)


def _make_encoder(settings: dict[str, Any], architecture: dict[str, Any], shapes: dict[str, torch.Size]) -> nn.Module:
    """By a checkpoint's section "architecture"; by the settings of a checkpoint that is older than the section."""
    encoder: str = architecture.get("encoder") or settings.get("encoder") or settings.get("encoder_conv_architecture") or ""
    if encoder == MODULE:
        return _module_of(architecture)
    if encoder.endswith(".pt"):
        raise ValueError(f'the encoder is {encoder}, but the checkpoint has no section "architecture" with that module; pass module=')
    return Encoder(encoder_layers(encoder), shapes)


def _module_of(architecture: dict[str, Any]) -> torch.jit.ScriptModule:
    try:
        return read_module(architecture["encoder_module"].numpy().tobytes())
    except (KeyError, RuntimeError) as error:
        raise ValueError(f"the encoder module in the checkpoint cannot be read: {error}") from error


class Policy(nn.Module):
    """What chooses one agent's actions: encoder, recurrent core, decoder, action head, in float32. Parameters and buffers have
    the names of the checkpoint's section "network" (without "agent<i>." of networks that agents have for themselves).

        policy = comrad.load_policy("train_dir/RUN")
        logits, state = policy(frames, measurements, state)     # state None at an episode's first step
        choices = policy.greedy(logits)

    frames u8 [B, 3, 72, 128] (an environment with channels_first=True), measurements f32 [B, M] or None; logits f32 [B, A], the
    choices of all heads behind one another; with Q-learning they are Q-values of each choice. `head_sizes` [heads] is how many
    belong to each. The state is [layers, B, rnn_size] (LSTM: [2 layers, B, rnn_size], hidden states before cells); without a recurrent
    core it comes back as it is.

    policy.encoder is an Encoder, or the TorchScript module of `comrad train --encoder FILE.pt`, which gets the frames' bytes and, where
    measurements are None, [B, 0].

    torch.jit.script(policy) works, and so does torch.onnx.export(policy, (frames, measurements, state), FILE, dynamo=True); state there
    is policy.first_state(B), as None is no input of a graph. Both hold forward(). The ONNX exporter refuses TorchScript inside a module:
    put your class in the place of such an encoder first (own.load_state_dict(policy.encoder.state_dict()); policy.encoder = own).
    """

    is_lstm: Final[bool]
    has_module: Final[bool]
    id_count: Final[int]
    agent: Final[int]

    def __init__(
        self,
        settings: dict[str, Any],
        tensors: dict[str, Tensor],
        agent: int = 0,
        head_sizes: list[int] | None = None,
        architecture: dict[str, Any] | None = None,
    ) -> None:
        super().__init__()
        self.settings, self.agent, self.head_sizes = settings, agent, head_sizes
        self.is_lstm = bool(settings["use_rnn"]) and settings["rnn_type"] == "lstm"
        shapes = {name: tensor.shape for name, tensor in tensors.items()}
        self.encoder = _make_encoder(settings, architecture or {}, shapes)
        self.has_module = not isinstance(self.encoder, Encoder)
        self.normalizer = nn.ModuleDict()
        for name in ("frame", "measurement"):
            if f"normalizer.{name}.mean" in shapes:
                self.normalizer[name] = Normalizer(shapes[f"normalizer.{name}.mean"][0])
        self.core: nn.GRU | nn.LSTM | None = None
        if settings["use_rnn"]:
            kind = nn.LSTM if self.is_lstm else nn.GRU
            self.core = kind(shapes["core.weight_ih_l0"][1], settings["rnn_size"], settings["rnn_num_layers"])
        self.core_norm = norm_of(shapes, "core_norm")
        layers: list[nn.Linear] = []
        while f"decoder.{len(layers)}.weight" in shapes:
            layers.append(linear_of(shapes, f"decoder.{len(layers)}"))
        self.decoder = nn.ModuleList(layers)
        self.decoder_norm = nn.ModuleList([norm_of(shapes, f"decoder_norm.{index}") for index in range(len(layers))])
        self.action_head = linear_of(shapes, "action_head")
        if "value_head.weight" in shapes:
            self.value_head = linear_of(shapes, "value_head")
        # Agents that the network distinguishes by their index; 0: it does not.
        self.id_count = int(settings["num_agents"]) if settings.get("agent_id_input") else 0
        try:
            self.load_state_dict({**buffers_of(self.encoder), **tensors})
        except RuntimeError as error:
            raise ValueError(f"the checkpoint's tensors are not those of its encoder and settings: {error}") from error

    def first_state(self, rows: int) -> Tensor:
        """The state at an episode's first step, zeros; of a policy without a recurrent core [0, rows, 0]."""
        if self.core is None:
            return torch.zeros(0, rows, 0)
        kinds = 2 if self.is_lstm else 1
        return torch.zeros(kinds * self.core.num_layers, rows, self.core.hidden_size, device=self.action_head.weight.device)

    def features(self, frame: Tensor, measurement: Tensor | None, state: Tensor | None) -> tuple[Tensor, Tensor | None]:
        if frame.dtype != torch.uint8 or frame.dim() != 4 or frame.shape[1] != 3:
            raise ValueError(f"frames are {frame.dtype} {frame.shape}; uint8 [B, 3, height, width] are wanted")
        if self.has_module:
            x = self.encoder(frame, torch.zeros(frame.shape[0], 0, device=frame.device) if measurement is None else measurement)
        else:
            x = frame.float() / 255.0
            for name, normalizer in self.normalizer.items():
                if name == "frame":
                    x = normalizer(x)
                elif measurement is not None:
                    measurement = normalizer(measurement)
            x = self.encoder(x, measurement)
        if self.id_count > 0:
            own = torch.zeros(self.id_count, device=x.device)
            own[self.agent] = 1.0
            x = torch.cat((x, own.expand(x.shape[0], self.id_count)), 1)
        if self.core is not None:
            if state is None:
                state = self.first_state(x.shape[0])
            if self.is_lstm:
                hidden, cell = state.chunk(2)
                sequence, (hidden, cell) = self.core(x[None], (hidden.contiguous(), cell.contiguous()))
                state = torch.cat((hidden, cell))
            else:
                sequence, state = self.core(x[None], state)
            x = self.core_norm(sequence[0])
        for layer, norm in zip(self.decoder, self.decoder_norm):
            x = F.elu(norm(layer(x)))
        return x, state

    def forward(self, frame: Tensor, measurement: Tensor | None = None, state: Tensor | None = None) -> tuple[Tensor, Tensor | None]:
        x, state = self.features(frame, measurement, state)
        return self.action_head(x), state

    def value(self, frame: Tensor, measurement: Tensor | None = None, state: Tensor | None = None) -> Tensor:
        """The agent's own value estimate [B], normalised as in training (`normalizer` of the checkpoint). Raises AttributeError for
        networks without one (MAPPO's and HAPPO's critics see all agents; Q-learning has none)."""
        return self.value_head(self.features(frame, measurement, state)[0])[:, 0]

    def greedy(self, logits: Tensor, head_sizes: list[int] | None = None) -> Tensor:
        """The best choice of each head, int64 [B, heads]."""
        return torch.stack([head.argmax(1) for head in self.heads(logits, head_sizes)], 1)

    def sample(self, logits: Tensor, head_sizes: list[int] | None = None) -> Tensor:
        """A choice of each head drawn from the softmax of its logits, int64 [B, heads]."""
        return torch.stack([torch.distributions.Categorical(logits=head).sample() for head in self.heads(logits, head_sizes)], 1)

    def heads(self, logits: Tensor, head_sizes: list[int] | None = None) -> tuple[Tensor, ...]:
        sizes = head_sizes or self.head_sizes
        if not sizes:
            raise ValueError("head_sizes: pass them, as env.action_space(agent).nvec.tolist()")
        return logits.split(list(sizes), 1)


def read_checkpoint(path: str | os.PathLike) -> dict[str, Any]:
    """The sections of a checkpoint; `path` may be a run's folder: its newest one. Raises FileNotFoundError, ValueError."""
    file = pathlib.Path(path)
    if file.is_dir():
        file = newest_checkpoint(file)
    if not file.is_file():
        raise FileNotFoundError(f"{file}: no such checkpoint")
    try:
        checkpoint = torch.load(file, map_location="cpu", weights_only=True)
    except Exception as error:  # whatever a damaged file makes of the reader
        raise ValueError(f"{file}: PyTorch cannot read it as a checkpoint: {error}") from error
    if not isinstance(checkpoint, dict) or NETWORK not in checkpoint or "config" not in checkpoint:
        raise ValueError(f"{file}: not a checkpoint of COMRAD")
    return checkpoint


def load_policy(path: str | os.PathLike, agent: int = 0, module: nn.Module | None = None) -> nn.Module:
    """The policy of a checkpoint (or of a run's newest one) as a module, in eval mode. `agent`: the one to be played, counted from 0;
    HAPPO's agents, and those of share_parameters=false, have separate networks. `module`: your own in place of a Policy; its
    parameters and buffers get the checkpoint's tensors of the same names, and other tensors of the checkpoint (normalizers, the value
    head) are left out where it lacks them. Raises ValueError naming a tensor that the checkpoint lacks or has in another shape."""
    checkpoint = read_checkpoint(path)
    settings = tomllib.loads(checkpoint["config"]["toml"])
    if not 0 <= agent < int(settings["num_agents"]):
        raise ValueError(f"agent {agent}: the team has {settings['num_agents']}, counted from 0")
    tensors = _of_agent(checkpoint[NETWORK], agent)
    if module is None:
        try:
            return Policy(settings, tensors, agent, _head_sizes(settings), checkpoint.get(ARCHITECTURE)).eval()
        except ValueError as error:
            raise ValueError(f"{os.fspath(path)}: {error}") from error
    architecture = checkpoint.get(ARCHITECTURE, {})
    if architecture.get("encoder") == MODULE:
        tensors = {**buffers_of(_module_of(architecture)), **tensors}
    for name, tensor in module.state_dict().items():
        _check_tensor(tensors, name, tensor, path)
    module.load_state_dict({name: tensors[name] for name in module.state_dict()})
    return module.eval()


def _check_tensor(there: dict[str, Tensor], name: str, tensor: Tensor, path: str | os.PathLike) -> None:
    if name not in there:
        raise ValueError(f"{os.fspath(path)} has no tensor {name}; a module's names are those of comrad.load_policy(...).state_dict()")
    if there[name].shape != tensor.shape:
        raise ValueError(f"{os.fspath(path)}: tensor {name} has the shape {tuple(there[name].shape)}, the module's {tuple(tensor.shape)}")


class _Pickler(pickle._Pickler):  # type: ignore[name-defined,misc]
    """Writes what libtorch reads too: its reader does not know the opcode SETITEM, which Python writes for dicts of one entry."""

    def _batch_setitems(self, items: Any, *_: Any) -> None:
        pairs = list(items)
        if not pairs:
            return
        self.write(pickle.MARK)  # type: ignore[attr-defined]
        for key, value in pairs:
            self.save(key)  # type: ignore[attr-defined]
            self.save(value)  # type: ignore[attr-defined]
        self.write(pickle.SETITEMS)  # type: ignore[attr-defined]


_FOR_LIBTORCH = types.ModuleType("pickle_for_libtorch")
vars(_FOR_LIBTORCH).update({**vars(pickle), "Pickler": _Pickler})


def save_policy(policies: nn.Module | list[nn.Module], like: str | os.PathLike, path: str | os.PathLike) -> None:
    """Writes a checkpoint that `comrad eval --policy` plays: that of `like`, a checkpoint or run, with the modules' weights and input
    statistics in place of its statistics. One module for a network that agents share, else one for each agent, in their order; a Policy states
    itself which agent it is. A module of your own has parameters of the names and shapes that load_policy(like).state_dict() has; the
    statistics (normalizer...) and the value head may be missing and stay as in `like`. `path` lies in a run's folder
    (RUN/checkpoint/NAME.pt), whose config.toml defines what is played. Raises ValueError for a missing or unknown tensor or shape."""
    checkpoint = read_checkpoint(like)
    network = dict(checkpoint[NETWORK])
    architecture = checkpoint.get(ARCHITECTURE, {})
    buffers = buffers_of(_module_of(architecture)) if architecture.get("encoder") == MODULE else {}
    for index, policy in enumerate([policies] if isinstance(policies, nn.Module) else policies):
        agent = policy.agent if isinstance(policy, Policy) else index
        own = f"agent{agent}."
        prefix = own if any(name.startswith(own) for name in network) else ""
        tensors, wanted = policy.state_dict(), _of_agent(network, agent)
        for name in (buffers.keys() & tensors.keys()) - wanted.keys():
            if not torch.equal(tensors.pop(name).cpu(), buffers[name]):
                raise ValueError(
                    f"the buffer {name} has changed, but a checkpoint keeps an encoder module's file as it was, with its buffers; "
                    "restore the buffer, or make it a parameter and export the encoder again"
                )
        for name, tensor in tensors.items():
            _check_tensor(wanted, name, tensor, like)
            # HAPPO's agents share the statistics of their inputs.
            key = prefix + name if prefix + name in network else name
            network[key] = tensor.detach().cpu().clone().to(network[key].dtype)
        missing = [name for name in wanted if name not in tensors and not name.startswith(("normalizer.", "value_head."))]
        if missing:
            raise ValueError(f"the module of agent {agent} has no tensor {missing[0]}, which the network of {os.fspath(like)} has")
    checkpoint[NETWORK] = network
    part = pathlib.Path(f"{os.fspath(path)}.part")
    torch.save(checkpoint, part, pickle_module=_FOR_LIBTORCH, pickle_protocol=2)
    part.replace(path)


def _of_agent(network: dict[str, Tensor], agent: int) -> dict[str, Tensor]:
    """One agent's tensors by the names of a shared network, without critics and what they alone see."""
    own = f"agent{agent}."
    mine = {name.removeprefix(own): tensor for name, tensor in network.items() if name.startswith(own)}
    shared = {name: tensor for name, tensor in network.items() if not name.startswith(("agent", "critic", "normalizer.global_state"))}
    return {**shared, **mine}


def _head_sizes(settings: dict[str, Any]) -> list[int] | None:
    """Choices of each head, where the scenario is installed here; else None."""
    if settings.get("heads"):
        return None
    from . import describe

    try:
        return [1 + len(buttons) for buttons in describe(settings["scenario"])["heads"]]
    except (ValueError, FileNotFoundError):
        return None

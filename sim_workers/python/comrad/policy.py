"""Policies of COMRAD's checkpoints as PyTorch modules, and the way back: a module trained in Python as a checkpoint."""

import os
import pathlib
import pickle
import tomllib
import types
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional as F

# Output channels, kernel, stride of each convolution; no padding.
CONVOLUTIONS = {
    "convnet_simple": ((32, 8, 4), (64, 4, 2), (128, 3, 2)),
    "convnet_impala": ((16, 8, 4), (32, 4, 2)),
    "convnet_atari": ((32, 8, 4), (64, 4, 2), (64, 3, 1)),
}
RESNET, RESNET_CHANNELS, RESIDUAL_BLOCKS = "resnet_impala", (16, 32, 32), 2
VARIANCE_FLOOR, CLIP = 1e-5, 5.0
NETWORK = "network"  # the section of a checkpoint


def newest_checkpoint(run: pathlib.Path) -> pathlib.Path:
    """The newest periodic checkpoint of a run's folder. Raises FileNotFoundError."""
    found = sorted((run / "checkpoint").glob("checkpoint_*.pt"))
    if not found:
        raise FileNotFoundError(f"{run}: no checkpoint/checkpoint_*.pt in this folder")
    return found[-1]


class Normalizer(nn.Module):
    """(x / scale - mean) / sqrt(variance + 1e-5), clipped to +-5, element by element; statistics are buffers, float64."""

    mean: Tensor
    var: Tensor

    def __init__(self, size: int, scale: float) -> None:
        super().__init__()
        self.scale = scale
        self.register_buffer("mean", torch.zeros(size, dtype=torch.float64))
        self.register_buffer("var", torch.ones(size, dtype=torch.float64))
        self.register_buffer("count", torch.zeros(1, dtype=torch.float64))

    def forward(self, x: Tensor) -> Tensor:
        whole = (x.float() / self.scale).flatten(1)
        return ((whole - self.mean) / (self.var + VARIANCE_FLOOR).sqrt()).clamp(-CLIP, CLIP).float().view_as(x)


class Encoder(nn.Module):
    """Picture u8 [B, 3, 72, 128] and, where there is one, measurement f32 [B, M] to features [B, 512 (+ 128)]."""

    def __init__(self, settings: dict[str, Any], shapes: dict[str, torch.Size]) -> None:
        super().__init__()
        self.kind: str = settings["encoder_conv_architecture"]
        if self.kind != RESNET and self.kind not in CONVOLUTIONS:
            raise ValueError(f"encoder {self.kind}: {', '.join([*CONVOLUTIONS, RESNET])} are known")
        index = 1
        while f"encoder.conv{index}.weight" in shapes:
            out, channels, kernel, _ = shapes[f"encoder.conv{index}.weight"]
            stride, padding = (1, 1) if self.kind == RESNET else (CONVOLUTIONS[self.kind][index - 1][2], 0)
            self.add_module(f"conv{index}", nn.Conv2d(channels, out, kernel, stride, padding))
            index += 1
        self.conv_count = index - 1
        self.image = _linear(shapes, "encoder.image")
        self.has_measurement = "encoder.measurement1.weight" in shapes
        if self.has_measurement:
            self.measurement1 = _linear(shapes, "encoder.measurement1")
            self.measurement2 = _linear(shapes, "encoder.measurement2")

    def forward(self, x: Tensor, measurement: Tensor | None) -> Tensor:
        convolutions = [getattr(self, f"conv{index}") for index in range(1, self.conv_count + 1)]
        if self.kind == RESNET:
            for stage in range(len(RESNET_CHANNELS)):
                first, *blocks = convolutions[stage * (1 + 2 * RESIDUAL_BLOCKS) : (stage + 1) * (1 + 2 * RESIDUAL_BLOCKS)]
                x = F.max_pool2d(first(x), 3, 2, 1)
                for one, two in zip(blocks[::2], blocks[1::2]):
                    x = x + two(F.elu(one(F.elu(x))))
            x = F.elu(x)
        else:
            for convolution in convolutions:
                x = F.elu(convolution(x))
        features = F.elu(self.image(x.flatten(1)))
        if not self.has_measurement:
            return features
        if measurement is None:
            raise ValueError("this network reads measurements; pass them")
        return torch.cat((features, F.elu(self.measurement2(F.elu(self.measurement1(measurement))))), 1)


def _linear(shapes: dict[str, torch.Size], name: str) -> nn.Linear:
    outputs, inputs = shapes[name + ".weight"]
    return nn.Linear(inputs, outputs)


class Policy(nn.Module):
    """What chooses one agent's actions: encoder, recurrent core, decoder, action head, in float32. Parameters and buffers have
    the names of the checkpoint's section "network" (without "agent<i>." of networks that agents have for themselves).

        policy = comrad.load_policy("train_dir/RUN")
        logits, state = policy(frames, measurements, state)     # state None at an episode's first step
        choices = policy.greedy(logits)

    frames u8 [B, 3, 72, 128] (an environment with channels_first=True), measurements f32 [B, M] or None; logits f32 [B, A], the
    choices of all heads behind one another; with Q-learning they are Q-values of each choice. `head_sizes` [heads] says how many
    belong to each. The state is a tensor or a pair (LSTM) [layers, B, rnn_size]; None without a recurrent core.
    """

    def __init__(self, settings: dict[str, Any], tensors: dict[str, Tensor], agent: int = 0, head_sizes: list[int] | None = None) -> None:
        super().__init__()
        self.settings, self.agent, self.head_sizes = settings, agent, head_sizes
        shapes = {name: tensor.shape for name, tensor in tensors.items()}
        self.encoder = Encoder(settings, shapes)
        self.normalizer = nn.ModuleDict()
        for name, scale in (("frame", 255.0), ("measurement", 1.0)):
            if f"normalizer.{name}.mean" in shapes:
                self.normalizer[name] = Normalizer(shapes[f"normalizer.{name}.mean"][0], scale)
        self.core: nn.GRU | nn.LSTM | None = None
        if settings["use_rnn"]:
            kind = nn.LSTM if settings["rnn_type"] == "lstm" else nn.GRU
            self.core = kind(shapes["core.weight_ih_l0"][1], settings["rnn_size"], settings["rnn_num_layers"])
        layers: list[nn.Linear] = []
        while f"decoder.{len(layers)}.weight" in shapes:
            layers.append(_linear(shapes, f"decoder.{len(layers)}"))
        self.decoder = nn.ModuleList(layers)
        self.action_head = _linear(shapes, "action_head")
        if "value_head.weight" in shapes:
            self.value_head = _linear(shapes, "value_head")
        features = self.encoder.image.out_features + (self.encoder.measurement2.out_features if self.encoder.has_measurement else 0)
        first = self.core.input_size if self.core is not None else (layers[0] if layers else self.action_head).in_features
        self.id_count = first - features  # agents that the network tells apart by their number; 0: it does not
        self.load_state_dict({name: tensor for name, tensor in tensors.items()})

    def normalized(self, x: Tensor, name: str, scale: float) -> Tensor:
        return self.normalizer[name](x) if name in self.normalizer else x.float() / scale

    def features(self, frame: Tensor, measurement: Tensor | None, state: Any) -> tuple[Tensor, Any]:
        if frame.dtype != torch.uint8 or frame.dim() != 4 or frame.shape[1] != 3:
            raise ValueError(f"frames are {frame.dtype} {tuple(frame.shape)}; uint8 [B, 3, height, width] are wanted")
        if measurement is not None:
            measurement = self.normalized(measurement, "measurement", 1.0)
        x = self.encoder(self.normalized(frame, "frame", 255.0), measurement)
        if self.id_count > 0:
            number = torch.full((len(x),), self.agent, device=x.device)
            x = torch.cat((x, F.one_hot(number, self.id_count).float()), 1)
        if self.core is not None:
            x, state = self.core(x[None], state)
            x = x[0]
        for layer in self.decoder:
            x = F.elu(layer(x))
        return x, state

    def forward(self, frame: Tensor, measurement: Tensor | None = None, state: Any = None) -> tuple[Tensor, Any]:
        x, state = self.features(frame, measurement, state)
        return self.action_head(x), state

    def value(self, frame: Tensor, measurement: Tensor | None = None, state: Any = None) -> Tensor:
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


def load_policy(path: str | os.PathLike, agent: int = 0) -> Policy:
    """The policy of a checkpoint (or of a run's newest one) as a module, in eval mode. `agent`: who is to be played, counted
    from 0; HAPPO's agents, and those of share_parameters=false, have networks of their own."""
    checkpoint = read_checkpoint(path)
    settings = tomllib.loads(checkpoint["config"]["toml"])
    if not 0 <= agent < int(settings["num_agents"]):
        raise ValueError(f"agent {agent}: the team has {settings['num_agents']}, counted from 0")
    return Policy(settings, _of_agent(checkpoint[NETWORK], agent), agent, _head_sizes(settings)).eval()


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


def save_policy(policies: Policy | list[Policy], like: str | os.PathLike, path: str | os.PathLike) -> None:
    """Writes a checkpoint that `comrad eval --policy` plays: that of `like`, a checkpoint or run that the policies were loaded from,
    with their weights and input statistics in place of its own. One policy for a network that agents share, else one for each agent.
    `path` lies in a run's folder (RUN/checkpoint/NAME.pt), whose config.toml says what is played. Raises ValueError for other shapes."""
    checkpoint = read_checkpoint(like)
    network = dict(checkpoint[NETWORK])
    for policy in [policies] if isinstance(policies, Policy) else policies:
        own = f"agent{policy.agent}."
        prefix = own if any(name.startswith(own) for name in network) else ""
        for name, tensor in policy.state_dict().items():
            # HAPPO's agents share the statistics of their inputs.
            key = prefix + name if prefix + name in network else name
            if key not in network or network[key].shape != tensor.shape:
                raise ValueError(f"{like} has no tensor {key} of shape {tuple(tensor.shape)}; load the policy from it first")
            network[key] = tensor.detach().cpu().clone().to(network[key].dtype)
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
    """Choices of each head, where the engine knows the scenario here; else None."""
    if settings.get("heads"):
        return None
    from . import describe

    try:
        return [1 + len(buttons) for buttons in describe(settings["scenario"])["heads"]]
    except (ValueError, FileNotFoundError):
        return None

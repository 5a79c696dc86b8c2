"""Pixel encoders as PyTorch modules: those made of layers, and a module of your own as a file for `comrad train --encoder FILE.pt`."""

import copy
import io
import itertools
import os
import pathlib
import re
import warnings
import zipfile
from collections.abc import Iterator
from typing import Any, Final

import torch
from torch import Tensor, nn
from torch.nn import functional as F

# Activations by their names in a layer's text.
ACTIVATIONS = {"elu": nn.ELU, "relu": nn.ReLU, "tanh": nn.Tanh, "gelu": nn.GELU, "silu": nn.SiLU}
WINDOW = re.compile(r" (\d+)x\d+(?:/(\d+))?(?: pad (\d+))?")  # kernel, stride, padding
FRAME = (3, 72, 128)
FEATURES_MAX = 32768
# Operators that libtorch 1.13 lacks, and what to write instead.
TOO_NEW = {
    "scaled_dot_product_attention": "write attention as matmul and softmax (nn.MultiheadAttention calls this operator too)",
    "rms_norm": "write it as x * (x.square().mean(-1, keepdim=True) + 1e-6).rsqrt() * weight",
}


class Encoder(nn.Module):
    """Scaled frames f32 [B, 3, 72, 128] and, where the network reads them, measurements f32 [B, M] to features [B, F]. `layers`: as
    rollout_buffer/settings/encoder_layers.h writes them; sizes are those of the tensors."""

    has_measurement: Final[bool]

    def __init__(self, layers: list[str], shapes: dict[str, torch.Size]) -> None:
        super().__init__()
        for name, layer in _encoder_modules(layers, shapes):
            self.add_module(name, layer)
        self.has_measurement = "encoder.measurement1.weight" in shapes
        if self.has_measurement:
            self.measurement1 = linear_of(shapes, "encoder.measurement1")
            self.measurement2 = linear_of(shapes, "encoder.measurement2")
            self.measurement1_norm = norm_of(shapes, "encoder.measurement1_norm")
            self.measurement2_norm = norm_of(shapes, "encoder.measurement2_norm")

    def forward(self, x: Tensor, measurement: Tensor | None) -> Tensor:
        carried = x
        for name, layer in self.named_children():  # as a loop that TorchScript can unroll
            if name.startswith("residual"):
                carried = x
            elif name.startswith("sum"):
                x = carried + x
            elif not name.startswith("measurement"):
                x = layer(x)
        if not self.has_measurement:
            return x
        if measurement is None:
            raise ValueError("this network reads measurements; pass them")
        measured = F.elu(self.measurement1_norm(self.measurement1(measurement)))
        return torch.cat((x, F.elu(self.measurement2_norm(self.measurement2(measured)))), 1)


def _encoder_modules(layers: list[str], shapes: dict[str, torch.Size]) -> Iterator[tuple[str, nn.Module]]:
    """The layers in order, by the names that their tensors have in checkpoints; others have their place in the name. A residual block
    lies between "residual" and "sum", which only mark where its input is kept and added."""
    convolutions, norms, linears = itertools.count(1), itertools.count(1), itertools.count(1)

    def convolution(stride: int, padding: int) -> tuple[str, nn.Module]:
        name = f"conv{next(convolutions)}"
        outputs, inputs, *kernel = _shape(shapes, f"encoder.{name}.weight")
        return name, nn.Conv2d(inputs, outputs, (kernel[0], kernel[1]), stride, padding)

    for place, text in enumerate(layers, 1):
        kind, *words = text.split()
        window = WINDOW.search(text)
        kernel, stride, padding = (int(number or 0) for number in window.groups()) if window else (0, 0, 0)
        stride = stride or 1
        if kind == "conv":
            yield convolution(stride, padding)
        elif kind == "linear":
            index = next(linears)
            name = "image" if index == 1 else f"image{index}"
            yield name, linear_of(shapes, f"encoder.{name}")
        elif kind == "layernorm":
            name = f"norm{next(norms)}"
            yield name, nn.LayerNorm(list(_shape(shapes, f"encoder.{name}.weight")))
        elif kind == "pool":
            yield f"pool_{place}", nn.MaxPool2d(kernel, stride, padding)
        elif kind == "flatten":
            yield f"flatten_{place}", nn.Flatten()
        elif kind == "residual":
            yield f"residual_{place}", nn.Identity()
            for half in (1, 2):
                yield f"elu_{place}_{half}", nn.ELU()
                yield convolution(1, 1)
            yield f"sum_{place}", nn.Identity()
        else:
            yield f"{kind}_{place}", ACTIVATIONS[kind]()
        if kind in ("conv", "linear") and words[-1] != "none":
            yield f"activation_{place}", ACTIVATIONS.get(words[-1], nn.ELU)()


def _shape(shapes: dict[str, torch.Size], name: str) -> torch.Size:
    if name not in shapes:
        raise ValueError(f"the checkpoint has no tensor {name}, which the layers of its encoder or its settings require")
    return shapes[name]


def linear_of(shapes: dict[str, torch.Size], name: str) -> nn.Linear:
    outputs, inputs = _shape(shapes, name + ".weight")
    return nn.Linear(inputs, outputs)


def norm_of(shapes: dict[str, torch.Size], name: str) -> nn.Module:
    """The layer normalisation of that name; what passes its input unchanged where the network has none (q_layer_norm is off)."""
    return nn.LayerNorm(list(shapes[name + ".weight"])) if name + ".weight" in shapes else nn.Identity()


def read_module(file: bytes) -> torch.jit.ScriptModule:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of torch.jit itself
        return torch.jit.load(io.BytesIO(file), map_location="cpu")


def buffers_of(encoder: nn.Module) -> dict[str, Tensor]:
    """By their names in a policy. Checkpoints have an encoder module's parameters by name, its buffers only in its file."""
    names = {name for name, _ in encoder.named_buffers()}
    return {f"encoder.{name}": tensor for name, tensor in encoder.state_dict().items() if name in names}


def export_encoder(module: nn.Module, path: str | os.PathLike, measurement_count: int = 0) -> int:
    """Writes a pixel encoder of your own as TorchScript, FILE.pt for `comrad train --encoder FILE.pt`; returns F, its features.

    module(frames u8 [B, 3, 72, 128], measurements f32 [B, M]) gives features f32 [B, F], F up to 32768. Neither input is scaled or
    normalised: begin with frames.float() / 255. M is `measurement_count`: the measurements of the scenario in a run with
    use_additional_input, else 0, and then measurements are [B, 0]. All parameters are float32, take part in every call and are
    trained; buffers stay as they are. The same input gives the same features, whatever the other rows are: no dropout in eval mode,
    no statistics of a batch. The module is exported in eval mode from a copy on the CPU; what forward makes anew needs
    device=frames.device. The export checks these points on random inputs before it writes the file.

    Debian's libtorch 1.13 reads the file and lacks newer operators: do not use F.scaled_dot_product_attention, nn.MultiheadAttention,
    nn.TransformerEncoderLayer or nn.RMSNorm. Write attention as matmul and softmax, as sim_workers/python/examples/vision_transformer.py
    does. The checks find these operators, not every new one. Raises ValueError for a module that fails a check, and OSError."""
    file = os.fspath(path)
    if not file.endswith(".pt"):
        raise ValueError(f"the path is {file}; --encoder takes a file that ends in .pt: rename it")
    if not isinstance(module, nn.Module):
        raise ValueError(f"the module is a {type(module).__name__}; pass an instance of torch.nn.Module")
    if measurement_count < 0:
        raise ValueError(f"measurement_count is {measurement_count}; pass 0 or more")
    with warnings.catch_warnings(), torch.jit.optimized_execution(False), torch.inference_mode(False), torch.enable_grad():
        warnings.simplefilter("ignore")  # of torch.jit itself
        scripted = _scripted(module)
        features = _check_features(scripted, measurement_count)
        _check_gradients(scripted, measurement_count)
        part = pathlib.Path(f"{file}.part")
        try:
            part.write_bytes(_archive(scripted))
            inputs = _random_inputs(5, measurement_count)
            if not torch.equal(_features_of(read_module(part.read_bytes()), *inputs), _features_of(scripted, *inputs)):
                raise ValueError("the file read back gives other features; expected the same: __setstate__ must restore all that forward uses")
            part.replace(file)
        finally:
            part.unlink(missing_ok=True)
    return features


def _scripted(module: nn.Module) -> torch.jit.ScriptModule:
    """A copy in TorchScript, in eval mode on the CPU, whose forward takes two tensors and whose parameters are float32."""
    try:
        scripted = torch.jit.script(copy.deepcopy(module).cpu().eval())
        forward: Any = scripted.forward
        arguments = forward.schema.arguments[1:]
    except Exception as error:  # the compiler raises errors of many types
        raise ValueError(
            f"torch.jit.script cannot compile the module: {error}\nforward(frames, measurements) must be TorchScript: "
            "annotate arguments that are not tensors, and use only what TorchScript supports"
        ) from error
    if len(arguments) < 2 or any(not argument.has_default_value() for argument in arguments[2:]):
        names = ", ".join(argument.name for argument in arguments)
        raise ValueError(f"forward takes ({names}); it must take two tensors, (frames, measurements), and may ignore the second")
    parameters = dict(scripted.named_parameters())
    if not parameters:
        raise ValueError("the module has no parameters; an encoder needs at least one that training can change: register nn.Parameter or layers")
    for name, parameter in parameters.items():
        if parameter.dtype != torch.float32:
            raise ValueError(f"the parameter {name} is {parameter.dtype}; parameters must be torch.float32: call module.float() before")
    return scripted


def _archive(scripted: torch.jit.ScriptModule) -> bytes:
    """The module's file, whose code calls no operator of TOO_NEW."""
    buffer = io.BytesIO()
    torch.jit.save(scripted, buffer)
    with zipfile.ZipFile(buffer) as archive:
        code = "".join(archive.read(name).decode() for name in archive.namelist() if name.endswith(".py"))
    for name, instead in TOO_NEW.items():
        if f"torch.{name}(" in code:
            raise ValueError(f"the module calls {name}; libtorch 1.13, which reads the file, lacks it: {instead}")
    return buffer.getvalue()


def _random_inputs(rows: int, measurement_count: int) -> tuple[Tensor, Tensor]:
    rng = torch.Generator().manual_seed(rows)
    return torch.randint(0, 256, (rows, *FRAME), dtype=torch.uint8, generator=rng), torch.randn(rows, measurement_count, generator=rng)


def _features_of(scripted: torch.jit.ScriptModule, frames: Tensor, measurements: Tensor) -> Tensor:
    """Of copies of the inputs. Raises ValueError unless they are finite f32 [B, F]."""
    about = f"of frames uint8 {list(frames.shape)} and measurements float32 {list(measurements.shape)}"
    try:
        features = scripted(frames.clone(), measurements.clone())
    except Exception as error:  # the module may raise any
        raise ValueError(f"forward fails {about}: {error}\nit must return features for every number of rows") from error
    if not isinstance(features, Tensor):
        raise ValueError(f"forward {about} returns a {type(features).__name__}; it must return one tensor, the features [B, F]")
    if features.dtype != torch.float32:
        raise ValueError(f"the features {about} are {features.dtype}; they must be torch.float32: return features.float()")
    if features.dim() != 2 or features.shape[0] != frames.shape[0]:
        raise ValueError(f"the features {about} have the shape {list(features.shape)}; it must be [{frames.shape[0]}, F]: try flatten(1)")
    if not 1 <= features.shape[1] <= FEATURES_MAX:
        raise ValueError(f"a row has {features.shape[1]} features; 1 to {FEATURES_MAX} may reach the core: put a linear layer behind them")
    if not features.isfinite().all():
        raise ValueError(f"features {about} are infinite or NaN; they must be finite: look for divisions, logarithms and roots of 0")
    return features


def _check_features(scripted: torch.jit.ScriptModule, measurement_count: int) -> int:
    """The number of features. Raises ValueError where they depend on more than their own row of the input."""
    count = 0
    with torch.no_grad():
        for rows in (1, 2, 5):
            frames, measurements = _random_inputs(rows, measurement_count)
            features = _features_of(scripted, frames, measurements)
            if count not in (0, features.shape[1]):
                raise ValueError(f"a row has {count} features in a batch of 1 and {features.shape[1]} in one of {rows}; F must not depend on B")
            count = features.shape[1]
            if not torch.equal(_features_of(scripted, frames, measurements), features):
                raise ValueError("two calls with the same input give other features; they must be equal: remove random numbers and state")
            alone = torch.cat([_features_of(scripted, frames[row, None], measurements[row, None]) for row in range(rows)])
            if (alone - features).abs().max() > 1e-4 * (1 + alone.abs().max()):
                raise ValueError(
                    f"a row's features alone and in a batch of {rows} differ by {(alone - features).abs().max():.2g}; they must not depend on "
                    "the other rows: compute nothing across the first axis (BatchNorm with track_running_stats=False does)"
                )
    return count


def _check_gradients(scripted: torch.jit.ScriptModule, measurement_count: int) -> None:
    parameters = dict(scripted.named_parameters())
    features = _features_of(scripted, *_random_inputs(2, measurement_count))
    trained = [parameter for parameter in parameters.values() if parameter.requires_grad]
    gradients: dict[int, Tensor | None] = {}
    if trained and features.requires_grad:
        gradients.update(zip(map(id, trained), torch.autograd.grad(features.square().sum(), trained, allow_unused=True)))
    for name, parameter in parameters.items():
        gradient = gradients.get(id(parameter))
        if gradient is None:
            raise ValueError(
                f"no gradient reaches the parameter {name}; training changes all of them, so each must take part in forward with "
                "requires_grad=True: remove it, or make it a buffer (register_buffer) if it is meant to stay"
            )
        if not gradient.isfinite().all():
            raise ValueError(f"the gradient of the parameter {name} is infinite or NaN; it must be finite: look for roots and norms of 0")

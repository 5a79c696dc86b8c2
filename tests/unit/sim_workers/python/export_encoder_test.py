#!/usr/bin/env python3
"""Encoders of a user's own: what export_encoder writes and refuses, and policies of checkpoints with such a module or with layers.

    PYTHONPATH=build/python export_encoder_test.py [unittest arguments]
"""

import importlib.util
import io
import math
import pathlib
import subprocess
import sys
import tempfile
import unittest
import warnings

from package import comrad  # first: it ends the test where the package is not there

from policies_test import layer, write_checkpoint

import numpy as np
import torch
from torch import nn
from torch.nn import functional as F

EXAMPLE = pathlib.Path(__file__).resolve().parents[4] / "sim_workers" / "python" / "examples" / "vision_transformer.py"


def frames_of(rows, seed=1):
    return torch.randint(0, 256, (rows, 3, 72, 128), dtype=torch.uint8, generator=torch.Generator().manual_seed(seed))


class Good(nn.Module):
    """Mean colours and measurements to eight features, with a buffer."""

    def __init__(self, measurement_count: int = 0):
        super().__init__()
        self.layers = nn.Sequential(nn.Linear(3 + measurement_count, 16), nn.Dropout(0.5), nn.Linear(16, 8))
        self.register_buffer("scale", torch.tensor(255.0))
        self.register_buffer("unused", torch.zeros(2), persistent=False)

    def colours(self, frames):
        return frames.float().mean((2, 3)) / self.scale

    def forward(self, frames, measurements):
        return self.layers(torch.cat((self.colours(frames), measurements), 1))


class NotTorchScript(Good):
    def forward(self, frames, measurements):
        return self.layers(torch.from_numpy(np.asarray(self.colours(frames))))


class OneArgument(Good):
    def forward(self, frames):
        return self.layers(self.colours(frames))


class ThreeArguments(Good):
    def forward(self, frames, measurements, state):
        return self.layers(self.colours(frames)) + state


class NoParameters(nn.Module):
    def forward(self, frames, measurements):
        return frames.float().mean((2, 3))


class Pair(Good):
    def forward(self, frames, measurements):
        return self.layers(self.colours(frames)), measurements


class Doubles(Good):
    def forward(self, frames, measurements):
        return self.layers(self.colours(frames)).double()


class ThreeAxes(Good):
    def forward(self, frames, measurements):
        return self.layers(self.colours(frames))[:, None]


class OneRow(Good):
    def forward(self, frames, measurements):
        return self.layers(self.colours(frames)).sum(0, keepdim=True)


class WidthOfTheBatch(Good):
    def forward(self, frames, measurements):
        return self.layers(self.colours(frames))[:, : frames.shape[0]]


class NoFeatures(Good):
    def forward(self, frames, measurements):
        return self.layers(self.colours(frames))[:, :0]


class TooManyFeatures(Good):
    def forward(self, frames, measurements):
        return self.layers(self.colours(frames)).repeat(1, 4097)


class FailsForFiveRows(Good):
    def forward(self, frames, measurements):
        return self.layers(self.colours(frames).view(-1, 3)[:4].expand(frames.shape[0], 3))


class NotFinite(Good):
    def forward(self, frames, measurements):
        return self.layers(self.colours(frames)) / measurements.sum()


class Random(Good):
    def forward(self, frames, measurements):
        return F.dropout(self.layers(self.colours(frames)), 0.5, True)


class Counts(Good):
    def forward(self, frames, measurements):
        self.scale += 1
        return self.layers(self.colours(frames))


class OtherRows(Good):
    def forward(self, frames, measurements):
        features = self.layers(self.colours(frames))
        return features - features.mean(0)


class UnusedParameter(Good):
    def __init__(self):
        super().__init__()
        self.extra = nn.Linear(2, 2)


class Detached(Good):
    def forward(self, frames, measurements):
        return self.layers(self.colours(frames)).detach()


class InfiniteGradient(Good):
    def forward(self, frames, measurements):
        features = self.layers(self.colours(frames))
        return features + (features * 0).abs().sqrt()


class NewOperator(Good):
    def forward(self, frames, measurements):
        x = self.layers(self.colours(frames))[:, None]
        return F.scaled_dot_product_attention(x, x, x)[:, 0]


class InModule(Good):
    def __init__(self, last):
        super().__init__()
        self.last = last

    def forward(self, frames, measurements):
        return self.last(self.layers(self.colours(frames)))


class Attention(nn.Module):
    def __init__(self):
        super().__init__()
        self.attention = nn.MultiheadAttention(8, 2, batch_first=True)

    def forward(self, x):
        return self.attention(x[:, None], x[:, None], x[:, None])[0][:, 0]


class Forgets(nn.Module):
    """Its file lacks what it adds to the colours."""

    def __init__(self):
        super().__init__()
        self.weight, self.more = nn.Parameter(torch.ones(3)), 1.0

    @torch.jit.export
    def __getstate__(self):
        return self.weight, self.training

    @torch.jit.export
    def __setstate__(self, state: tuple[torch.Tensor, bool]):
        self.weight, self.training = state
        self.more = 0.0

    def __deepcopy__(self, memo):
        return Forgets()

    def forward(self, frames, measurements):
        return frames.float().mean((2, 3)) * self.weight + self.more


class InFolder(unittest.TestCase):
    def setUp(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.folder = pathlib.Path(scratch.name)
        self.file = self.folder / "encoder.pt"

    def read(self):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # of torch.jit itself
            return torch.jit.load(self.file)


class Exports(InFolder):
    def test_a_module_is_written_and_stays_as_it_was(self):
        for count in (0, 3):
            module = Good(count)
            self.assertEqual(comrad.export_encoder(module, self.file, count), 8)
            self.assertEqual([path.name for path in self.folder.iterdir()], ["encoder.pt"])
            self.assertTrue(module.training and module.layers[1].training and all(parameter.grad is None for parameter in module.parameters()))
            found = self.read()
            self.assertEqual([name for name, _ in found.named_parameters()], [name for name, _ in module.named_parameters()])
            measurements = torch.randn(4, count)
            with torch.no_grad():
                torch.testing.assert_close(found(frames_of(4), measurements), module.eval()(frames_of(4), measurements))

    def test_each_fault_is_refused_in_words_and_leaves_the_file_alone(self):
        self.file.write_bytes(b"before")
        frozen = Good()
        frozen.layers[0].bias.requires_grad_(False)
        cases = [
            (NotTorchScript(), "torch.jit.script cannot compile the module: [^$]*must be TorchScript"),
            (OneArgument(), r"forward takes \(frames\); it must take two tensors"),
            (ThreeArguments(), r"forward takes \(frames, measurements, state\); it must take two tensors"),
            (NoParameters(), "no parameters; an encoder needs at least one"),
            (Good().double(), "parameter layers.0.weight is torch.float64; parameters must be torch.float32"),
            (Pair(), "returns a tuple; it must return one tensor"),
            (Doubles(), "features of .* are torch.float64; they must be torch.float32"),
            (ThreeAxes(), r"have the shape \[1, 1, 8\]; it must be \[1, F\]"),
            (OneRow(), r"have the shape \[1, 8\]; it must be \[2, F\]"),
            (WidthOfTheBatch(), "1 features in a batch of 1 and 2 in one of 2; F must not depend on B"),
            (NoFeatures(), "a row has 0 features; 1 to 32768"),
            (TooManyFeatures(), "a row has 32776 features; 1 to 32768"),
            (FailsForFiveRows(), r"forward fails of frames uint8 \[5, 3, 72, 128\] and measurements float32 \[5, 0\]"),
            (NotFinite(), "are infinite or NaN; they must be finite"),
            (Random(), "two calls with the same input give other features; they must be equal"),
            (Counts(), "two calls with the same input give other features"),
            (OtherRows(), "alone and in a batch of 2 differ by .*; they must not depend on the other rows"),
            (UnusedParameter(), "no gradient reaches the parameter extra.weight; .* remove it"),
            (frozen, "no gradient reaches the parameter layers.0.bias"),
            (Detached(), "no gradient reaches the parameter layers.0.weight"),
            (InfiniteGradient(), "gradient of the parameter layers.0.weight is infinite or NaN; it must be finite"),
            (NewOperator(), "calls scaled_dot_product_attention; libtorch 1.13, .* write attention as matmul and softmax"),
            (InModule(Attention()), "calls scaled_dot_product_attention"),
            (InModule(nn.RMSNorm(8)), "calls rms_norm; .* write it as x"),
            (Forgets(), "file read back gives other features; expected the same"),
            (torch.zeros(2), "the module is a Tensor; pass an instance of torch.nn.Module"),
        ]
        for module, words in cases:
            with self.subTest(type(module).__name__, words=words), self.assertRaisesRegex(ValueError, words):
                comrad.export_encoder(module, self.file)
        with self.assertRaisesRegex(ValueError, "a file that ends in .pt: rename it"):
            comrad.export_encoder(Good(), self.folder / "encoder.pth")
        with self.assertRaisesRegex(ValueError, "measurement_count is -1; pass 0 or more"):
            comrad.export_encoder(Good(), self.file, -1)
        with self.assertRaisesRegex(ValueError, r"forward fails of frames uint8 \[1, 3, 72, 128\] and measurements float32 \[1, 2\]"):
            comrad.export_encoder(Good(), self.file, 2)
        self.assertEqual([(path.name, path.read_bytes()) for path in self.folder.iterdir()], [("encoder.pt", b"before")])

    def test_the_example_exports(self):
        for count in (0, 4):
            done = subprocess.run([sys.executable, "-B", str(EXAMPLE), str(self.file), str(count)], capture_output=True, text=True, timeout=280)
            self.assertEqual((done.returncode, done.stdout), (0, f"{self.file}: 256 features\n"), done.stderr[-2000:])
            self.assertEqual(self.read()(frames_of(3), torch.zeros(3, count)).shape, (3, 256))


class Checkpoints(InFolder):
    def write(self, **options):
        """A checkpoint with an exported module whose parameters differ from those in its file by 0.5; the file's module as well."""
        count = len(comrad.describe("ammo_carrier")["measurements"])
        comrad.export_encoder(Good(count), self.file, count)
        module = self.read()
        section = {"encoder": "module", "encoder_module": torch.frombuffer(bytearray(self.file.read_bytes()), dtype=torch.uint8)}
        trained = {name: parameter.detach() + 0.5 for name, parameter in module.named_parameters()}
        write_checkpoint(self.folder / "run.pt", "encoder.pt", measurements=False, architecture=section, tensors=trained, features=8, **options)
        self.file.unlink()
        return module.eval(), torch.randn(3, count)

    def test_a_module_in_a_checkpoint_is_played_with_the_trained_parameters(self):
        for options in ({"rnn": ""}, {"agent_id": True}, {"own_networks": True}):
            with self.subTest(options), torch.no_grad():
                module, measurements = self.write(**options)
                policy = comrad.load_policy(self.folder / "run.pt", agent=1)
                for parameter in module.parameters():
                    parameter += 0.5 + options.get("own_networks", False) / 100
                features = module(frames_of(3), measurements)
                torch.testing.assert_close(policy.encoder(frames_of(3), measurements), features)
                logits, state = policy(frames_of(3), measurements)
                if "rnn" in options:
                    torch.testing.assert_close(logits, policy.action_head(features))
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", DeprecationWarning)
                    torch.jit.script(policy).save(self.folder / "scripted.pt")
                    scripted = torch.jit.load(self.folder / "scripted.pt")
                torch.testing.assert_close(scripted(frames_of(3), measurements)[0], logits)

    @unittest.skipUnless(importlib.util.find_spec("onnxruntime") and importlib.util.find_spec("onnxscript"), "needs onnxruntime and onnxscript")
    def test_the_users_class_in_place_of_the_module_is_exported_to_onnx(self):
        import onnxruntime

        _, measurements = self.write()
        policy, own = comrad.load_policy(self.folder / "run.pt"), Good(measurements.shape[1]).eval()
        inputs = (frames_of(3), measurements, policy.first_state(3))
        with torch.no_grad():
            logits = policy(*inputs)[0].numpy()
        own.load_state_dict(policy.encoder.state_dict(), strict=False)  # TorchScript makes every buffer persistent
        policy.encoder = own
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the exporter
            torch.onnx.export(policy, inputs, str(self.folder / "policy.onnx"), dynamo=True, verbose=False)
        session = onnxruntime.InferenceSession(str(self.folder / "policy.onnx"), providers=["CPUExecutionProvider"])
        found = session.run(None, {place.name: tensor.numpy() for place, tensor in zip(session.get_inputs(), inputs, strict=True)})
        np.testing.assert_allclose(found[0], logits, atol=1e-4)

    def test_a_policy_with_a_module_is_saved(self):
        _, measurements = self.write()
        policy = comrad.load_policy(self.folder / "run.pt")
        with torch.no_grad():
            policy.encoder.layers._modules["2"].bias.add_(1.0)
            comrad.save_policy(policy, self.folder / "run.pt", self.folder / "back.pt")
            back = comrad.load_policy(self.folder / "back.pt")
            torch.testing.assert_close(back(frames_of(3), measurements)[0], policy(frames_of(3), measurements)[0])
            policy.encoder.scale.add_(1.0)
        with self.assertRaisesRegex(ValueError, "the buffer encoder.scale has changed, but a checkpoint keeps"):
            comrad.save_policy(policy, self.folder / "run.pt", self.folder / "back.pt")

    def test_the_users_own_policy_gets_the_modules_parameters_and_buffers(self):
        _, measurements = self.write(rnn="")
        policy = comrad.load_policy(self.folder / "run.pt")

        class Own(nn.Module):
            def __init__(self):
                super().__init__()
                self.encoder, self.action_head = Good(measurements.shape[1]), nn.Linear(8, policy.action_head.out_features)
                self.encoder.scale.zero_()

        own = comrad.load_policy(self.folder / "run.pt", module=Own())
        with torch.no_grad():
            found = own.action_head(own.encoder(frames_of(3), measurements))
            torch.testing.assert_close(found, policy(frames_of(3), measurements)[0])
            own.action_head.bias.add_(1.0)
        comrad.save_policy(own, self.folder / "run.pt", self.folder / "back.pt")
        torch.testing.assert_close(comrad.load_policy(self.folder / "back.pt")(frames_of(3), measurements)[0], found + 1)

    def test_a_damaged_module_is_refused(self):
        self.write()
        checkpoint = torch.load(self.folder / "run.pt", weights_only=True)
        for damage, words in ((lambda: checkpoint["network"].pop("encoder.layers.0.bias"), "Missing key.*encoder.layers.0.bias"),
                              (lambda: checkpoint["architecture"].update(encoder_module=torch.zeros(9, dtype=torch.uint8)), "cannot be read")):
            damage()
            torch.save(checkpoint, self.folder / "run.pt")
            with self.assertRaisesRegex(ValueError, f"(?s)run.pt: .*{words}"):
                comrad.load_policy(self.folder / "run.pt")

    def test_layers_of_every_kind_are_computed_as_they_are_written(self):
        layers = ("conv 6 8x8/4 relu, layernorm, pool 3x3/2 pad 1, conv 4 3x3 pad 1 none, residual, tanh, layernorm, "
                  "flatten, linear 40 gelu, layernorm, linear 24, linear 12 none, silu")
        torch.manual_seed(2)
        named = {
            "conv1": layer(3, 6, 8, 8), "norm1": {"weight": torch.rand(6, 17, 31), "bias": torch.rand(6, 17, 31)},
            "conv2": layer(6, 4, 3, 3), "conv3": layer(4, 4, 3, 3), "conv4": layer(4, 4, 3, 3),
            "norm2": {"weight": torch.rand(4, 9, 16), "bias": torch.rand(4, 9, 16)},
            "image": layer(4 * 9 * 16, 40), "norm3": {"weight": torch.rand(40), "bias": torch.rand(40)},
            "image2": layer(40, 24), "image3": layer(24, 12),
        }
        tensors = {f"{of}.{part}": tensor for of, parts in named.items() for part, tensor in parts.items()}
        write_checkpoint(self.folder / "run.pt", layers, tensors=tensors, features=12)
        policy = comrad.load_policy(self.folder / "run.pt")

        def conv(x, name, **options):
            return F.conv2d(x, **named[name], **options)

        def norm(x, name):
            rows = x.flatten(1)
            whole = (rows - rows.mean(1, keepdim=True)) / (rows.var(1, unbiased=False, keepdim=True) + 1e-5).sqrt()
            return whole.view_as(x) * named[name]["weight"] + named[name]["bias"]

        x = norm(F.relu(conv(frames_of(3).float() / 255, "conv1", stride=4)), "norm1")
        x = conv(F.max_pool2d(x, 3, 2, 1), "conv2", padding=1)
        x = x + conv(F.elu(conv(F.elu(x), "conv3", padding=1)), "conv4", padding=1)
        x = F.linear(norm(torch.tanh(x), "norm2").flatten(1), **named["image"])
        x = norm(x * (1 + torch.erf(x / math.sqrt(2))) / 2, "norm3")
        x = F.linear(F.elu(F.linear(x, **named["image2"])), **named["image3"])
        measurements = torch.randn(3, policy.encoder.measurement1.in_features)
        with torch.no_grad():
            found = policy.encoder(frames_of(3).float() / 255, measurements)
            torch.testing.assert_close(found[:, :12], x * torch.sigmoid(x), atol=1e-5, rtol=1e-4)
            self.assertEqual(found.shape, (3, 12 + 128))
            logits, _ = policy(frames_of(3), measurements)
            buffer = io.BytesIO()
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", DeprecationWarning)
                torch.jit.save(torch.jit.script(policy), buffer)
                buffer.seek(0)
                torch.testing.assert_close(torch.jit.load(buffer)(frames_of(3), measurements)[0], logits)


if __name__ == "__main__":
    unittest.main()

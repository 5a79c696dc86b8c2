#!/usr/bin/env python3
"""Policies of checkpoints: TorchScript, ONNX and modules of a user's own give the same logits and actions.

    PYTHONPATH=build/python policies_test.py [unittest arguments]

Checkpoints here have random weights; load_policy_test compares those of the C++ network.
"""

import os
import pathlib
import sys
import tempfile
import unittest
import warnings

from package import comrad  # first: it ends the test where the package is not there

import numpy as np
from comrad._engine import encoder_layers

try:
    import torch
    from torch import nn
    from torch.nn import functional as F
except ImportError as missing:
    print(f"[  SKIPPED ] 1 test, policies in Python: {missing}; ./comrad test installs it (deploy/requirements_test.txt)")
    sys.exit(77)

ROWS, SCENARIO, RNN = 2, "ammo_carrier", 24
CONVOLUTIONS = {
    "simple": ((3, 32, 8), (32, 64, 4), (64, 128, 3)),
    "impala": ((3, 16, 8), (16, 32, 4)),
    "resnet": ((3, 16, 3), *[(16, 16, 3)] * 4, (16, 32, 3), *[(32, 32, 3)] * 4, (32, 32, 3), *[(32, 32, 3)] * 4),
}
FLAT = {"simple": 128 * 3 * 6, "impala": 32 * 7 * 14, "resnet": 32 * 9 * 16}
IMPALA = "conv 16 8x8/4, conv 32 4x4/2, flatten, linear 512"


def layer(inputs, *outputs):
    """Weight and bias of a linear layer, or of a convolution: outputs are then channels, height, width."""
    scale = (inputs * int(np.prod(outputs[1:]))) ** 0.5
    return {"weight": torch.randn(outputs[0], inputs, *outputs[1:]) / scale, "bias": torch.randn(outputs[0]) / 10}


def encoder_tensors(name):
    """Random ones of a named encoder, by their names behind "encoder."."""
    layers = {f"conv{index}": layer(inputs, outputs, kernel, kernel) for index, (inputs, outputs, kernel) in enumerate(CONVOLUTIONS[name], 1)}
    layers["image"] = layer(FLAT[name], 512)
    return {f"{of}.{name}": tensor for of, tensors in layers.items() for name, tensor in tensors.items()}


def write_checkpoint(path, encoder="impala", rnn="gru", layers=1, measurements=True, agent_id=False, normalizes=False, decoder=(),
                     architecture=None, tensors=None, features=512, own_networks=False, old=False, norms=False):
    """A checkpoint of SCENARIO. `architecture`: the section of that name, else made of the layers of `encoder`, a named one unless
    `tensors` (of the encoder) and `features` come along. `old`: without the section, and the setting by its name of then. `norms`: with the tensors
    of q_layer_norm."""
    about = comrad.describe(SCENARIO)
    count, choices = len(about["measurements"]), sum(len(head) + 1 for head in about["heads"])
    torch.manual_seed(1)
    tensors = encoder_tensors(encoder) if tensors is None else tensors
    network = {f"encoder.{name}": tensor for name, tensor in tensors.items()}

    def linear(name, inputs, outputs):
        network.update({f"{name}.{part}": tensor for part, tensor in layer(inputs, outputs).items()})

    def norm(name, size):
        if norms:
            network.update({f"{name}.weight": torch.rand(size) + 0.5, f"{name}.bias": torch.randn(size)})

    size = features + 2 * agent_id
    if norms:
        architecture = {"encoder": ", ".join(encoder_layers(encoder)) + " none, layernorm, elu"}
        norm("encoder.norm1", 512)
    if measurements:
        linear("encoder.measurement1", count, 128), linear("encoder.measurement2", 128, 128)
        norm("encoder.measurement1_norm", 128), norm("encoder.measurement2_norm", 128)
        size += 128
    if rnn:
        kind = nn.LSTM if rnn == "lstm" else nn.GRU
        network.update({f"core.{name}": tensor for name, tensor in kind(size, RNN, layers).state_dict().items()})
        size = RNN
        norm("core_norm", size)
    for index, outputs in enumerate(decoder):
        linear(f"decoder.{index}", size, outputs), norm(f"decoder_norm.{index}", outputs)
        size = outputs
    linear("action_head", size, choices), linear("value_head", size, 1)
    if own_networks:
        network = {f"agent{agent}.{name}": tensor + agent / 100 for agent in range(2) for name, tensor in network.items()}
    if normalizes:
        for name, length in (("frame", 3 * 72 * 128), ("measurement", count)):
            network[f"normalizer.{name}.mean"] = torch.rand(length, dtype=torch.float64)
            network[f"normalizer.{name}.var"] = torch.rand(length, dtype=torch.float64) + 0.5
            network[f"normalizer.{name}.count"] = torch.ones(1, dtype=torch.float64)
    settings = {"scenario": SCENARIO, "num_agents": 2, "use_rnn": bool(rnn), "rnn_type": rnn or "gru", "rnn_size": RNN,
                "rnn_num_layers": layers, "agent_id_input": agent_id}
    settings.update({"encoder_conv_architecture": f"convnet_{encoder}"} if old else {"encoder": encoder})
    toml = "".join(f"{name} = {str(value).lower() if isinstance(value, bool) else repr(value)}\n" for name, value in settings.items())
    checkpoint = {"network": network, "config": {"toml": toml.replace("'", '"')}}
    if not old:
        checkpoint["architecture"] = architecture or {"encoder": ", ".join(encoder_layers(encoder))}
    torch.save(checkpoint, path)


VARIANTS = {
    "gru": {},
    "feed_forward": {"rnn": "", "agent_id": True, "measurements": False},
    "two_lstm_layers": {"rnn": "lstm", "layers": 2, "decoder": (32, 16), "encoder": "simple"},
    "of_before_the_section_architecture": {"old": True},
    "layer_norm": {"norms": True, "decoder": (32, 16)},
    "resnet_normalized": {"encoder": "resnet", "normalizes": True},
}


class TheUsersOwn(nn.Module):
    """The network of write_checkpoint(rnn="", measurements=False), written for this test."""

    def __init__(self, choices):
        super().__init__()
        self.encoder = nn.ModuleDict({"conv1": nn.Conv2d(3, 16, 8, 4), "conv2": nn.Conv2d(16, 32, 4, 2), "image": nn.Linear(32 * 7 * 14, 512)})
        self.action_head = nn.Linear(512, choices)

    def forward(self, frames):
        x = frames.float() / 255
        x = F.elu(self.encoder["conv2"](F.elu(self.encoder["conv1"](x))))
        return self.action_head(F.elu(self.encoder["image"](x.flatten(1))))


class Policies(unittest.TestCase):
    def setUp(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.folder = pathlib.Path(scratch.name)

    def load(self, variant, agent=1):
        write_checkpoint(self.folder / f"{variant}.pt", **VARIANTS[variant])
        return comrad.load_policy(self.folder / f"{variant}.pt", agent)

    def inputs(self, policy, steps=3):
        rng = torch.Generator().manual_seed(2)
        count = len(comrad.describe(SCENARIO)["measurements"])
        for _ in range(steps):
            measurement = torch.randn(ROWS, count, generator=rng) if policy.encoder.has_measurement else None
            yield torch.randint(0, 256, (ROWS, 3, 72, 128), dtype=torch.uint8, generator=rng), measurement

    def test_torchscript_gives_the_same_logits_and_states(self):
        for variant in VARIANTS:
            with self.subTest(variant), torch.no_grad():
                policy = self.load(variant)
                file = self.folder / "scripted.pt"
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", DeprecationWarning)  # of torch.jit itself
                    torch.jit.script(policy).save(file)
                    scripted = torch.jit.load(file)
                state = there = None
                for frame, measurement in self.inputs(policy):
                    logits, state = policy(frame, measurement, state)
                    found, there = scripted(frame, measurement, there)
                    torch.testing.assert_close(found, logits, atol=1e-5, rtol=1e-5)
                self.assertEqual(None if state is None else state.shape, None if there is None else there.shape)
                self.assertTrue(state is None or torch.equal(state, there))

    def test_encoders_are_read_from_the_section_architecture_else_from_either_setting(self):
        frame = torch.randint(0, 256, (ROWS, 3, 72, 128), dtype=torch.uint8)
        files = [self.folder / f"{index}.pt" for index in range(4)]
        write_checkpoint(files[0], measurements=False)
        write_checkpoint(files[1], measurements=False, old=True)
        tensors = encoder_tensors("impala")
        write_checkpoint(files[2], measurements=False, encoder="moved.pt", tensors=tensors, architecture={"encoder": IMPALA})
        write_checkpoint(files[3], measurements=False, encoder="simple", tensors=tensors)
        checkpoint = torch.load(files[2], weights_only=True)
        self.assertEqual(checkpoint["architecture"]["encoder"], torch.load(files[0], weights_only=True)["architecture"]["encoder"])
        with torch.no_grad():
            logits = [comrad.load_policy(file)(frame)[0] for file in files[:2]]
        torch.testing.assert_close(logits[0], logits[1], rtol=0, atol=0)
        comrad.load_policy(files[2])
        with self.assertRaisesRegex(ValueError, "3.pt: the checkpoint has no tensor encoder.conv3.weight, which the layers"):
            comrad.load_policy(files[3])
        for section, words in (({}, 'encoder is moved.pt, but the checkpoint has no section "architecture"'),
                               ({"encoder": "conv 1 9x8"}, "a window is square"),
                               ({"encoder": "module"}, "encoder module in the checkpoint cannot be read"),
                               ({"encoder": IMPALA + ", layernorm"}, "no tensor encoder.norm1.weight"),
                               ({"encoder": "conv 16 8x8/4, flatten, linear 512"}, "tensors are not those of its encoder")):
            torch.save({**checkpoint, "architecture": section}, files[3])
            with self.assertRaisesRegex(ValueError, words):
                comrad.load_policy(files[3])

    def test_an_onnx_file_chooses_the_same_actions_in_a_played_episode(self):
        try:
            import onnxruntime
            import onnxscript  # noqa: F401 (torch.onnx.export requires it)
        except ImportError as missing:
            self.skipTest(f"{missing}; ./comrad test installs it (deploy/requirements_test.txt)")
        policy = self.load("gru", agent=0)
        file = str(self.folder / "policy.onnx")
        frame, measurement = next(self.inputs(policy))
        rows = torch.export.Dim("rows", min=1, max=1024)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the exporter
            torch.onnx.export(policy, (frame, measurement, policy.first_state(ROWS)), file, dynamo=True, verbose=False,
                              input_names=["frame", "measurement", "state"], output_names=["logits", "next_state"],
                              dynamic_shapes=({0: rows}, {0: rows}, {1: rows}))
        session = onnxruntime.InferenceSession(file, providers=["CPUExecutionProvider"])
        env = comrad.parallel_env(SCENARIO, observations=("measurements",), channels_first=True)
        seen, _ = env.reset(seed=3)
        state, there = None, policy.first_state(2).numpy()
        sizes = env.action_space("agent_0").nvec.tolist()
        for _ in range(40):
            frames = np.stack([seen[agent]["screen"] for agent in env.agents])
            measured = np.stack([seen[agent]["measurements"] for agent in env.agents])
            with torch.no_grad():
                logits, state = policy(torch.from_numpy(frames), torch.from_numpy(measured), state)
            found, there = session.run(None, {"frame": frames, "measurement": measured, "state": there})
            np.testing.assert_allclose(found, logits.numpy(), atol=1e-4)
            choices = policy.greedy(torch.from_numpy(found))
            self.assertEqual(choices.tolist(), policy.greedy(logits, sizes).tolist())
            seen = env.step(dict(zip(env.agents, choices.numpy())))[0]
        env.close()

    def test_a_module_of_the_users_own_is_loaded_and_saved(self):
        like, back = self.folder / "like.pt", self.folder / "back.pt"
        write_checkpoint(like, rnn="", measurements=False)
        policy = comrad.load_policy(like)
        mine = comrad.load_policy(like, module=TheUsersOwn(policy.action_head.out_features))
        frame, _ = next(self.inputs(policy))
        with torch.no_grad():
            torch.testing.assert_close(mine(frame), policy(frame)[0], atol=1e-5, rtol=1e-5)
            mine.action_head.bias.add_(1.0)
            comrad.save_policy(mine, like, back)
            torch.testing.assert_close(comrad.load_policy(back)(frame)[0], policy(frame)[0] + 1, atol=1e-5, rtol=1e-5)
            torch.testing.assert_close(comrad.load_policy(back, module=TheUsersOwn(policy.action_head.out_features))(frame), mine(frame))
        self.assertTrue(torch.equal(comrad.load_policy(back).value_head.weight, policy.value_head.weight))

    def test_a_module_that_does_not_fit_is_refused_by_name(self):
        like = self.folder / "like.pt"
        write_checkpoint(like, rnn="", measurements=False)
        choices = comrad.load_policy(like).action_head.out_features
        short = TheUsersOwn(choices)
        del short.encoder["conv2"]
        other = TheUsersOwn(choices)
        other.extra = nn.Linear(2, 2)
        for module, words in ((TheUsersOwn(choices + 1), "tensor action_head.weight has the shape"), (other, "has no tensor extra.weight; a module's names"),
                              (short, "the module of agent 0 has no tensor encoder.conv2.weight")):
            with self.assertRaisesRegex(ValueError, words):
                comrad.save_policy(module, like, self.folder / "never.pt")
        with self.assertRaisesRegex(ValueError, "has no tensor extra.weight"):
            comrad.load_policy(like, module=other)
        self.assertFalse(os.path.exists(self.folder / "never.pt"))


if __name__ == "__main__":
    unittest.main()

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

try:
    import torch
    from torch import nn
    from torch.nn import functional as F
except ImportError as missing:
    print(f"[  SKIPPED ] 1 test, policies in Python: {missing}; ./comrad test installs it (deploy/requirements_test.txt)")
    sys.exit(77)

ROWS, SCENARIO, RNN = 2, "ammo_carrier", 24
CONVOLUTIONS = {
    "convnet_simple": ((3, 32, 8), (32, 64, 4), (64, 128, 3)),
    "convnet_impala": ((3, 16, 8), (16, 32, 4)),
    "resnet_impala": ((3, 16, 3), *[(16, 16, 3)] * 4, (16, 32, 3), *[(32, 32, 3)] * 4, (32, 32, 3), *[(32, 32, 3)] * 4),
}
FLAT = {"convnet_simple": 128 * 3 * 6, "convnet_impala": 32 * 7 * 14, "resnet_impala": 32 * 9 * 16}


def write_checkpoint(path, encoder="convnet_impala", rnn="gru", layers=1, measurements=True, agent_id=False, normalizes=False, decoder=()):
    """A checkpoint of a shared network; its scenario is SCENARIO."""
    about = comrad.describe(SCENARIO)
    count, choices = len(about["measurements"]), sum(len(head) + 1 for head in about["heads"])
    torch.manual_seed(1)
    network = {}

    def linear(name, inputs, outputs):
        network[f"{name}.weight"], network[f"{name}.bias"] = torch.randn(outputs, inputs) / inputs**0.5, torch.randn(outputs) / 10

    for index, (inputs, outputs, kernel) in enumerate(CONVOLUTIONS[encoder], 1):
        network[f"encoder.conv{index}.weight"] = torch.randn(outputs, inputs, kernel, kernel) / (inputs * kernel**2) ** 0.5
        network[f"encoder.conv{index}.bias"] = torch.randn(outputs) / 10
    linear("encoder.image", FLAT[encoder], 512)
    size = 512 + 2 * agent_id
    if measurements:
        linear("encoder.measurement1", count, 128), linear("encoder.measurement2", 128, 128)
        size += 128
    if rnn:
        kind = nn.LSTM if rnn == "lstm" else nn.GRU
        network.update({f"core.{name}": tensor for name, tensor in kind(size, RNN, layers).state_dict().items()})
        size = RNN
    for index, outputs in enumerate(decoder):
        linear(f"decoder.{index}", size, outputs)
        size = outputs
    linear("action_head", size, choices), linear("value_head", size, 1)
    if normalizes:
        for name, length in (("frame", 3 * 72 * 128), ("measurement", count)):
            network[f"normalizer.{name}.mean"] = torch.rand(length, dtype=torch.float64)
            network[f"normalizer.{name}.var"] = torch.rand(length, dtype=torch.float64) + 0.5
            network[f"normalizer.{name}.count"] = torch.ones(1, dtype=torch.float64)
    settings = {"scenario": SCENARIO, "num_agents": 2, "encoder_conv_architecture": encoder, "use_rnn": bool(rnn), "rnn_type": rnn or "gru",
                "rnn_size": RNN, "rnn_num_layers": layers}
    toml = "".join(f"{name} = {str(value).lower() if isinstance(value, bool) else repr(value)}\n" for name, value in settings.items())
    torch.save({"network": network, "config": {"toml": toml.replace("'", '"')}}, path)


VARIANTS = {
    "gru": {},
    "feed_forward": {"rnn": "", "agent_id": True, "measurements": False},
    "two_lstm_layers": {"rnn": "lstm", "layers": 2, "decoder": (32, 16), "encoder": "convnet_simple"},
    "resnet_normalized": {"encoder": "resnet_impala", "normalizes": True},
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

    def test_an_onnx_file_chooses_the_same_actions_in_a_played_episode(self):
        try:
            import onnxruntime
            import onnxscript  # noqa: F401 (torch.onnx.export wants it)
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

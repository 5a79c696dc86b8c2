"""A checkpoint's policy in plain PyTorch (2.0 or newer), for one agent: python3 load_policy.py CHECKPOINT.pt

What policy_workers/policy computes, step by step, in float32. The convolution stacks alone; resnet_impala is not here.
"""
import sys
import tomllib

import torch
from torch.nn import functional as F

STRIDES = {"convnet_simple": (4, 2, 2), "convnet_impala": (4, 2), "convnet_atari": (4, 2, 1)}


class Policy:
    def __init__(self, path, agent=0):
        checkpoint = torch.load(path, weights_only=True)
        self.settings = tomllib.loads(checkpoint["config"]["toml"])
        self.agent = agent  # counted from 0; HAPPO's agents have networks of their own, the others share one
        self.tensors = {name.removeprefix(f"agent{agent}."): tensor for name, tensor in checkpoint["network"].items()}
        if self.settings["use_rnn"]:
            core = {name.removeprefix("core."): value for name, value in self.tensors.items() if name.startswith("core.")}
            kind = torch.nn.LSTM if self.settings["rnn_type"] == "lstm" else torch.nn.GRU
            self.core = kind(core["weight_ih_l0"].shape[1], self.settings["rnn_size"], self.settings["rnn_num_layers"])
            self.core.load_state_dict(core)

    def normalized(self, x, name, scale):
        """(x / scale - mean) / sqrt(variance + 1e-5), clipped to +-5, element by element; /scale alone without statistics."""
        x = x.float() / scale
        if f"normalizer.{name}.mean" not in self.tensors:
            return x
        mean, variance = self.tensors[f"normalizer.{name}.mean"], self.tensors[f"normalizer.{name}.var"]
        return ((x.flatten(1) - mean) / (variance + 1e-5).sqrt()).clamp(-5, 5).float().view_as(x)

    def layer(self, x, name):
        return F.linear(x, self.tensors[name + ".weight"], self.tensors[name + ".bias"])

    def step(self, frame, measurement=None, state=None):
        """frame u8 [B, 3, 72, 128] RGB, measurement f32 [B, M] or None, state of the step before or None at an
        episode's first; returns logits f32 [B, A], the choices of all heads side by side, and the state."""
        x = self.normalized(frame, "frame", 255.0)
        for index, stride in enumerate(STRIDES[self.settings["encoder_conv_architecture"]], 1):
            weight, bias = (self.tensors[f"encoder.conv{index}.{part}"] for part in ("weight", "bias"))
            x = F.elu(F.conv2d(x, weight, bias, stride))  # no padding
        x = F.elu(self.layer(x.flatten(1), "encoder.image"))
        if measurement is not None:
            m = self.normalized(measurement, "measurement", 1.0)
            m = F.elu(self.layer(F.elu(self.layer(m, "encoder.measurement1")), "encoder.measurement2"))
            x = torch.cat((x, m), 1)
        if self.settings["agent_id_input"]:
            next_layer = ("core.weight_ih_l0", "decoder.0.weight", "action_head.weight")
            inputs = next(self.tensors[name].shape[1] for name in next_layer if name in self.tensors)
            x = torch.cat((x, F.one_hot(torch.full((len(x),), self.agent), inputs - x.shape[1]).float()), 1)
        if self.settings["use_rnn"]:
            x, state = self.core(x[None], state)
            x = x[0]
        layer = 0
        while f"decoder.{layer}.weight" in self.tensors:
            x, layer = F.elu(self.layer(x, f"decoder.{layer}")), layer + 1
        return self.layer(x, "action_head"), state


def greedy(logits, head_sizes):
    """The choice of every head, [B, heads]; 0 presses nothing, k its button k-1 (scenario.toml, `[[heads]]`)."""
    return torch.stack([head.argmax(1) for head in logits.split(head_sizes, 1)], 1)


if __name__ == "__main__":
    policy = Policy(sys.argv[1])
    with torch.no_grad():
        black = torch.zeros(1, 3, 72, 128, dtype=torch.uint8)
        print(policy.step(black)[0])

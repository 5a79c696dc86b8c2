"""A small vision transformer as a pixel encoder: python3 vision_transformer.py FILE.pt [MEASUREMENTS]

    comrad train --scenario lava_pit --encoder FILE.pt

Patches of 12x16 pixels become 48 tokens, as in Dosovitskiy et al. 2021 (arXiv:2010.11929), but without a class token: the head reads
the tokens' mean and the measurements. Attention is matmul and softmax, since libtorch 1.13 lacks scaled_dot_product_attention.
"""

import sys

import comrad
import torch
from torch import nn


class Block(nn.Module):
    def __init__(self, width: int, heads: int):
        super().__init__()
        self.heads = heads
        self.norm1, self.norm2 = nn.LayerNorm(width), nn.LayerNorm(width)
        self.qkv, self.join = nn.Linear(width, 3 * width), nn.Linear(width, width)
        self.mlp = nn.Sequential(nn.Linear(width, 2 * width), nn.GELU(), nn.Linear(2 * width, width))

    def forward(self, x):
        rows, tokens, width = x.shape
        q, k, v = self.qkv(self.norm1(x)).view(rows, tokens, 3, self.heads, width // self.heads).permute(2, 0, 3, 1, 4).unbind(0)
        attention = torch.softmax(q @ k.transpose(2, 3) / (width // self.heads) ** 0.5, 3)
        x = x + self.join((attention @ v).transpose(1, 2).reshape(rows, tokens, width))
        return x + self.mlp(self.norm2(x))


class VisionTransformer(nn.Module):
    def __init__(self, measurement_count: int = 0, width: int = 64, features: int = 256):
        super().__init__()
        self.patches = nn.Conv2d(3, width, (12, 16), (12, 16))
        self.place = nn.Parameter(torch.randn(48, width) * 0.02)
        self.blocks = nn.Sequential(Block(width, 4), Block(width, 4), nn.LayerNorm(width))
        self.head = nn.Linear(width + measurement_count, features)

    def forward(self, frames, measurements):
        tokens = self.patches(frames.float() / 255).flatten(2).transpose(1, 2)  # [B, 48, width]
        seen = self.blocks(tokens + self.place).mean(1)
        measured = measurements.sign() * measurements.abs().log1p()  # they come as they are: health is 100
        return nn.functional.elu(self.head(torch.cat((seen, measured), 1)))


if __name__ == "__main__":
    file, count = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 0
    print(f"{file}: {comrad.export_encoder(VisionTransformer(count), file, count)} features")

// What our sources include in place of torch/torch.h: tensors, operators, factories, autograd functions and
// generators, without modules, data loaders and optimizers. This is what is precompiled: a source then costs
// 2 s before its own first line, where torch/torch.h costs 15 s, and 5 s even when precompiled. Never include
// it from a header.
#pragma once

#include <ATen/CPUGeneratorImpl.h>
#include <ATen/Parallel.h>
#include <torch/csrc/autograd/custom_function.h>
#include <torch/types.h>
#include <torch/utils.h>

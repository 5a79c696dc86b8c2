#include "policy_workers/policy/precision.h"

#include "policy_workers/policy/torch_ops.h"

namespace comrad::policy {

bool multiplies_bf16(torch::Device device) {
  if (!device.is_cpu()) return true;
#if defined(__x86_64__) && defined(__GNUC__)
  static const bool has_instructions = __builtin_cpu_supports("avx512bf16") > 0;  // every CPU with AMX has it
  return has_instructions;
#else
  return false;
#endif
}

Tensor factor(const Tensor& x, Precision precision) {
  if (precision == Precision::kFp32) return x;
  const Tensor rounded = x.to(torch::kBFloat16);
  return multiplies_bf16(x.device()) ? rounded : rounded.to(torch::kFloat32);
}

Tensor to_f32(const Tensor& product) { return product.to(torch::kFloat32); }

Tensor linear(const Tensor& x, const Tensor& weight, const Tensor& bias, Precision precision) {
  if (precision == Precision::kFp32) return at::linear(x, weight, bias);
  return to_f32(at::linear(factor(x, precision), factor(weight, precision))) + bias;
}

}  // namespace comrad::policy

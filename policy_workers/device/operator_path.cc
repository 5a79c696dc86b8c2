#include "policy_workers/device/operator_path.h"

#include <atomic>

namespace comrad::device {
namespace {

std::atomic<int> paths_open = 0;

}  // namespace

OperatorPath::OperatorPath() { ++paths_open; }
OperatorPath::~OperatorPath() { --paths_open; }

bool has_own_kernels(torch::Device device) { return device.is_cpu() && paths_open == 0; }

}  // namespace comrad::device

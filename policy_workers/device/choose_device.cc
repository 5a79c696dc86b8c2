#include "policy_workers/device/choose_device.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <charconv>
#include <string_view>

#include "policy_workers/device/torch_ops.h"

namespace comrad::policy {

Expected<torch::Device> choose_device(const std::string& setting) {
  if (setting == "cpu") return torch::Device(torch::kCPU);
  const bool has_cuda = at::hasCUDA();
  if (setting == "auto") return torch::Device(has_cuda ? torch::kCUDA : torch::kCPU);
  int64_t index = 0;
  if (setting != "cuda") {
    constexpr std::string_view kPrefix = "cuda:";
    const char* first = setting.data() + std::min(kPrefix.size(), setting.size());
    const char* last = setting.data() + setting.size();
    const auto parsed = std::from_chars(first, last, index);
    if (!setting.starts_with(kPrefix) || parsed.ec != std::errc() || parsed.ptr != last || index < 0 ||
        index > 127)
      return Error{ErrorCode::kBadInput,
                   "device is '" + setting + "'; it may be auto, cpu, cuda or cuda:<n>"};
  }
  const int64_t count = has_cuda ? static_cast<int64_t>(at::getNumGPUs()) : 0;
  if (index >= count)
    return Error{ErrorCode::kUnsupported,
                 fmt::format("device is '{}', but there are {} CUDA devices here (or this libtorch was built "
                             "without CUDA); use --device cpu",
                             setting, count)};
  return torch::Device(torch::kCUDA, static_cast<torch::DeviceIndex>(index));
}

}  // namespace comrad::policy

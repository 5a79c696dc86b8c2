#include "deploy/tools/libtorch_check.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <charconv>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <type_traits>

#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

/// The number that a version begins with; -1 where it begins with none.
int major_of(std::string_view version) {
  int number = -1;
  std::from_chars(version.data(), version.data() + version.size(), number);
  return number;
}

std::string text_of(const LibtorchSeen::Device& device) {
  char memory[48];
  std::snprintf(memory, sizeof(memory), "%.0f GB", static_cast<double>(device.memory_bytes) / 1e9);
  return device.name + " (" + memory + ", compute " + device.capability + ")";
}

}  // namespace

Expected<LibtorchSeen> parse_libtorch(std::string_view described) {
  const Error error{
      ErrorCode::kBadFormat,
      "comrad-policy-worker --describe --libtorch: no object with libtorch; rebuild with ./comrad"};
  const auto whole = nlohmann::json::parse(described, nullptr, /*allow_exceptions=*/false);
  if (!whole.is_object() || !whole.contains("libtorch") || !whole["libtorch"].is_object()) return error;
  const nlohmann::json& found = whole["libtorch"];
  bool is_whole = true;
  const auto take = [&is_whole](const nlohmann::json& from, const char* key, auto& into) {
    const auto at = from.find(key);
    using Value = std::remove_reference_t<decltype(into)>;
    if constexpr (std::is_same_v<Value, std::string>)
      is_whole &= at != from.end() && at->is_string();
    else if constexpr (std::is_same_v<Value, bool>)
      is_whole &= at != from.end() && at->is_boolean();
    else
      is_whole &= at != from.end() && at->is_number_integer();
    if (is_whole) into = at->template get<Value>();
  };
  LibtorchSeen seen;
  take(found, "version", seen.version);
  take(found, "library", seen.library);
  take(found, "cuda", seen.cuda);
  take(found, "cudnn", seen.cudnn);
  take(found, "has_nccl", seen.has_nccl);
  take(found, "error", seen.error);
  if (!is_whole || !found.contains("devices") || !found["devices"].is_array()) return error;
  for (const nlohmann::json& one : found["devices"]) {
    if (!one.is_object()) return error;
    LibtorchSeen::Device device;
    take(one, "name", device.name);
    take(one, "capability", device.capability);
    take(one, "memory_bytes", device.memory_bytes);
    if (!is_whole) return error;
    seen.devices.push_back(std::move(device));
  }
  return seen;
}

std::string driver_version_in(std::string_view text) {
  // NVRM version: NVIDIA UNIX Open Kernel Module for x86_64  580.65.06  Release Build  (root@host)
  text = text.substr(0, text.find('\n'));
  while (!text.empty()) {
    const std::string_view word = text.substr(0, text.find(' '));
    text.remove_prefix(std::min(text.size(), word.size() + 1));
    if (word.find('.') != std::string_view::npos &&
        word.find_first_not_of("0123456789.") == std::string_view::npos && major_of(word) > 0)
      return std::string(word);
  }
  return "";
}

int oldest_driver_for(std::string_view cuda) {
  switch (major_of(cuda)) {
    case 13:
      return 580;
    case 12:
      return 525;
    case 11:
      return 450;
    default:
      return 0;
  }
}

CheckResult judge_libtorch(const LibtorchSeen& seen) {
  std::string found = seen.version;
  if (seen.cuda.empty()) {
    found += " for the CPU";
  } else {
    found += " with CUDA " + seen.cuda;
    if (seen.cudnn >= 10000)
      found += fmt::format(", cuDNN {}.{}", seen.cudnn / 10000, seen.cudnn / 100 % 100);
    found += seen.has_nccl ? ", NCCL" : "";
  }
  return {"libtorch", CheckLevel::kOk, found + ": " + seen.library, ""};
}

CheckResult judge_cuda(const LibtorchSeen& seen, const std::string& driver, const char* visible_devices) {
  const auto answer = [](CheckLevel level, std::string found, std::string action = "") {
    return CheckResult{"cuda", level, std::move(found), std::move(action)};
  };
  const std::string on_cpu = "; networks run on the CPU";
  if (!seen.devices.empty()) {
    std::vector<std::string> devices;
    for (const LibtorchSeen::Device& device : seen.devices) devices.push_back(text_of(device));
    return answer(CheckLevel::kOk, (driver.empty() ? "" : "driver " + driver + ", ") + joined(devices) +
                                       "; --device auto and cuda use the first");
  }
  if (driver.empty())
    return answer(CheckLevel::kOk, (seen.cuda.empty() ? "no NVIDIA driver"
                                                      : "libtorch has CUDA, but there is no NVIDIA driver") +
                                       on_cpu);
  if (seen.cuda.empty())
    return answer(
        CheckLevel::kWarn, "driver " + driver + ", but this libtorch has no CUDA" + on_cpu,
        "COMRAD_TORCH=pip ./comrad doctor gets a PyTorch with CUDA and builds with it; COMRAD_TORCH=FOLDER "
        "names one that is there");
  if (const int oldest = oldest_driver_for(seen.cuda); major_of(driver) < oldest)
    return answer(CheckLevel::kWarn,
                  "driver " + driver + " is too old for the CUDA " + seen.cuda + " of this libtorch" + on_cpu,
                  fmt::format("update the driver to {} or newer, or name a PyTorch for an older CUDA: "
                              "COMRAD_TORCH=FOLDER ./comrad doctor",
                              oldest));
  const std::string why = seen.error.empty() ? "" : " (CUDA reports: " + seen.error + ")";
  if (visible_devices != nullptr)
    return answer(CheckLevel::kWarn, "driver " + driver + ", but no GPU is seen" + why + on_cpu,
                  "CUDA_VISIBLE_DEVICES is '" + std::string(visible_devices) +
                      "': name a GPU that is there, or unset it");
  return answer(CheckLevel::kWarn, "driver " + driver + ", but no GPU is seen" + why + on_cpu,
                "run nvidia-smi; a container needs --gpus all, a service deploy/systemd/gpu.conf, a Slurm "
                "job --gres=gpu:1");
}

}  // namespace comrad::deploy

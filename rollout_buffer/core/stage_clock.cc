#include "rollout_buffer/core/stage_clock.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>

namespace comrad {
namespace {

// Set once, before the threads that count.
StageCounters* shared_counters = nullptr;

Error failed(const std::string& what, const std::string& path) {
  return Error{ErrorCode::kSystem, what + " " + path + ": " + std::strerror(errno)};
}

}  // namespace

const char* name_of(Stage stage) {
  constexpr std::array<const char*, kStageCount> kNames = {
      "tic",     "render",  "hand_over", "gather",           "weights",   "pack",
      "forward", "scatter", "collate",   "forward_backward", "optimizer", "publish"};
  return kNames[static_cast<std::size_t>(stage)];
}

StageCounters* stage_counters() { return shared_counters; }

Status share_stages(const std::string& folder, const std::string& name) {
  std::error_code ignored;
  if (!std::filesystem::is_directory(folder, ignored)) return {};
  const std::string path = folder + "/" + name;
  const int file = open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
  if (file < 0) return failed("cannot open", path);
  // A successor of a worker that died counts on where it stopped.
  if (ftruncate(file, sizeof(StageCounters)) != 0) {
    close(file);
    return failed("cannot size", path);
  }
  void* memory = mmap(nullptr, sizeof(StageCounters), PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
  close(file);
  if (memory == MAP_FAILED) return failed("cannot map", path);
  shared_counters = static_cast<StageCounters*>(memory);  // zeros are counters
  shared_counters->pid.store(static_cast<uint64_t>(getpid()));
  return {};
}

std::vector<StageTotals> read_stages(const std::string& folder) {
  std::vector<StageTotals> all;
  std::error_code ignored;
  for (const auto& entry : std::filesystem::directory_iterator(folder, ignored)) {
    std::array<uint64_t, sizeof(StageCounters) / sizeof(uint64_t)> words{};
    std::ifstream file(entry.path(), std::ios::binary);
    if (!file.read(reinterpret_cast<char*>(words.data()), sizeof words)) continue;
    StageTotals totals{.pid = words.front(), .name = entry.path().filename()};
    std::copy_n(words.begin() + 1, kStageCount, totals.cpu_ns.begin());
    std::copy_n(words.begin() + 1 + kStageCount, kStageCount, totals.wall_ns.begin());
    totals.copied_bytes = words.back();
    all.push_back(std::move(totals));
  }
  std::ranges::sort(all, {}, &StageTotals::name);
  return all;
}

ProcessStage::ProcessStage(Stage stage, std::initializer_list<Stage> others)
    : stage_(stage), others_(others), began_s_(own_s()) {}

ProcessStage::~ProcessStage() {
  if (shared_counters == nullptr) return;
  shared_counters->cpu_ns[static_cast<std::size_t>(stage_)].fetch_add(
      static_cast<uint64_t>(std::max(0.0, own_s() - began_s_) * 1e9), std::memory_order_relaxed);
}

double ProcessStage::own_s() const {
  if (shared_counters == nullptr) return 0;
  double others_s = 0;
  for (const Stage other : others_)
    others_s += 1e-9 * static_cast<double>(shared_counters->cpu_ns[static_cast<std::size_t>(other)].load(
                           std::memory_order_relaxed));
  return process_cpu_s() - others_s;
}

}  // namespace comrad

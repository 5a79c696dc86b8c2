// comrad-bench-replay (`comrad bench replay`): how fast a replay hands out pictures. Fills a store with
// picture-like slabs, draws sequences and single transitions and copies them into a batch as the learner
// does: from memory, from memory with LZ4 and, where a file is named, from a mapped file that starts cold,
// beside a plain sequential read of the same file.
#include <fcntl.h>
#include <unistd.h>

#include <spdlog/fmt/fmt.h>
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "rollout_buffer/core/bench_windows.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/process.h"
#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/replay/replay.h"
#include "rollout_buffer/shm/segment.h"

namespace comrad::replay {
namespace {

using nlohmann::ordered_json;

constexpr double kTicsPerDecision = 4;
constexpr int kSlabCount = 8;  // different trajectories that the fill repeats

struct Arguments {
  double replay_gb = 1;
  std::string replay_file;
  std::vector<std::string> modes;
  std::string pictures;
  double seconds = 3;
  int32_t num_agents = 2;
  int32_t rollout = 32;
  int32_t batch = 16;
  bool json = false;
};

TrajectoryShape bench_shape(const Arguments& arguments) {
  TrajectoryShape shape;
  shape.env.num_agents = arguments.num_agents;
  shape.env.head_count = 5;
  shape.env.head_sizes = {3, 3, 3, 2, 3};
  shape.rollout_steps = arguments.rollout;
  return shape;
}

/// A view down a hall that turns with `angle`: flat ceiling and floor that darken with distance, brick walls
/// with the grain of a texture, a status bar that stays. Planes R, G, B.
void draw_picture(const EnvShape& env, int angle, uint64_t wall_seed, std::span<uint8_t> frame) {
  const int width = env.width, height = env.height, bar = height / 6, view = height - bar;
  for (int x = 0; x < width; ++x) {
    const int column = x + angle, wall = column / 24;
    const RngKey key = RngKey(wall_seed).split(static_cast<uint64_t>(wall));
    const int near_edge = 8 + static_cast<int>(key.bits() % 20),
              slope = static_cast<int>(key.bits() >> 8 & 3);
    const int half = std::clamp(near_edge + slope * (column % 24) / 8, 4, view / 2 - 2);
    for (int y = 0; y < height; ++y) {
      int red = 0, green = 0, blue = 0;
      if (y >= view) {  // status bar: a few large marks
        const bool mark = (x / 9 + y / 5) % 4 == 0;
        red = green = blue = mark ? 200 : 70;
      } else if (std::abs(y - view / 2) <= half) {
        const int texel_x = column % 24 * 64 / 24, texel_y = (y - view / 2 + half) * 64 / (2 * half + 1);
        const bool mortar = texel_y % 16 == 0 || (texel_x + texel_y / 16 * 16) % 32 == 0;
        const int grain = static_cast<int>(mix64(static_cast<uint64_t>(texel_x / 2 * 64 + texel_y / 2)) & 31);
        const int light = 3 + half / 4;
        red = std::min(255, (mortar ? 40 : 110 + grain) * light / 8);
        green = red * 3 / 4;
        blue = red / 2;
      } else {
        const int shade = std::abs(y - view / 2) * 3 / 8 * 8;
        const int grain = static_cast<int>(mix64(static_cast<uint64_t>((column / 2 * 128 + y / 2))) & 7);
        red = y < view / 2 ? shade / 2 + grain : shade + grain;
        green = shade * 3 / 4 + grain;
        blue = y < view / 2 ? shade + grain : shade / 3 + grain;
      }
      const auto at = static_cast<std::size_t>(y * width + x),
                 plane = static_cast<std::size_t>(width * height);
      frame[at] = static_cast<uint8_t>(red);
      if (env.channels > 1) frame[plane + at] = static_cast<uint8_t>(green);
      if (env.channels > 2) frame[2 * plane + at] = static_cast<uint8_t>(blue);
    }
  }
}

/// Slabs to insert again and again.
class Source {
 public:
  static Expected<Source> create(const TrajectoryShape& shape, const std::string& pictures) {
    Source source(shape);
    std::vector<char> frames;
    const auto frame_bytes = static_cast<std::size_t>(shape.env.frame_bytes());
    if (!pictures.empty()) {
      std::ifstream file(pictures, std::ios::binary);
      if (!file) return Error{ErrorCode::kNotFound, "--pictures " + pictures + " cannot be read"};
      frames.assign(std::istreambuf_iterator<char>(file), {});
      if (frames.size() < frame_bytes)
        return Error{ErrorCode::kBadFormat,
                     fmt::format("--pictures {} holds not one frame of {} bytes (u8, planes R G B)", pictures,
                                 frame_bytes)};
    }
    const std::size_t count = frames.size() / frame_bytes;
    std::size_t next = 0;
    for (int index = 0; index < kSlabCount; ++index) {
      const SlabView slab = source.slab(index);
      Rng rng(RngKey(uint64_t{17}).split(static_cast<uint64_t>(index)));
      for (int row = 0; row <= shape.rollout_steps; ++row)
        for (int agent = 0; agent < shape.env.num_agents; ++agent) {
          const auto frame = slab.frame(row, agent);
          if (count > 0)
            std::copy_n(frames.begin() + static_cast<std::ptrdiff_t>(next++ % count * frame_bytes),
                        frame_bytes, frame.begin());
          else
            draw_picture(shape.env, 100 * agent + 5 * row, static_cast<uint64_t>(index), frame);
          std::ranges::fill(slab.action_mask(row, agent), uint8_t{1});
          slab.agent_active(row, agent) = 1;
          if (row == shape.rollout_steps) continue;
          for (int32_t& action : slab.action(row, agent)) action = static_cast<int32_t>(rng.below(2));
          slab.reward(row, agent) = static_cast<float>(rng.uniform());
        }
      for (int step = 0; step < shape.rollout_steps; ++step) {
        slab.final_index(step) = -1;
        slab.valid(step) = 1;
      }
    }
    return source;
  }

  SlabView slab(int index) {
    return SlabView(*offsets_,
                    bytes_.data() + static_cast<int64_t>(index % kSlabCount) * offsets_->slab_bytes);
  }

 private:
  explicit Source(const TrajectoryShape& shape)
      : offsets_(std::make_unique<SlabOffsets>(shape)),
        bytes_(static_cast<std::size_t>(kSlabCount * offsets_->slab_bytes)) {}
  std::unique_ptr<SlabOffsets> offsets_;
  std::vector<std::byte> bytes_;
};

/// What was copied, and in which time.
struct Rate {
  int64_t frames = 0;
  int64_t decisions = 0;
  double seconds = 0;
  double cpu_seconds = 0;
  std::vector<double> windows = {};  ///< decisions a second
  double frames_per_s() const { return static_cast<double>(frames) / seconds; }
  double decisions_per_s() const { return static_cast<double>(decisions) / seconds; }
};

ordered_json as_json(const Rate& rate, int64_t frame_bytes) {
  return {{"frames_per_s", rate.frames_per_s()},
          {"gb_per_s", rate.frames_per_s() * static_cast<double>(frame_bytes) * 1e-9},
          {"decisions_per_s", rate.decisions_per_s()},
          {"windows", rate.windows},
          {"spread", spread_of(rate.windows)},
          {"cpu_us_per_frame", rate.cpu_seconds * 1e6 / static_cast<double>(rate.frames)},
          {"seconds", rate.seconds}};
}

/// Draws `batch` units at a time and copies their pictures into one buffer, for so many seconds.
Rate measure(Replay& replay, Unit unit, const Arguments& arguments) {
  const TrajectoryShape& shape = replay.options().store.shape;
  const int64_t agents = shape.env.num_agents, frame_bytes = shape.env.frame_bytes();
  const int64_t rows = unit == Unit::kSequence ? shape.rollout_steps + 1 : 2;
  const int64_t width = unit == Unit::kAgentStep ? 1 : agents;  // frames of a row
  const int64_t batch = unit == Unit::kSequence ? arguments.batch : 16 * int64_t{arguments.batch};
  std::vector<uint8_t> buffer(
      static_cast<std::size_t>(rows * batch * width * frame_bytes));  // [rows, batch, ...]
  Rng rng(uint64_t{23});
  Rate rate;
  BenchWindows windows(arguments.seconds);
  bool is_over = false;
  for (int round = -1; !is_over; ++round) {
    if (round == 0) rate = {};  // the first round only touches the buffer and warms the code
    const Stopwatch clock;
    std::vector<Draw> draws = replay.draw(batch, 1, rng);
    for (Draw& draw : draws) {
      if (unit == Unit::kSequence) break;
      draw.step = static_cast<int32_t>(rng.below(static_cast<uint32_t>(shape.rollout_steps)));
      if (unit == Unit::kAgentStep)
        draw.agent = static_cast<int32_t>(rng.below(static_cast<uint32_t>(agents)));
    }
    replay.read_each(draws, [&](std::size_t index, const StoredTrajectory* item) {
      const Draw& draw = draws[index];
      for (int64_t row = 0; row < rows; ++row) {
        uint8_t* out = buffer.data() + (row * batch + static_cast<int64_t>(index)) * width * frame_bytes;
        const int step = static_cast<int>(std::max(draw.step, 0) + row);
        if (draw.agent >= 0)
          item->copy_frame(step, draw.agent, out);
        else
          item->copy_frames(step, out);
      }
    });
    rate.frames += rows * batch * width;
    rate.decisions += (rows - 1) * batch * width;
    rate.seconds += clock.elapsed();
    rate.cpu_seconds += clock.cpu_elapsed();
    is_over = round >= 0 && windows.see(static_cast<double>(rate.decisions), rate.seconds);
  }
  rate.windows = windows.rates();
  return rate;
}

/// Bytes per second of reading the file from its beginning in large pieces.
Expected<double> read_sequentially(int descriptor, int64_t byte_count, double seconds) {
  const int file = open((fmt::format("/proc/self/fd/{}", descriptor)).c_str(), O_RDONLY | O_CLOEXEC);
  if (file < 0) return Error{ErrorCode::kSystem, "the replay's file cannot be opened a second time"};
  (void)posix_fadvise(file, 0, 0, POSIX_FADV_SEQUENTIAL);
  std::vector<char> piece(std::size_t{4} << 20);
  int64_t done = 0;
  const Stopwatch clock;
  while (done < byte_count && clock.elapsed() < seconds) {
    const ssize_t count = read(file, piece.data(), piece.size());
    if (count <= 0) break;
    done += count;
  }
  const double took = clock.elapsed();
  close(file);
  return static_cast<double>(done) / took;
}

Expected<ordered_json> run_mode(const std::string& mode, const Arguments& arguments, Source& source) {
  const TrajectoryShape shape = bench_shape(arguments);
  const int64_t frame_bytes = shape.env.frame_bytes();
  COMRAD_TRY_ASSIGN(
      const std::unique_ptr<Replay> replay,
      Replay::create({.store = {.shape = shape,
                                .capacity_bytes = static_cast<int64_t>(arguments.replay_gb * 1e9),
                                .file = mode == "mapped" ? arguments.replay_file : "",
                                .compress = mode == "lz4"}}));
  int64_t items = 0;
  int index = 0;
  for (; items == replay->item_count(); ++index, ++items) {  // until the first one leaves
    replay->insert(source.slab(index), static_cast<uint32_t>(shape.rollout_steps));
    if (const auto failed = replay->write_error(); failed) return *failed;
  }
  // Inserts are timed in the second round: the first one also pays for memory that was never touched.
  Rate inserts;
  const Stopwatch clock;
  for (; inserts.seconds < arguments.seconds; ++index) {
    inserts.decisions += replay->insert(source.slab(index), static_cast<uint32_t>(shape.rollout_steps));
    inserts.seconds = clock.elapsed();
  }
  if (const auto failed = replay->write_error(); failed) return *failed;
  const double bytes_per_transition =
      static_cast<double>(replay->used_bytes()) / static_cast<double>(replay->transition_count());
  const double raw_bytes = static_cast<double>(TrajectoryStore::item_bytes(shape, 0, false)) /
                           static_cast<double>(int64_t{shape.rollout_steps} * shape.env.num_agents);
  ordered_json report = {{"capacity_bytes", replay->capacity_bytes()},
                         {"capacity_transitions", replay->transition_count()},
                         {"sequences", replay->item_count()},
                         {"bytes_per_transition", bytes_per_transition},
                         {"insert_decisions_per_s", inserts.decisions_per_s()}};
  if (mode == "lz4") report["compression_ratio"] = raw_bytes / bytes_per_transition;
  const auto begin_cold = [&] { replay->read([](const TrajectoryStore& store) { store.forget_cached(); }); };
  if (mode == "mapped") {
    begin_cold();
    int descriptor = -1;
    replay->read([&](const TrajectoryStore& store) { descriptor = store.descriptor(); });
    COMRAD_TRY_ASSIGN(const double sequential,
                      read_sequentially(descriptor, replay->capacity_bytes(), arguments.seconds));
    report["sequential_gb_per_s"] = sequential * 1e-9;
  }
  for (const auto& [name, unit] :
       {std::pair{"sequences_read", Unit::kSequence}, std::pair{"joint_steps_read", Unit::kJointStep},
        std::pair{"agent_steps_read", Unit::kAgentStep}}) {
    begin_cold();
    report[name] = as_json(measure(*replay, unit, arguments), frame_bytes);
    if (mode == "mapped")
      report[name]["of_sequential"] =
          report[name]["gb_per_s"].get<double>() / report["sequential_gb_per_s"].get<double>();
  }
  return report;
}

void print_table(const ordered_json& summary) {
  std::printf("%-8s %12s %10s %12s %-12s %12s %8s %14s\n", "mode", "transitions", "sequences", "inserts/s",
              "read", "frames/s", "GB/s", "decisions/s");
  for (const auto& [mode, report] : summary["modes"].items()) {
    for (const char* unit : {"sequences_read", "joint_steps_read", "agent_steps_read"}) {
      const ordered_json& rate = report[unit];
      std::string name = unit;
      name.resize(name.size() - 5);
      std::printf("%-8s %12lld %10lld %12.0f %-12s %12.0f %8.2f %14.0f\n", mode.c_str(),
                  static_cast<long long>(report["capacity_transitions"].get<int64_t>()),
                  static_cast<long long>(report["sequences"].get<int64_t>()),
                  report["insert_decisions_per_s"].get<double>(), name.c_str(),
                  rate["frames_per_s"].get<double>(), rate["gb_per_s"].get<double>(),
                  rate["decisions_per_s"].get<double>());
    }
    if (report.contains("compression_ratio"))
      std::printf("%-8s LZ4 stores %.2f times as much\n", mode.c_str(),
                  report["compression_ratio"].get<double>());
    if (report.contains("sequential_gb_per_s"))
      std::printf("%-8s a sequential read of the file gives %.2f GB/s; sequences reach %.0f %% of it\n",
                  mode.c_str(), report["sequential_gb_per_s"].get<double>(),
                  100 * report["sequences_read"]["of_sequential"].get<double>());
  }
}

Status run(const Arguments& arguments) {
  const TrajectoryShape shape = bench_shape(arguments);
  const Stopwatch clock;
  COMRAD_TRY_ASSIGN(Source source, Source::create(shape, arguments.pictures));
  ordered_json modes = ordered_json::object();
  for (const std::string& mode : arguments.modes) {
    COMRAD_TRY_ASSIGN(modes[mode], run_mode(mode, arguments, source));
  }
  // The keys that every bench has come first; no scenario plays and nothing learns here.
  const ordered_json& first = modes[arguments.modes.front()]["sequences_read"];
  const double decisions_per_s = median_of(first["windows"].get<std::vector<double>>());
  const ordered_json summary = {{"bench", "replay"},
                                {"scenario", "none"},
                                {"algo", "none"},
                                {"num_agents", arguments.num_agents},
                                {"cores", 1},
                                {"seconds", clock.elapsed()},
                                {"decisions_per_s", decisions_per_s},
                                {"env_frames_per_s", decisions_per_s * kTicsPerDecision},
                                {"windows", first["windows"]},
                                {"spread", first["spread"]},
                                {"frames_per_s", first["frames_per_s"]},
                                {"gb_per_s", first["gb_per_s"]},
                                {"rollout", arguments.rollout},
                                {"batch", arguments.batch},
                                {"pictures", arguments.pictures.empty() ? "synthetic" : arguments.pictures},
                                {"replay_gb", arguments.replay_gb},
                                {"free_memory_gb", static_cast<double>(shm::free_memory_bytes()) * 1e-9},
                                {"modes", modes}};
  if (arguments.json)
    std::printf("%s\n", summary.dump().c_str());
  else
    print_table(summary);
  return {};
}

}  // namespace
}  // namespace comrad::replay

int main(int argc, char** argv) {
  comrad::prepare_process();
  using namespace comrad;
  replay::Arguments arguments;
  CLI::App app{
      "Throughput of the replay alone: frames per second that are drawn and copied into a batch, from\n"
      "memory, from memory with LZ4, and from a mapped file that starts cold (with --replay_file)."};
  app.name("comrad bench replay");
  app.add_option("--replay_gb", arguments.replay_gb, "capacity, in 1e9 bytes (default 1)")
      ->check(CLI::Range(0.001, 1e6));
  app.add_option("--replay_file", arguments.replay_file,
                 "path for the mapped file; it is made at that size and is gone afterwards");
  app.add_option("--modes", arguments.modes,
                 "ram, lz4, mapped (default: ram,lz4, and mapped with --replay_file)")
      ->delimiter(',')
      ->check(CLI::IsMember({"ram", "lz4", "mapped"}));
  app.add_option("--pictures", arguments.pictures,
                 "fill with these frames instead of made-up ones: raw u8, 3 x 72 x 128 each");
  app.add_option("--seconds", arguments.seconds, "how long each reading is measured (default 3)")
      ->check(CLI::Range(0.01, 3600.0));
  app.add_option("--num_agents", arguments.num_agents, "agents of a world (default 2)")
      ->check(CLI::Range(1, kMaxAgents));
  app.add_option("--rollout", arguments.rollout, "steps of a sequence (default 32)")
      ->check(CLI::Range(1, 256));
  app.add_option("--batch", arguments.batch,
                 "sequences of a batch; 16 times as many single steps (default 16)")
      ->check(CLI::Range(1, 1024));
  app.add_flag("--json", arguments.json, "print one JSON object on stdout and nothing else");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& failure) {
    return app.exit(failure) == 0 ? 0 : kExitBadInput;
  }
  if (arguments.modes.empty()) {
    arguments.modes = {"ram", "lz4"};
    if (!arguments.replay_file.empty()) arguments.modes.push_back("mapped");
  }
  const bool wants_file = std::ranges::count(arguments.modes, "mapped") > 0;
  if (wants_file && arguments.replay_file.empty()) {
    std::fprintf(stderr, "comrad bench replay: error: mode mapped needs --replay_file PATH\n");
    return kExitBadInput;
  }
  try {
    const Status done = replay::run(arguments);
    if (done) return 0;
    std::fprintf(stderr, "comrad bench replay: error: %s\n", done.error().message.c_str());
    return exit_code(done.error());
  } catch (const std::exception& failure) {  // from libraries; ours do not throw
    std::fprintf(stderr, "comrad bench replay: error: %s\n", failure.what());
    return kExitFailed;
  }
}

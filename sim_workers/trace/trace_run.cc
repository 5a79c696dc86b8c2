#include "sim_workers/trace/trace_run.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>

#include "rollout_buffer/core/files.h"
#include "sim_workers/engine/render/art_archive.h"
#include "sim_workers/engine/render/png_image.h"
#include "sim_workers/trace/trace_table.h"

namespace comrad::trace {
namespace {

void warn(const std::string& message) {
  std::fprintf(stderr, "comrad trace: warning: %s\n", message.c_str());
}

/// Draws pictures at the wanted tics.
class FrameWriter {
 public:
  static Expected<FrameWriter> create(const RunOptions& options, TraceGame& game) {
    FrameWriter writer(options);
    if (options.frames_folder.empty()) return writer;
    std::error_code failure;
    std::filesystem::create_directories(options.frames_folder, failure);
    if (failure) return Error{ErrorCode::kSystem, options.frames_folder + ": " + failure.message()};
    COMRAD_TRY_ASSIGN(auto art, doom::ArtArchive::open(game.iwad_path, game.art_paths));
    doom::RenderOptions render = game.render;
    render.width = options.frame_width, render.height = options.frame_height;
    COMRAD_TRY_ASSIGN(writer.renderer_, doom::Renderer::create(art, render));
    COMRAD_TRY(writer.renderer_->prepare(game.world().shared_level(), game.world().shared_catalog()));
    const std::filesystem::path target(options.game.target);
    writer.stem_ = options.frames_folder + "/" + target.stem().string();
    return writer;
  }

  Status write(TraceGame& game, int64_t t) {
    if (renderer_ == nullptr || std::count(options_->frame_tics.begin(), options_->frame_tics.end(), t) == 0)
      return {};
    const std::size_t plane = static_cast<std::size_t>(options_->frame_width) * options_->frame_height;
    std::vector<uint8_t> pixels(3 * plane);
    const doom::ViewRequest view{&game.world(), 0, pixels.data()};
    renderer_->draw({&view, 1});
    char number[32];
    std::snprintf(number, sizeof number, "_t%03lld.png", static_cast<long long>(t));
    return doom::write_png(stem_ + number, pixels, options_->frame_width, options_->frame_height);
  }

 private:
  explicit FrameWriter(const RunOptions& options) : options_(&options) {}
  const RunOptions* options_;
  std::unique_ptr<doom::Renderer> renderer_;
  std::string stem_;
};

/// The CSV file, or standard output.
class Output {
 public:
  static Expected<Output> open(const std::string& path) {
    Output output;
    output.path_ = path.empty() ? "standard output" : path;
    output.file_.reset(path.empty() ? stdout : std::fopen(path.c_str(), "w"));
    if (!output.file_) return system_error("cannot write " + path);
    return output;
  }
  Status line(const std::string& text) {
    if (std::fputs(text.c_str(), file_.get()) < 0 || std::fputc('\n', file_.get()) < 0) return failure();
    return {};
  }
  Status flush() { return std::fflush(file_.get()) == 0 ? Status() : failure(); }

 private:
  struct Close {
    void operator()(std::FILE* file) const {
      if (file != stdout) std::fclose(file);
    }
  };
  Status failure() const { return system_error("cannot write " + path_); }
  std::string path_;
  std::unique_ptr<std::FILE, Close> file_;
};

/// One line per actor, for joining with the rows of the trace.
Status write_things(Output& output, const doom::World& world, int64_t t) {
  for (const doom::Actor& actor : world.actors()) {
    char line[256];
    std::snprintf(line, sizeof line, "%lld,%u,%s,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f",
                  static_cast<long long>(t), actor.id, world.catalog()[actor.type].name.substr(0, 64).c_str(),
                  doom::to_double(actor.x), doom::to_double(actor.y), doom::to_double(actor.z),
                  actor.angle * (360.0 / 4294967296.0), doom::to_double(actor.velocity_x),
                  doom::to_double(actor.velocity_y), doom::to_double(actor.velocity_z));
    COMRAD_TRY(output.line(line));
  }
  return {};
}

}  // namespace

Status run_trace(const RunOptions& options) {
  ActionTable actions;
  if (!options.actions_path.empty()) {
    COMRAD_TRY_ASSIGN(actions, ActionTable::load(options.actions_path));
  }
  std::optional<Pose> pose;
  if (!options.start_path.empty()) {
    COMRAD_TRY_ASSIGN(pose, load_pose(options.start_path));
  }
  COMRAD_TRY_ASSIGN(const std::unique_ptr<TraceGame> game, open_trace_game(options.game));
  for (const std::string& warning : game->warnings) warn(warning);
  const uint64_t seed = options.seed.value_or(game->default_seed);
  if (options.actions_path.empty() && options.random_tics > 0) {
    std::vector<scenarios::Button> buttons = game->buttons;
    std::vector<std::string> names = game->button_names;
    if (buttons.empty())
      for (const ActionColumn& column : standard_columns())
        buttons.push_back(column.button), names.push_back(column.name);
    actions = ActionTable::random(buttons, names, options.random_tics, seed);
  }
  game->reset(seed);
  if (pose) set_pose(game->world(), *pose);

  COMRAD_TRY_ASSIGN(FrameWriter frames, FrameWriter::create(options, *game));
  COMRAD_TRY_ASSIGN(Output output, Output::open(options.out_path));
  std::optional<Output> things;
  if (!options.things_path.empty()) {
    COMRAD_TRY_ASSIGN(things, Output::open(options.things_path));
    COMRAD_TRY(things->line("t,id,name,x,y,z,angle,vx,vy,vz"));
    COMRAD_TRY(write_things(*things, game->world(), 0));
  }
  COMRAD_TRY_ASSIGN(const TraceTable table,
                    TraceTable::create(actions, options.variables, options.with_hash));
  COMRAD_TRY(output.line(
      fmt::format("# {} seed {}{}", game->title, seed, (options.game.no_monsters ? ", no monsters" : ""))));
  COMRAD_TRY(output.line(table.header()));
  COMRAD_TRY(output.line(table.row(*game, 0, 0, 0)));
  COMRAD_TRY(frames.write(*game, 0));
  double total_reward = 0;
  int64_t t = 0;
  while (t < actions.size() && !game->finished()) {
    const double reward = game->step(actions.buttons(t));
    total_reward += reward;
    ++t;
    COMRAD_TRY(output.line(table.row(*game, t, reward, total_reward)));
    COMRAD_TRY(frames.write(*game, t));
    if (things) COMRAD_TRY(write_things(*things, game->world(), t));
  }
  COMRAD_TRY(output.flush());
  if (things) COMRAD_TRY(things->flush());
  for (const int64_t wanted : options.frame_tics)
    if (wanted > t) warn(fmt::format("no picture of tic {}: the trace ended with tic {}", wanted, t));
  return {};
}

}  // namespace comrad::trace

#include "sim_workers/python/env_batch.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <numbers>
#include <numeric>
#include <utility>

#include "rollout_buffer/core/rng.h"
#include "scenarios/spec/global_state.h"
#include "scenarios/spec/vizdoom_config.h"
#include "sim_workers/env/button_press.h"

namespace comrad::python {
namespace {

constexpr int kMostEnvs = 4096, kMostThreads = 256, kSmallestView = 16, kLargestView = 4096;

Error bad(std::string message) { return Error{ErrorCode::kBadInput, std::move(message)}; }

Status check_range(const char* name, int value, int least, int most) {
  if (value >= least && value <= most) return {};
  return bad(fmt::format("{} is {}; it must lie in {}..{}", name, value, least, most));
}

Status check_view(int width, int height) {
  COMRAD_TRY(check_range("width", width, kSmallestView, kLargestView));
  return check_range("height", height, kSmallestView, kLargestView);
}

/// [3, height, width] to [height, width, 3].
void interleave(const uint8_t* planes, std::size_t pixels, uint8_t* picture) {
  for (std::size_t pixel = 0; pixel < pixels; ++pixel)
    for (std::size_t plane = 0; plane < 3; ++plane)
      picture[3 * pixel + plane] = planes[plane * pixels + pixel];
}

}  // namespace

struct EnvBatch::Slot {
  std::unique_ptr<sim::DoomEnvironment> environment;
  EpisodeKey episode;
  bool has_begun = false, is_over = false;
  bool is_sent = false;  // by send_some(), and not received
  SeenLines seen_lines;
  std::vector<std::vector<doom::ThingLabel>> things;  // [agent]
};

/// What only lives until close().
struct EnvBatch::Works {
  /// One environment's step for send_some().
  struct Job {
    int index;
    std::vector<int32_t> choices;
  };
  /// One thread's share.
  struct Lane {
    std::shared_ptr<sim::LayoutLibrary> library;
    std::unique_ptr<doom::Renderer> renderer;
    std::unique_ptr<doom::Renderer> painter;  // of another size, for draw()
    int painter_width = 0, painter_height = 0;
    std::vector<int> indices;
    std::vector<doom::ViewRequest> views;
    std::vector<uint8_t> planes;  // where pictures are interleaved
    Status status;
    std::deque<Job> jobs;  // guarded by `mutex`
  };
  explicit Works(int threads) : lanes(static_cast<std::size_t>(threads)), pool(threads) {}
  ~Works() {  // what belongs to a thread ends in it
    wait();
    pool.start([this](int thread) {
      Lane& lane = lanes[static_cast<std::size_t>(thread)];
      if (lane.library != nullptr) lane.library->draw_with(nullptr);
      lane.painter.reset();
      lane.renderer.reset();
    });
    pool.wait();
  }
  /// Until the threads have done what they were given.
  void wait() {
    {
      const std::lock_guard lock(mutex);
      is_serving = false;
    }
    asked.notify_all();
    pool.wait();
  }
  std::vector<Slot> slots;
  std::vector<Lane> lanes;
  std::mutex mutex;
  std::condition_variable asked, answered;
  bool is_serving = false;  // threads wait for jobs
  std::vector<int> done;    // jobs that are, by environment
  Status failed;            // of a job
  ThreadPool pool;
};

class EnvBatch::Entry {
 public:
  /// What must have been sent.
  enum class After { kNothing, kSend, kSendSome, kNothingOrSendSome };
  explicit Entry(EnvBatch& batch, After after = After::kNothing) {
    if (batch.process_ != getpid()) {
      status_ = bad("these environments were made in another process; make new ones after a fork");
    } else if (batch.is_entered_.exchange(true)) {
      status_ = bad("another thread is in a call of these environments; give each thread its own");
    } else {
      entered_ = &batch.is_entered_;
      if (batch.is_closed())
        status_ = bad("these environments were closed");
      else if (batch.is_sent_ && after != After::kSend)
        status_ = bad("a step was sent and not received; call recv() first");
      else if (batch.some_sent_ > 0 && (after == After::kNothing || after == After::kSend))
        status_ = bad(fmt::format("steps of {} environments were sent and not received; call recv() first",
                                  batch.some_sent_));
      else if ((!batch.is_sent_ && after == After::kSend) ||
               (batch.some_sent_ == 0 && after == After::kSendSome))
        status_ = bad("no step was sent; call send() first");
    }
  }
  ~Entry() {
    if (entered_ != nullptr) *entered_ = false;
  }
  Entry(const Entry&) = delete;
  Entry& operator=(const Entry&) = delete;
  const Status& status() const { return status_; }

 private:
  std::atomic<bool>* entered_ = nullptr;
  Status status_;
};

Expected<std::unique_ptr<EnvBatch>> EnvBatch::create(const BatchOptions& options) {
  std::unique_ptr<EnvBatch> batch(new EnvBatch(options));
  COMRAD_TRY(batch->open());
  return batch;
}

EnvBatch::EnvBatch(const BatchOptions& options) : options_(options) {}
EnvBatch::~EnvBatch() { static_cast<void>(close()); }

Status EnvBatch::close() {
  if (works_ == nullptr) return {};
  if (process_ != getpid()) {
    // The threads are the parent's, and so is what they draw with: nothing of it may be touched.
    static_cast<void>(works_.release());
    return {};
  }
  if (is_entered_.exchange(true))
    return bad("another thread is in a call of these environments; close them when it is back");
  works_->wait();  // for steps that were sent
  works_.reset();
  is_sent_ = false;
  some_sent_ = 0;
  is_entered_ = false;
  return {};
}

Status EnvBatch::open() {
  COMRAD_TRY(check_range("num_envs", options_.num_envs, 1, kMostEnvs));
  COMRAD_TRY(check_range("num_threads", options_.num_threads, 1, kMostThreads));
  COMRAD_TRY(check_view(options_.width, options_.height));
  if (options_.maps.empty()) return bad("no map was named");
  COMRAD_TRY_ASSIGN(spec_, scenarios::load_scenario(options_.scenario));
  if (options_.num_agents == 0) options_.num_agents = spec_.default_agents;
  options_.num_threads = std::min(options_.num_threads, options_.num_envs);
  if (options_.by_buttons) {
    if (!spec_.is_vizdoom)
      return bad(options_.scenario + " has action heads; only a ViZDoom .cfg can be played by its buttons");
  }
  std::string automap_mode = options_.automap_mode.empty() ? "NORMAL" : options_.automap_mode;
  automap_ = {.width = options_.width, .height = options_.height};
  if (spec_.is_vizdoom) {
    COMRAD_TRY_ASSIGN(const scenarios::VizdoomConfig config,
                      scenarios::load_vizdoom_config(options_.scenario));
    buttons_ = config.buttons;
    button_names_ = config.button_names;
    if (options_.automap_mode.empty()) automap_mode = config.buffers.automap_mode;
    automap_.rotates = config.buffers.automap_rotates;
  }
  const std::optional<doom::AutomapMode> mode = doom::find_automap_mode(automap_mode);
  if (!mode) return bad("automap_mode '" + automap_mode + "' is none of " + doom::kAutomapModeNames);
  automap_.mode = *mode;
  if (has_reward_schedule(options_.reward))
    return bad("reward is '" + options_.reward +
               "'; weights over env frames are for a run that trains (comrad train --reward), so each term "
               "must have "
               "one number");
  sim::EnvironmentOptions environment{.scenario = options_.scenario,
                                      .wad_path = options_.maps.front(),
                                      .num_agents = options_.num_agents,
                                      .count = options_.num_envs,
                                      .frame_skip = options_.frame_skip,
                                      .use_measurements = true,
                                      .reward = options_.reward,
                                      .heads = options_.heads};
  COMRAD_TRY_ASSIGN(const std::shared_ptr<const sim::DoomGame> game, sim::load_doom_game(environment));
  spec_ = game->spec;
  shape_ = spec_.shape(options_.num_agents, true);
  for (const scenarios::MeasurementTerm& term : spec_.measurements)
    variables_.push_back(scenarios::find_term_variable(term.variable).value());
  state_names_ = scenarios::global_state_names(spec_, options_.num_agents);
  size_arrays();

  environment.layouts = options_.maps;
  works_ = std::make_unique<Works>(options_.num_threads);
  works_->slots.resize(static_cast<std::size_t>(options_.num_envs));
  for (int index = 0; index < options_.num_envs; ++index)
    works_->lanes[static_cast<std::size_t>(index % options_.num_threads)].indices.push_back(index);
  run([this, environment](int thread) -> Status {
    Works::Lane& lane = works_->lanes[static_cast<std::size_t>(thread)];
    COMRAD_TRY_ASSIGN(lane.library, sim::LayoutLibrary::create(environment));
    COMRAD_TRY_ASSIGN(const std::shared_ptr<const sim::DoomGame> first, lane.library->game(0));
    if (options_.has_pictures || options_.has_depth || options_.has_labels || options_.has_automap) {
      COMRAD_TRY_ASSIGN(lane.renderer,
                        sim::make_renderer(*first, options_.maps, {options_.width, options_.height}));
      lane.library->draw_with(lane.renderer.get());
    }
    for (const int index : lane.indices) {
      Slot& slot = works_->slots[static_cast<std::size_t>(index)];
      slot.environment = std::make_unique<sim::DoomEnvironment>(first);
      slot.environment->choose_from(lane.library);
      slot.seen_lines.resize(static_cast<std::size_t>(options_.num_agents));
      slot.things.resize(static_cast<std::size_t>(options_.num_agents));
    }
    return {};
  });
  const Status opened = finish();
  if (!opened) COMRAD_TRY(close());
  return opened;
}

void EnvBatch::size_arrays() {
  const auto envs = static_cast<std::size_t>(options_.num_envs);
  const std::size_t rows = envs * static_cast<std::size_t>(options_.num_agents);
  const std::size_t pixels =
      static_cast<std::size_t>(options_.width) * static_cast<std::size_t>(options_.height);
  const auto measurements = static_cast<std::size_t>(shape_.measurement_count);
  if (options_.has_pictures) arrays_.picture.resize(rows * 3 * pixels);
  if (options_.has_depth) arrays_.depth.resize(rows * pixels);
  if (options_.has_labels) arrays_.labels.resize(rows * pixels);
  if (options_.has_automap) arrays_.automap.resize(rows * 3 * pixels);
  arrays_.measurement.resize(rows * measurements);
  arrays_.variable.resize(rows * measurements);
  arrays_.action_mask.resize(rows * static_cast<std::size_t>(shape_.logit_count()));
  arrays_.active.resize(rows);
  arrays_.state.resize(envs * state_names_.size());
  arrays_.reward.resize(rows);
  arrays_.terminated.resize(envs);
  arrays_.truncated.resize(envs);
  arrays_.score.resize(envs);
  arrays_.ceiling.resize(envs);
  arrays_.agent_return.resize(rows);
  arrays_.length_tics.resize(envs);
  arrays_.length_steps.resize(envs);
  arrays_.episode_seed.resize(envs);
  arrays_.stream_seed.resize(envs);
  arrays_.episode_number.resize(envs);
}

void EnvBatch::run(std::function<Status(int)> task, bool serves) {
  works_->wait();
  works_->is_serving = serves;  // no thread runs that could read it
  works_->pool.start([this, task = std::move(task)](int thread) {
    works_->lanes[static_cast<std::size_t>(thread)].status = task(thread);
  });
}

Status EnvBatch::finish() {
  works_->pool.wait();
  for (const Works::Lane& lane : works_->lanes)
    if (!lane.status) return lane.status;
  return {};
}

Status EnvBatch::begin_episode(Slot& slot) {
  const auto index = static_cast<uint64_t>(&slot - works_->slots.data());
  const EpisodeKey& episode = slot.episode;
  const uint64_t turn = index + episode.number.value_or(0) * static_cast<uint64_t>(options_.num_envs);
  COMRAD_TRY(slot.environment->choose_layout(static_cast<int>(turn % options_.maps.size())));
  const uint64_t seed = episode.number
                            ? RngKey(episode.seed).split("python episode").split(*episode.number).bits()
                            : episode.seed;
  slot.environment->reset(seed);
  slot.has_begun = true;
  slot.is_over = false;
  for (std::vector<uint8_t>& lines : slot.seen_lines) lines.clear();
  arrays_.episode_seed[index] = seed;
  arrays_.stream_seed[index] = episode.seed;
  arrays_.episode_number[index] = episode.number.value_or(0);
  return {};
}

Status EnvBatch::reset(std::span<const std::optional<EpisodeKey>> keys) {
  const Entry entry(*this);
  COMRAD_TRY(entry.status());
  if (keys.size() != works_->slots.size())
    return bad(fmt::format("{} seeds were given for {} environments", keys.size(), works_->slots.size()));
  run([this, keys](int thread) -> Status {
    std::vector<int> begun;
    for (const int index : works_->lanes[static_cast<std::size_t>(thread)].indices) {
      const std::optional<EpisodeKey>& key = keys[static_cast<std::size_t>(index)];
      if (!key) continue;
      Slot& slot = works_->slots[static_cast<std::size_t>(index)];
      slot.episode = *key;
      COMRAD_TRY(begin_episode(slot));
      write_numbers(index);
      begun.push_back(index);
    }
    draw_views(thread, begun);
    return {};
  });
  return finish();
}

Status EnvBatch::check_can_step(const Slot& slot) const {
  if (!slot.has_begun) return bad("call reset() before the first step");
  if (slot.is_over && !options_.autoreset) return bad("the episode is over; call reset()");
  return {};
}

std::vector<int> EnvBatch::all_indices() const {
  std::vector<int> all(works_->slots.size());
  std::iota(all.begin(), all.end(), 0);
  return all;
}

Status EnvBatch::step_one(int index, const std::function<void(sim::DoomEnvironment&)>& act) {
  Slot& slot = works_->slots[static_cast<std::size_t>(index)];
  if (slot.is_over) {
    slot.episode.number = slot.episode.number.value_or(0) + 1;
    COMRAD_TRY(begin_episode(slot));
  } else {
    act(*slot.environment);
    slot.is_over = slot.environment->last_step().episode_over();
  }
  write_numbers(index);
  return {};
}

void EnvBatch::run_step(std::function<void(sim::DoomEnvironment&, std::size_t)> act) {
  is_sent_ = true;
  run([this, act = std::move(act)](int thread) -> Status {
    const std::vector<int>& indices = works_->lanes[static_cast<std::size_t>(thread)].indices;
    for (const int index : indices)
      COMRAD_TRY(step_one(index, [&](sim::DoomEnvironment& environment) {
        act(environment, static_cast<std::size_t>(index));
      }));
    draw_views(thread, indices);
    return {};
  });
}

Status EnvBatch::check_step(std::span<const int> indices, std::span<const int32_t> choices) const {
  const auto heads = static_cast<std::size_t>(shape_.head_count);
  const auto agents = static_cast<std::size_t>(options_.num_agents);
  if (options_.by_buttons) return bad("these environments are played by buttons, not by choices of heads");
  if (choices.size() != indices.size() * agents * heads)
    return bad("an action has one choice for each environment, agent and head");
  for (std::size_t at = 0; at < choices.size(); ++at) {
    const int32_t most = shape_.head_sizes[at % heads];
    if (choices[at] < 0 || choices[at] >= most)
      return bad(fmt::format("action {} of environment {}, agent {}, head {}: it must lie in 0..{}",
                             choices[at], indices[at / heads / agents], at / heads % agents, at % heads,
                             most - 1));
  }
  for (const int index : indices) COMRAD_TRY(check_can_step(works_->slots[static_cast<std::size_t>(index)]));
  return {};
}

Status EnvBatch::send(std::span<const int32_t> choices) {
  const Entry entry(*this);
  COMRAD_TRY(entry.status());
  COMRAD_TRY(check_step(all_indices(), choices));
  const std::size_t size = choices.size() / works_->slots.size();
  run_step([actions = std::vector(choices.begin(), choices.end()), size](sim::DoomEnvironment& environment,
                                                                         std::size_t index) {
    environment.step({actions.data() + index * size, size});
  });
  return {};
}

Status EnvBatch::send_buttons(std::span<const float> values) {
  const Entry entry(*this);
  COMRAD_TRY(entry.status());
  const auto agents = static_cast<std::size_t>(options_.num_agents);
  if (!options_.by_buttons) return bad("these environments are played by choices of heads, not by buttons");
  if (values.size() != works_->slots.size() * agents * buttons_.size())
    return bad("an action has one number for each environment, agent and button");
  if (!std::ranges::all_of(values, [](float value) { return std::isfinite(value); }))
    return bad("an action holds a value that is no number");
  for (const Slot& slot : works_->slots) COMRAD_TRY(check_can_step(slot));
  run_step([this, agents, given = std::vector(values.begin(), values.end())](
               sim::DoomEnvironment& environment, std::size_t index) {
    std::vector<doom::Buttons> pressed(agents);
    std::size_t at = index * agents * buttons_.size();
    for (doom::Buttons& of_agent : pressed)
      for (const scenarios::Button& button : buttons_) sim::press(of_agent, button, given[at++]);
    environment.press(pressed);
  });
  return {};
}

Status EnvBatch::receive() {
  const Entry entry(*this, Entry::After::kSend);
  COMRAD_TRY(entry.status());
  const Status done = finish();
  is_sent_ = false;
  return done;
}

Status EnvBatch::send_some(std::span<const int> indices, std::span<const int32_t> choices) {
  const Entry entry(*this, Entry::After::kNothingOrSendSome);
  COMRAD_TRY(entry.status());
  std::vector<bool> is_named(works_->slots.size());
  for (const int index : indices) {
    COMRAD_TRY(check_range("the environment's index", index, 0, options_.num_envs - 1));
    const auto at = static_cast<std::size_t>(index);
    if (is_named[at] || works_->slots[at].is_sent)
      return bad(fmt::format("environment {} was sent a step already; call recv() first", index));
    is_named[at] = true;
  }
  COMRAD_TRY(check_step(indices, choices));
  if (indices.empty()) return {};
  if (!works_->is_serving) {  // only this thread writes it
    run([this](int thread) { return serve(thread); }, /*serves=*/true);
  }
  const std::size_t size = choices.size() / indices.size();
  {
    const std::lock_guard lock(works_->mutex);
    for (std::size_t at = 0; at < indices.size(); ++at) {
      const std::span<const int32_t> row = choices.subspan(at * size, size);
      works_->slots[static_cast<std::size_t>(indices[at])].is_sent = true;
      works_->lanes[static_cast<std::size_t>(indices[at] % options_.num_threads)].jobs.push_back(
          {indices[at], {row.begin(), row.end()}});
    }
    some_sent_ += static_cast<int>(indices.size());
  }
  works_->asked.notify_all();
  return {};
}

Status EnvBatch::serve(int thread) {
  Works::Lane& lane = works_->lanes[static_cast<std::size_t>(thread)];
  std::unique_lock lock(works_->mutex);
  while (true) {
    works_->asked.wait(lock, [&] { return !works_->is_serving || !lane.jobs.empty(); });
    if (lane.jobs.empty()) return {};
    const Works::Job job = std::move(lane.jobs.front());
    lane.jobs.pop_front();
    lock.unlock();
    const Status stepped =
        step_one(job.index, [&](sim::DoomEnvironment& environment) { environment.step(job.choices); });
    if (stepped) draw_views(thread, {&job.index, 1});
    lock.lock();
    if (!stepped) works_->failed = stepped;
    works_->done.push_back(job.index);
    works_->answered.notify_all();
  }
}

Expected<std::vector<int>> EnvBatch::receive_some(int least) {
  const Entry entry(*this, Entry::After::kSendSome);
  COMRAD_TRY(entry.status());
  std::vector<int> done;
  Status status;
  {
    std::unique_lock lock(works_->mutex);
    const auto wanted = static_cast<std::size_t>(std::clamp(least, 1, some_sent_));
    works_->answered.wait(lock, [&] { return works_->done.size() >= wanted; });
    done.swap(works_->done);
    std::swap(status, works_->failed);
  }
  some_sent_ -= static_cast<int>(done.size());
  for (const int index : done) works_->slots[static_cast<std::size_t>(index)].is_sent = false;
  COMRAD_TRY(status);
  std::ranges::sort(done);
  return done;
}

void EnvBatch::write_numbers(int index) {
  const auto at = static_cast<std::size_t>(index);
  const sim::DoomEnvironment& environment = *works_->slots[at].environment;
  const auto agents = static_cast<std::size_t>(options_.num_agents), first = at * agents;
  const auto measurements = static_cast<std::size_t>(shape_.measurement_count);
  environment.observe_numbers(
      {.frame = nullptr,
       .measurement = arrays_.measurement.data() + first * measurements,
       .action_mask = arrays_.action_mask.data() + first * static_cast<std::size_t>(shape_.logit_count()),
       .agent_active = arrays_.active.data() + first,
       .global_state = arrays_.state.data() + at * state_names_.size()});
  for (std::size_t agent = 0; agent < agents; ++agent) {
    const int player = static_cast<int>(agent);
    for (std::size_t term = 0; term < measurements; ++term)
      arrays_.variable[(first + agent) * measurements + term] = static_cast<float>(
          environment.read(player, variables_[term], spec_.measurements[term].agent_stride));
  }

  const sim::Step& step = environment.last_step();
  const EpisodeRecord summary = environment.summary_so_far();
  std::ranges::copy(step.reward, arrays_.reward.begin() + static_cast<std::ptrdiff_t>(first));
  std::ranges::copy(summary.returns(), arrays_.agent_return.begin() + static_cast<std::ptrdiff_t>(first));
  arrays_.terminated[at] = step.terminated;
  arrays_.truncated[at] = step.truncated;
  arrays_.score[at] = summary.score;
  arrays_.ceiling[at] = summary.ceiling;
  arrays_.length_tics[at] = summary.length_tics;
  arrays_.length_steps[at] = summary.length_steps;
}

void EnvBatch::draw_views(int thread, std::span<const int> indices) {
  if (options_.has_pictures) draw_pictures(thread, indices);
  if (options_.has_depth || options_.has_labels || options_.has_automap)
    for (const int index : indices)
      draw_buffers(*works_->lanes[static_cast<std::size_t>(thread)].renderer, index);
}

void EnvBatch::draw_pictures(int thread, std::span<const int> indices) {
  Works::Lane& lane = works_->lanes[static_cast<std::size_t>(thread)];
  const auto agents = static_cast<std::size_t>(options_.num_agents);
  const std::size_t pixels =
      static_cast<std::size_t>(options_.width) * static_cast<std::size_t>(options_.height);
  const auto picture_of = [&](int index, std::size_t agent) {
    return arrays_.picture.data() + (static_cast<std::size_t>(index) * agents + agent) * 3 * pixels;
  };
  const bool in_place = options_.channels_first;
  if (!in_place) lane.planes.resize(indices.size() * agents * 3 * pixels);
  lane.views.clear();
  for (const int index : indices)
    for (std::size_t agent = 0; agent < agents; ++agent)
      lane.views.push_back(
          {&works_->slots[static_cast<std::size_t>(index)].environment->world(), static_cast<int>(agent),
           in_place ? picture_of(index, agent) : lane.planes.data() + lane.views.size() * 3 * pixels});
  lane.renderer->draw(lane.views);
  if (in_place) return;
  std::size_t view = 0;
  for (const int index : indices)
    for (std::size_t agent = 0; agent < agents; ++agent, ++view)
      interleave(lane.planes.data() + view * 3 * pixels, pixels, picture_of(index, agent));
}

void EnvBatch::draw_buffers(doom::Renderer& renderer, int index) {
  Slot& slot = works_->slots[static_cast<std::size_t>(index)];
  const doom::World& world = slot.environment->world();
  const auto pixels = static_cast<std::ptrdiff_t>(options_.width) * options_.height;
  std::vector<float> depth;
  std::vector<uint8_t> bytes;
  for (int player = 0; player < options_.num_agents; ++player) {
    const auto agent = static_cast<std::size_t>(player);
    const std::ptrdiff_t row = index * options_.num_agents + player;
    if (options_.has_depth) {
      renderer.draw_depth(world, player, &depth);
      std::ranges::copy(depth, arrays_.depth.begin() + row * pixels);
    }
    if (options_.has_labels) {
      renderer.draw_labels(world, player, &bytes, &slot.things[agent]);
      std::ranges::copy(bytes, arrays_.labels.begin() + row * pixels);
    }
    if (!options_.has_automap) continue;
    renderer.mark_seen_lines(world, player, &slot.seen_lines[agent]);
    uint8_t* const map = arrays_.automap.data() + row * 3 * pixels;
    if (options_.channels_first) bytes.resize(static_cast<std::size_t>(3 * pixels));
    draw_automap(world, player, automap_, slot.seen_lines[agent],
                 options_.channels_first ? bytes.data() : map);
    if (options_.channels_first)
      for (std::ptrdiff_t at = 0; at < 3 * pixels; ++at)
        map[at % 3 * pixels + at / 3] = bytes[static_cast<std::size_t>(at)];
  }
}

Expected<std::vector<SeenThing>> EnvBatch::things_seen(int index, int agent) {
  const Entry entry(*this);
  COMRAD_TRY(entry.status());
  if (!options_.has_labels)
    return bad("these environments have no labels; request them when you create the environments");
  COMRAD_TRY(check_range("the environment's index", index, 0, options_.num_envs - 1));
  COMRAD_TRY(check_range("the agent's index", agent, 0, options_.num_agents - 1));
  const Slot& slot = works_->slots[static_cast<std::size_t>(index)];
  if (!slot.has_begun) return bad("call reset() before you request labels");
  const doom::World& world = slot.environment->world();
  std::vector<SeenThing> seen;
  for (const doom::ThingLabel& label : slot.things[static_cast<std::size_t>(agent)]) {
    const doom::Actor* const actor = world.find_actor(label.actor_id);
    if (actor == nullptr) continue;
    seen.push_back({.label = label,
                    .name = world.catalog()[actor->type].name,
                    .x = doom::to_double(actor->x),
                    .y = doom::to_double(actor->y),
                    .z = doom::to_double(actor->z),
                    .angle_degrees = doom::angle_to_radians(actor->angle) * 180.0 / std::numbers::pi,
                    .velocity_x = doom::to_double(actor->velocity_x),
                    .velocity_y = doom::to_double(actor->velocity_y),
                    .velocity_z = doom::to_double(actor->velocity_z)});
  }
  return seen;
}

Expected<std::shared_ptr<const SavedState>> EnvBatch::state_of(int index) {
  const Entry entry(*this);
  COMRAD_TRY(entry.status());
  COMRAD_TRY(check_range("the environment's index", index, 0, options_.num_envs - 1));
  const Slot& slot = works_->slots[static_cast<std::size_t>(index)];
  if (!slot.has_begun) return bad("call reset() before get_state()");
  return std::shared_ptr<const SavedState>(
      new SavedState(*slot.environment, slot.episode, slot.is_over, slot.seen_lines));
}

Status EnvBatch::restore(int index, const SavedState& state) {
  const Entry entry(*this);
  COMRAD_TRY(entry.status());
  COMRAD_TRY(check_range("the environment's index", index, 0, options_.num_envs - 1));
  Slot& slot = works_->slots[static_cast<std::size_t>(index)];
  const sim::DoomGame &saved = state.environment_.game(), &here = slot.environment->game();
  const EnvShape& saved_shape = state.environment_.shape();
  if (saved.spec.name != here.spec.name || saved.num_agents != here.num_agents ||
      saved.frame_skip != here.frame_skip)
    return bad(fmt::format(
        "the state is of {} with {} agents and frame skip {}, the environment is {} with {} and {}",
        saved.spec.name, saved.num_agents, saved.frame_skip, here.spec.name, here.num_agents,
        here.frame_skip));
  if (saved_shape.head_sizes != shape_.head_sizes ||
      saved_shape.measurement_count != shape_.measurement_count)
    return bad("the state is of an environment with other heads or measurements");
  run([this, index, &slot, &state](int thread) -> Status {
    Works::Lane& lane = works_->lanes[static_cast<std::size_t>(thread)];
    if (index % options_.num_threads != thread) return {};
    *slot.environment = state.environment_;
    slot.environment->choose_from(lane.library);
    slot.episode = state.episode_;
    arrays_.stream_seed[static_cast<std::size_t>(index)] = slot.episode.seed;
    arrays_.episode_number[static_cast<std::size_t>(index)] = slot.episode.number.value_or(0);
    slot.has_begun = true;
    slot.is_over = state.is_over_;
    slot.seen_lines = state.seen_lines_;
    write_numbers(index);
    draw_views(thread, {&index, 1});
    return {};
  });
  return finish();
}

Expected<uint64_t> EnvBatch::hash_of(int index) {
  const Entry entry(*this);
  COMRAD_TRY(entry.status());
  COMRAD_TRY(check_range("the environment's index", index, 0, options_.num_envs - 1));
  return works_->slots[static_cast<std::size_t>(index)].environment->state_hash();
}

Expected<std::vector<uint8_t>> EnvBatch::draw(int index, int width, int height) {
  const Entry entry(*this);
  COMRAD_TRY(entry.status());
  COMRAD_TRY(check_range("the environment's index", index, 0, options_.num_envs - 1));
  COMRAD_TRY(check_view(width, height));
  if (!works_->slots[static_cast<std::size_t>(index)].has_begun) return bad("call reset() before render()");
  const std::size_t bytes = 3 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  std::vector<uint8_t> pictures(bytes * static_cast<std::size_t>(options_.num_agents));
  run([&](int thread) -> Status {
    Works::Lane& lane = works_->lanes[static_cast<std::size_t>(thread)];
    if (index % options_.num_threads != thread) return {};
    const sim::DoomEnvironment& environment = *works_->slots[static_cast<std::size_t>(index)].environment;
    if (lane.painter == nullptr || lane.painter_width != width || lane.painter_height != height) {
      lane.painter.reset();
      COMRAD_TRY_ASSIGN(lane.painter, sim::make_renderer(environment.game(), options_.maps, {width, height}));
      lane.painter_width = width;
      lane.painter_height = height;
    }
    lane.views.clear();
    for (int agent = 0; agent < options_.num_agents; ++agent)
      lane.views.push_back(
          {&environment.world(), agent, pictures.data() + static_cast<std::size_t>(agent) * bytes});
    lane.painter->draw(lane.views);
    return {};
  });
  COMRAD_TRY(finish());
  return pictures;
}

}  // namespace comrad::python

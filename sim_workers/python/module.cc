// The extension module comrad._engine: environments as arrays, and the drawing of maps. comrad/*.py contains what
// Python users call. Stage: beside step, for Python.

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include <utility>

#include "rollout_buffer/settings/encoder_layers.h"
#include "scenarios/spec/registry.h"
#include "scenarios/spec/scenario_files.h"
#include "scenarios/spec/vizdoom_config.h"
#include "scenarios/spec/wad_maps.h"
#include "sim_workers/python/env_batch.h"

namespace nb = nanobind;

namespace comrad::python {
namespace {

/// Our errors as Python's: what was requested, what is not there, and the rest.
[[noreturn]] void raise(const Error& error) {
  switch (error.code) {
    case ErrorCode::kBadInput:
    case ErrorCode::kBadFormat:
      throw nb::value_error(error.message.c_str());
    case ErrorCode::kNotFound:
      PyErr_SetString(PyExc_FileNotFoundError, error.message.c_str());
      throw nb::python_error();
    default:
      throw std::runtime_error(error.message);
  }
}

template <typename T>
T must(Expected<T> result) {
  if (!result) raise(result.error());
  return std::move(*result);
}
void must(const Status& status) {
  if (!status) raise(status.error());
}

/// An array of the batch as NumPy sees it: no copy; it keeps the batch alive.
template <typename T>
nb::ndarray<nb::numpy, T> view(nb::handle batch, const std::vector<T>& values,
                               std::vector<std::size_t> shape) {
  return nb::ndarray<nb::numpy, T>(const_cast<T*>(values.data()), shape.size(), shape.data(), batch);
}

/// A dictionary of all arrays, by the names of BatchArrays.
nb::dict arrays_of(nb::handle self) {
  const auto& batch = nb::cast<const EnvBatch&>(self);
  const BatchOptions& options = batch.options();
  const BatchArrays& arrays = batch.arrays();
  const auto size = [](int value) { return static_cast<std::size_t>(value); };
  const std::size_t envs = size(options.num_envs), agents = size(options.num_agents);
  const std::size_t width = size(options.width), height = size(options.height);
  const std::size_t measurements = size(batch.shape().measurement_count);
  const std::vector<std::size_t> pictures = options.channels_first
                                                ? std::vector{envs, agents, std::size_t{3}, height, width}
                                                : std::vector{envs, agents, height, width, std::size_t{3}};
  nb::dict all;
  if (options.has_pictures) all["picture"] = view(self, arrays.picture, pictures);
  if (options.has_depth) all["depth"] = view(self, arrays.depth, {envs, agents, height, width});
  if (options.has_labels) all["labels"] = view(self, arrays.labels, {envs, agents, height, width});
  if (options.has_automap) all["automap"] = view(self, arrays.automap, pictures);
  all["measurement"] = view(self, arrays.measurement, {envs, agents, measurements});
  all["variable"] = view(self, arrays.variable, {envs, agents, measurements});
  all["action_mask"] = view(self, arrays.action_mask, {envs, agents, size(batch.shape().logit_count())});
  all["active"] = view(self, arrays.active, {envs, agents});
  all["state"] = view(self, arrays.state, {envs, batch.state_names().size()});
  all["reward"] = view(self, arrays.reward, {envs, agents});
  all["terminated"] = view(self, arrays.terminated, {envs});
  all["truncated"] = view(self, arrays.truncated, {envs});
  all["score"] = view(self, arrays.score, {envs});
  all["ceiling"] = view(self, arrays.ceiling, {envs});
  all["agent_return"] = view(self, arrays.agent_return, {envs, agents});
  all["length_tics"] = view(self, arrays.length_tics, {envs});
  all["length_steps"] = view(self, arrays.length_steps, {envs});
  all["episode_seed"] = view(self, arrays.episode_seed, {envs});
  all["stream_seed"] = view(self, arrays.stream_seed, {envs});
  all["episode_number"] = view(self, arrays.episode_number, {envs});
  return all;
}

std::unique_ptr<EnvBatch> make_batch(BatchOptions options) {
  Expected<std::unique_ptr<EnvBatch>> batch = Error{};
  {
    const nb::gil_scoped_release others_run;
    batch = EnvBatch::create(options);
  }
  return must(std::move(batch));
}

template <typename T>
std::span<const T> span_of(const nb::ndarray<const T, nb::c_contig, nb::device::cpu>& array) {
  return {array.data(), array.size()};
}

/// Runs `call` while other Python threads continue.
template <typename Call>
auto aside(Call call) {
  const nb::gil_scoped_release others_run;
  return call();
}

nb::dict scenario_facts(const scenarios::ScenarioSpec& spec, int num_agents) {
  nb::dict facts;
  facts["name"] = spec.name;
  facts["version"] = spec.version;
  facts["title"] = spec.title;
  facts["summary"] = spec.summary;
  facts["difficulty"] = spec.difficulty;
  facts["num_agents"] = num_agents;
  facts["supported_agents"] = spec.supported_agents;
  facts["limit_tics"] = spec.limit_tics();
  facts["score_unit"] = spec.score_unit;
  facts["is_vizdoom"] = spec.is_vizdoom;
  nb::list heads, measurements, rewards;
  for (const scenarios::ActionHead& head : spec.heads) heads.append(head.buttons);
  for (const scenarios::MeasurementTerm& term : spec.measurements) measurements.append(term.variable);
  for (const scenarios::RewardTerm& term : spec.rewards) rewards.append(term.name);
  facts["heads"] = heads;
  facts["measurements"] = measurements;
  facts["rewards"] = rewards;
  facts["score"] = spec.score;
  return facts;
}

/// What its .cfg requests, and what is not served.
void add_vizdoom_facts(nb::dict& facts, const scenarios::VizdoomConfig& config) {
  nb::list buffers;
  if (config.buffers.depth) buffers.append("depth");
  if (config.buffers.labels) buffers.append("labels");
  if (config.buffers.automap) buffers.append("automap");
  facts["buffers"] = buffers;
  facts["is_gray"] = config.buffers.gray;
  facts["names_map"] = config.map_line > 0;
  facts["warnings"] = config.warnings;
}

/// The map of a scenario: (bytes, "") of one that is drawn, (b"", path) of one that the scenario brings along.
nb::tuple draw_map(const std::string& scenario, uint64_t seed, int num_agents,
                   std::vector<std::pair<std::string, std::string>> parameters) {
  const scenarios::GeneratedLayout layout = must(aside([&] {
    return scenarios::generate_layout(
        scenario, {.seed = seed, .num_agents = num_agents, .parameters = std::move(parameters)});
  }));
  const bool is_drawn = layout.file.empty();
  return nb::make_tuple(nb::bytes(layout.wad.data(), is_drawn ? layout.wad.size() : 0), layout.file);
}

}  // namespace
}  // namespace comrad::python

// NOLINTNEXTLINE(readability-identifier-naming): nanobind's macro names it
NB_MODULE(_engine, module) {
  using namespace comrad;
  using namespace comrad::python;

  // Warnings of scenarios and maps go where Python's own go, and nothing else is said.
  auto log = std::make_shared<spdlog::logger>("comrad", std::make_shared<spdlog::sinks::stderr_sink_mt>());
  log->set_level(spdlog::level::warn);
  log->set_pattern("comrad: %l: %v");
  spdlog::set_default_logger(std::move(log));

  nb::class_<SavedState>(module, "SavedState").def("hash", &SavedState::hash);

  nb::class_<EnvBatch>(module, "EnvBatch")
      .def(nb::new_([](std::string scenario, std::vector<std::string> maps, int num_agents, int frame_skip,
                       int num_envs, int num_threads, int width, int height, bool pictures, bool depth,
                       bool labels, bool automap, std::string automap_mode, bool channels_first,
                       bool autoreset, bool by_buttons, std::string reward, std::string heads) {
             return make_batch({.scenario = std::move(scenario),
                                .maps = std::move(maps),
                                .num_agents = num_agents,
                                .frame_skip = frame_skip,
                                .num_envs = num_envs,
                                .num_threads = num_threads,
                                .width = width,
                                .height = height,
                                .has_pictures = pictures,
                                .has_depth = depth,
                                .has_labels = labels,
                                .has_automap = automap,
                                .automap_mode = std::move(automap_mode),
                                .channels_first = channels_first,
                                .autoreset = autoreset,
                                .by_buttons = by_buttons,
                                .reward = std::move(reward),
                                .heads = std::move(heads)});
           }),
           nb::kw_only(), nb::arg("scenario"), nb::arg("maps"), nb::arg("num_agents") = 0,
           nb::arg("frame_skip") = 4, nb::arg("num_envs") = 1, nb::arg("num_threads") = 1,
           nb::arg("width") = 128, nb::arg("height") = 72, nb::arg("pictures") = true,
           nb::arg("depth") = false, nb::arg("labels") = false, nb::arg("automap") = false,
           nb::arg("automap_mode") = "", nb::arg("channels_first") = false, nb::arg("autoreset") = false,
           nb::arg("by_buttons") = false, nb::arg("reward") = "", nb::arg("heads") = "")
      .def("arrays", &arrays_of)
      .def("facts",
           [](const EnvBatch& batch) { return scenario_facts(batch.spec(), batch.options().num_agents); })
      .def("head_sizes",
           [](const EnvBatch& batch) {
             const auto& sizes = batch.shape().head_sizes;
             return std::vector<int>(sizes.begin(), sizes.begin() + batch.shape().head_count);
           })
      .def("state_names", &EnvBatch::state_names)
      .def("button_names", &EnvBatch::button_names)
      .def("reset",
           [](EnvBatch& batch,
              const std::vector<std::optional<std::pair<uint64_t, std::optional<uint64_t>>>>& episodes) {
             std::vector<std::optional<EpisodeKey>> keys;
             for (const auto& one : episodes)
               keys.push_back(one ? std::optional(EpisodeKey{one->first, one->second}) : std::nullopt);
             must(aside([&] { return batch.reset(keys); }));
           })
      .def("send",
           [](EnvBatch& batch, const nb::ndarray<const int32_t, nb::c_contig, nb::device::cpu>& actions) {
             must(aside([&] { return batch.send(span_of(actions)); }));
           })
      .def("send_buttons",
           [](EnvBatch& batch, const nb::ndarray<const float, nb::c_contig, nb::device::cpu>& actions) {
             must(aside([&] { return batch.send_buttons(span_of(actions)); }));
           })
      .def("receive", [](EnvBatch& batch) { must(aside([&] { return batch.receive(); })); })
      .def("send_some",
           [](EnvBatch& batch, const std::vector<int>& indices,
              const nb::ndarray<const int32_t, nb::c_contig, nb::device::cpu>& actions) {
             must(aside([&] { return batch.send_some(indices, span_of(actions)); }));
           })
      .def("receive_some",
           [](EnvBatch& batch, int least) { return must(aside([&] { return batch.receive_some(least); })); })
      .def("get_state",
           [](EnvBatch& batch, int index) {
             // Python's own type is of a writable state; nothing writes it.
             return std::const_pointer_cast<SavedState>(must(aside([&] { return batch.state_of(index); })));
           })
      .def("set_state",
           [](EnvBatch& batch, int index, const SavedState& state) {
             must(aside([&] { return batch.restore(index, state); }));
           })
      .def("labels",
           [](EnvBatch& batch, int index, int agent) {
             nb::list seen;
             for (const SeenThing& thing : must(batch.things_seen(index, agent))) {
               const doom::ThingLabel& label = thing.label;
               seen.append(nb::make_tuple(label.value, label.actor_id, thing.name, label.left, label.top,
                                          label.right - label.left, label.bottom - label.top, thing.x,
                                          thing.y, thing.z, thing.angle_degrees, thing.velocity_x,
                                          thing.velocity_y, thing.velocity_z));
             }
             return seen;
           })
      .def("hash", [](EnvBatch& batch, int index) { return must(batch.hash_of(index)); })
      .def("draw",
           [](EnvBatch& batch, int index, int width, int height) {
             const std::vector<uint8_t> planes =
                 must(aside([&] { return batch.draw(index, width, height); }));
             auto* copy = new std::vector<uint8_t>(planes);
             const nb::capsule owner(
                 copy, [](void* data) noexcept { delete static_cast<std::vector<uint8_t>*>(data); });
             const std::size_t shape[] = {static_cast<std::size_t>(batch.options().num_agents), 3,
                                          static_cast<std::size_t>(height), static_cast<std::size_t>(width)};
             return nb::ndarray<nb::numpy, uint8_t>(copy->data(), 4, shape, owner);
           })
      .def("close", [](EnvBatch& batch) { must(aside([&] { return batch.close(); })); })
      .def("is_closed", &EnvBatch::is_closed);

  module.def("draw_map", &draw_map, nb::arg("scenario"), nb::arg("seed"), nb::arg("num_agents"),
             nb::arg("parameters"));
  module.def("split_wad", [](const std::string& path, const std::string& folder) {
    std::vector<std::string> files;
    for (const scenarios::PoolEntry& entry : must(aside([&] { return scenarios::split_wad(path, folder); })))
      files.push_back(folder + "/" + entry.filename);
    return files;
  });
  module.def("list_scenarios", &scenarios::list_scenarios);
  module.def("encoder_layers", [](const std::string& encoder) {
    std::vector<std::string> layers;
    for (const EncoderLayer& layer : must(parse_encoder(encoder))) layers.push_back(layer.text());
    return layers;
  });
  module.def("describe", [](const std::string& scenario) {
    const scenarios::ScenarioSpec spec = must(scenarios::load_scenario(scenario));
    nb::dict facts = scenario_facts(spec, spec.default_agents);
    if (spec.is_vizdoom) add_vizdoom_facts(facts, must(scenarios::load_vizdoom_config(scenario)));
    return facts;
  });
}

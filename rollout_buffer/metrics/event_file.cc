#include "rollout_buffer/metrics/event_file.h"

#include <spdlog/fmt/fmt.h>

#include <fcntl.h>
#include <unistd.h>

#include <array>

#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/host_name.h"
#include "tensorboard_event.pb.h"

namespace comrad {
namespace {

constexpr std::array<uint32_t, 256> make_crc_table() {
  std::array<uint32_t, 256> table{};
  for (uint32_t i = 0; i < 256; ++i) {
    uint32_t crc = i;
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ (crc & 1 ? 0x82F63B78u : 0u);
    table[i] = crc;
  }
  return table;
}

constexpr std::array<uint32_t, 256> kCrcTable = make_crc_table();

template <typename Integer>
void append_little_endian(std::string& out, Integer value) {
  for (std::size_t i = 0; i < sizeof(value); ++i) out.push_back(static_cast<char>((value >> (8 * i)) & 0xFF));
}

/// An event that carries `data` for the HPARAMS page under its tag.
tensorboard::Event hparams_event(double wall_time_s, const char* tag, const tensorboard::HparamsData& data) {
  tensorboard::Event event;
  event.set_wall_time(wall_time_s);
  tensorboard::Summary::Value* entry = event.mutable_summary()->add_value();
  entry->set_tag(tag);
  entry->mutable_tensor()->set_dtype(1);
  entry->mutable_tensor()->mutable_tensor_shape()->add_dim();  // of size 0: there is no element
  tensorboard::Metadata::PluginData* plugin = entry->mutable_metadata()->mutable_plugin_data();
  plugin->set_plugin_name("hparams");
  plugin->set_content(data.SerializeAsString());
  return event;
}

tensorboard::HparamsData columns_of(const std::vector<Hparam>& settings,
                                    const std::vector<HparamMetric>& metrics) {
  tensorboard::HparamsData data;
  tensorboard::Experiment* columns = data.mutable_experiment();
  for (const Hparam& setting : settings) {
    tensorboard::Experiment::Hparam* column = columns->add_hparam_infos();
    column->set_name(setting.name);
    column->set_type(1 + static_cast<int>(setting.value.index()));
    column->set_differs(setting.leads);
  }
  for (const HparamMetric& metric : metrics) {
    tensorboard::Experiment::Metric* column = columns->add_metric_infos();
    column->mutable_name()->set_group(metric.below);
    column->mutable_name()->set_tag(metric.tag);
    column->set_display_name(metric.title);
  }
  return data;
}

tensorboard::HparamsData row_of(double wall_time_s, const std::vector<Hparam>& settings) {
  tensorboard::HparamsData data;
  tensorboard::SessionStart* row = data.mutable_session_start_info();
  row->set_start_time_secs(wall_time_s);
  for (const Hparam& setting : settings) {
    if (!setting.has_value) continue;
    tensorboard::SessionStart::Value& value = (*row->mutable_hparams())[setting.name];
    if (const auto* text = std::get_if<std::string>(&setting.value)) value.set_string_value(*text);
    if (const auto* yes = std::get_if<bool>(&setting.value)) value.set_bool_value(*yes);
    if (const auto* number = std::get_if<double>(&setting.value)) value.set_number_value(*number);
  }
  return data;
}

}  // namespace

uint32_t masked_crc32c(std::string_view bytes) {
  uint32_t crc = 0xFFFFFFFFu;
  for (const char c : bytes) crc = (crc >> 8) ^ kCrcTable[(crc ^ static_cast<unsigned char>(c)) & 0xFF];
  crc = ~crc;
  return ((crc >> 15) | (crc << 17)) + 0xA282EAD8u;
}

std::string frame_record(std::string_view bytes) {
  std::string record;
  append_little_endian(record, static_cast<uint64_t>(bytes.size()));
  append_little_endian(record, masked_crc32c(record));
  record.append(bytes);
  append_little_endian(record, masked_crc32c(bytes));
  return record;
}

Expected<EventFile> EventFile::create(const std::string& folder) {
  const double now = wall_s();
  const std::string path = fmt::format("{}/events.out.tfevents.{}.{}.{}.0", folder, static_cast<int64_t>(now),
                                       host_name(), getpid());
  const int descriptor = open(path.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
  if (descriptor < 0) return system_error("cannot create " + path);
  EventFile file(descriptor, path);
  tensorboard::Event version;
  version.set_wall_time(now);
  version.set_file_version("brain.Event:2");
  COMRAD_TRY(write_all(descriptor, frame_record(version.SerializeAsString()), path));
  return file;
}

EventFile::EventFile(EventFile&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)), path_(std::move(other.path_)) {}

EventFile& EventFile::operator=(EventFile&& other) noexcept {
  std::swap(descriptor_, other.descriptor_);
  std::swap(path_, other.path_);
  return *this;
}

EventFile::~EventFile() {
  if (descriptor_ >= 0) close(descriptor_);
}

Status EventFile::write_start(double wall_time_s, int64_t step) {
  tensorboard::Event event;
  event.set_wall_time(wall_time_s);
  event.set_step(step);
  event.mutable_session_log()->set_status(tensorboard::SessionLog::START);
  return write_all(descriptor_, frame_record(event.SerializeAsString()), path_);
}

Status EventFile::write(double wall_time_s, int64_t step,
                        const std::vector<std::pair<std::string, double>>& values) {
  tensorboard::Event event;
  event.set_wall_time(wall_time_s);
  event.set_step(step);
  for (const auto& [tag, value] : values) {
    tensorboard::Summary::Value* entry = event.mutable_summary()->add_value();
    entry->set_tag(tag);
    entry->set_simple_value(static_cast<float>(value));
  }
  return write_all(descriptor_, frame_record(event.SerializeAsString()), path_);
}

Status EventFile::write_gif(double wall_time_s, int64_t step, const std::string& tag,
                            const std::string& gif) {
  constexpr std::size_t kHeadBytes = 10;  // "GIF89a", then width and height, u16 LE each
  if (gif.size() < kHeadBytes || !gif.starts_with("GIF8"))
    return Error{ErrorCode::kBadFormat, "the video " + tag + " is no GIF"};
  const auto u16 = [&gif](std::size_t at) {
    return static_cast<uint8_t>(gif[at]) | static_cast<uint8_t>(gif[at + 1]) << 8;
  };
  tensorboard::Event event;
  event.set_wall_time(wall_time_s);
  event.set_step(step);
  tensorboard::Summary::Value* entry = event.mutable_summary()->add_value();
  entry->set_tag(tag);
  entry->mutable_image()->set_width(u16(6));
  entry->mutable_image()->set_height(u16(8));
  entry->mutable_image()->set_colorspace(3);
  entry->mutable_image()->set_encoded_image_string(gif);
  return write_all(descriptor_, frame_record(event.SerializeAsString()), path_);
}

Status EventFile::write_hparams(double wall_time_s, const std::vector<Hparam>& settings,
                                const std::vector<HparamMetric>& metrics) {
  for (const tensorboard::Event& event :
       {hparams_event(wall_time_s, "_hparams_/experiment", columns_of(settings, metrics)),
        hparams_event(wall_time_s, "_hparams_/session_start_info", row_of(wall_time_s, settings))})
    COMRAD_TRY(write_all(descriptor_, frame_record(event.SerializeAsString()), path_));
  return {};
}

}  // namespace comrad

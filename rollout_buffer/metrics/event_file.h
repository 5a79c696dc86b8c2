// A TensorBoard event file: scalars and videos over steps and the settings of a run, framed records with masked CRC32C. Stage: beside
// update, for eyes.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad {

/// CRC-32C (Castagnoli, reflected polynomial 0x82F63B78) as TFRecord stores it: rotated right by 15, plus
/// a constant.
uint32_t masked_crc32c(std::string_view bytes);

/// One record: length u64 LE, masked CRC of the length, bytes, masked CRC of the bytes.
std::string frame_record(std::string_view bytes);

/// A setting as a column of TensorBoard's HPARAMS page.
struct Hparam {
  std::string name;
  std::variant<std::string, bool, double> value;
  bool has_value = true;  ///< false: this run leaves the column empty
  bool leads = false;     ///< its column stands before the others
};

/// A number as a column there: the newest value of `tag` in the file's folder, or in the folder `below` of it.
struct HparamMetric {
  std::string tag, title, below;
};

/// Appends events to its own file. Move-only.
class EventFile {
 public:
  /// Makes <folder>/events.out.tfevents.<seconds>.<host>.<pid>.0 with its version record.
  /// Errors: kSystem, kNoSpace.
  static Expected<EventFile> create(const std::string& folder);
  EventFile(EventFile&& other) noexcept;
  EventFile& operator=(EventFile&& other) noexcept;
  ~EventFile();

  /// Adds the event by which readers forget what older files of the folder hold of `step` and later ones. Before the
  /// first write(). Errors: kSystem, kNoSpace.
  Status write_start(double wall_time_s, int64_t step);
  /// Adds one event with all `values` at `step`. Errors: kSystem, kNoSpace.
  Status write(double wall_time_s, int64_t step, const std::vector<std::pair<std::string, double>>& values);
  /// Adds one event with a video, the bytes of a GIF file. Errors: kBadFormat where they are none; kSystem, kNoSpace.
  Status write_gif(double wall_time_s, int64_t step, const std::string& tag, const std::string& gif);
  /// Adds the row of this run to the HPARAMS page, and the page's columns. TensorBoard names the row by the
  /// file's folder. Before the first write(). Errors: kSystem, kNoSpace.
  Status write_hparams(double wall_time_s, const std::vector<Hparam>& settings,
                       const std::vector<HparamMetric>& metrics);
  const std::string& path() const { return path_; }

 private:
  EventFile(int descriptor, std::string path) : descriptor_(descriptor), path_(std::move(path)) {}
  int descriptor_ = -1;
  std::string path_;
};

}  // namespace comrad

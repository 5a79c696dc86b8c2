#include "learner/checkpoint/checkpoint.h"

#include <caffe2/serialize/inline_container.h>
#include <fcntl.h>
#include <spdlog/fmt/fmt.h>
#include <sys/stat.h>
#include <torch/csrc/jit/serialization/pickle.h>
#include <torch/csrc/jit/serialization/pickler.h>
#include <unistd.h>
#include <zip.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <memory>
#include <string_view>

#include "policy_workers/device/shape_text.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/take_number.h"
#include "rollout_buffer/core/text.h"

namespace comrad::learn {
namespace {

namespace fs = std::filesystem;

constexpr const char* kFormatName = "comrad-checkpoint";
constexpr int64_t kFileBytesMax = int64_t{64} << 30;
constexpr zip_uint32_t kFolderAttribute = 0x10;  // of MS-DOS
constexpr const char* kBrokenMark = ".broken";
/// Sections whose tensors a network computes with: one NaN there makes every later number one.
constexpr std::string_view kFiniteSections[] = {"network", "optimizer", "normalizer",
                                                "target",  "mixer",     "target_mixer"};

/// A file descriptor that closes itself.
class Descriptor {
 public:
  explicit Descriptor(int descriptor) : descriptor_(descriptor) {}
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  ~Descriptor() {
    if (descriptor_ >= 0) close(descriptor_);
  }
  int get() const { return descriptor_; }

 private:
  int descriptor_;
};

Error missing(const std::string& key, const char* kind) {
  return Error{ErrorCode::kBadFormat, "checkpoint has no " + std::string(kind) + " \"" + key + "\""};
}

c10::IValue to_ivalue(const StateDict::Value& value) {
  if (const auto* tensor = std::get_if<torch::Tensor>(&value)) return *tensor;
  if (const auto* integer = std::get_if<int64_t>(&value)) return *integer;
  if (const auto* number = std::get_if<double>(&value)) return *number;
  return std::get<std::string>(value);
}

Expected<StateDict> from_ivalue(const c10::IValue& root, const std::string& path) {
  const auto foreign = [&](const std::string& why) {
    return Error{ErrorCode::kBadFormat, path + ": not a COMRAD checkpoint (" + why + ")"};
  };
  if (!root.isGenericDict()) return foreign("no dict at the top");
  StateDict state;
  bool has_format = false;
  int64_t version = 0;
  for (const auto& entry : root.toGenericDict()) {
    if (!entry.key().isString()) return foreign("a key is no text");
    const std::string section = entry.key().toStringRef();
    if (section == "format" && entry.value().isString()) {
      has_format = entry.value().toStringRef() == kFormatName;
    } else if (section == "layout_version" && entry.value().isInt()) {
      version = entry.value().toInt();
    } else if (entry.value().isGenericDict()) {
      for (const auto& item : entry.value().toGenericDict()) {
        if (!item.key().isString()) return foreign("a key is no text");
        const std::string key = section + "/" + item.key().toStringRef();
        if (item.value().isTensor()) state.put(key, item.value().toTensor());
        if (item.value().isInt()) state.put(key, item.value().toInt());
        if (item.value().isDouble()) state.put(key, item.value().toDouble());
        if (item.value().isString()) state.put(key, item.value().toStringRef());
      }
    }
  }
  if (!has_format) return foreign("its \"format\" is not " + std::string(kFormatName));
  if (version < 1 || version > kCheckpointVersion)
    return Error{ErrorCode::kUnsupported,
                 fmt::format("{}: checkpoint version {}, this build reads 1..{}; use a newer build", path,
                             version, kCheckpointVersion)};
  return state;
}

/// Reads every file of the archive once, because libtorch does not look at their CRC-32.
Status check_archive(const std::vector<char>& bytes, const std::string& path) {
  const auto damaged = [&](zip_error_t* error) {
    const std::string why = zip_error_strerror(error);
    zip_error_fini(error);
    return Error{ErrorCode::kBadFormat, path + ": truncated or damaged torch archive (" + why + ")"};
  };
  zip_error_t error;
  zip_error_init(&error);
  zip_source_t* source = zip_source_buffer_create(bytes.data(), bytes.size(), /*freep=*/0, &error);
  if (source == nullptr) return damaged(&error);
  const std::unique_ptr<zip_t, decltype(&zip_discard)> archive(
      zip_open_from_source(source, ZIP_RDONLY | ZIP_CHECKCONS, &error), &zip_discard);
  if (archive == nullptr) {
    zip_source_free(source);
    return damaged(&error);
  }
  std::vector<char> block(1 << 20);
  const zip_int64_t count = zip_get_num_entries(archive.get(), 0);
  for (zip_int64_t entry = 0; entry < count; ++entry) {
    const zip_uint64_t index = static_cast<zip_uint64_t>(entry);
    // libtorch reads nothing of an entry that calls itself a folder, and takes what memory holds for its bytes.
    zip_uint8_t system = 0;
    zip_uint32_t attributes = 0;
    if (zip_file_get_external_attributes(archive.get(), index, 0, &system, &attributes) != 0 ||
        (attributes & kFolderAttribute) != 0)
      return Error{ErrorCode::kBadFormat,
                   path + ": truncated or damaged torch archive (an entry is no file)"};
    zip_file_t* file = zip_fopen_index(archive.get(), index, 0);
    if (file == nullptr) return damaged(zip_get_error(archive.get()));
    zip_int64_t got = 0;
    while ((got = zip_fread(file, block.data(), block.size())) > 0) {
    }
    if (got < 0) {
      Error failed = damaged(zip_file_get_error(file));
      zip_fclose(file);
      return failed;
    }
    zip_fclose(file);
  }
  return {};
}

/// Errors: kBadFormat naming the first tensor of a network that holds an infinity or NaN.
Status check_finite(const StateDict& state, const std::string& path) {
  for (const auto& [key, value] : state.values()) {
    const auto* tensor = std::get_if<torch::Tensor>(&value);
    const std::string_view section = std::string_view(key).substr(0, key.find('/'));
    if (tensor == nullptr || !tensor->is_floating_point() ||
        std::ranges::find(kFiniteSections, section) == std::end(kFiniteSections))
      continue;
    if (!torch::isfinite(*tensor).all().item<bool>())
      return Error{ErrorCode::kBadFormat,
                   path + ": tensor \"" + key +
                       "\" holds numbers that are not finite; the file is damaged, or was "
                       "written by a run that diverged"};
  }
  return {};
}

/// A torch archive of `root`, as pickle_save writes it but without type tags: those name a Python function
/// that torch.load(..., weights_only=True) refuses to call.
std::vector<char> pack(const c10::IValue& root) {
  std::string pickled;
  torch::jit::Pickler pickler(
      [&pickled](const char* bytes, std::size_t count) { pickled.append(bytes, count); }, nullptr, nullptr,
      nullptr, nullptr, /*tag_aggregates=*/false);
  pickler.protocol();
  pickler.pushIValue(root);
  pickler.stop();
  std::vector<char> archive;
  caffe2::serialize::PyTorchStreamWriter writer([&archive](const void* bytes, std::size_t count) {
    const char* first = static_cast<const char*>(bytes);
    archive.insert(archive.end(), first, first + count);
    return count;
  });
  int64_t index = 0;
  for (const torch::Tensor& tensor : pickler.tensorData()) {
    const auto data = torch::jit::getWriteableTensorData(tensor);
    writer.writeRecord(fmt::format("data/{}", index++), data.data(), data.sizeInBytes());
  }
  writer.writeRecord("data.pkl", pickled.data(), pickled.size());
  writer.writeEndOfFile();
  return archive;
}

}  // namespace

void StateDict::put(const std::string& key, const torch::Tensor& tensor) {
  torch::NoGradGuard no_grad;
  values_[key] = tensor.detach()
                     .to(torch::kCPU, tensor.scalar_type(), /*non_blocking=*/false, /*copy=*/true)
                     .contiguous();
}

Expected<torch::Tensor> StateDict::tensor(const std::string& key) const {
  const auto found = values_.find(key);
  if (found == values_.end() || !std::holds_alternative<torch::Tensor>(found->second))
    return missing(key, "tensor");
  return std::get<torch::Tensor>(found->second);
}

Expected<int64_t> StateDict::integer(const std::string& key) const {
  const auto found = values_.find(key);
  if (found == values_.end() || !std::holds_alternative<int64_t>(found->second))
    return missing(key, "integer");
  return std::get<int64_t>(found->second);
}

Expected<double> StateDict::number(const std::string& key) const {
  const auto found = values_.find(key);
  if (found == values_.end() || !std::holds_alternative<double>(found->second)) return missing(key, "number");
  return std::get<double>(found->second);
}

Expected<std::string> StateDict::text(const std::string& key) const {
  const auto found = values_.find(key);
  if (found == values_.end() || !std::holds_alternative<std::string>(found->second))
    return missing(key, "text");
  return std::get<std::string>(found->second);
}

Status StateDict::copy_tensor(const std::string& key, torch::Tensor target) const {
  COMRAD_TRY_ASSIGN(const torch::Tensor source, tensor(key));
  if (source.sizes() != target.sizes() || source.scalar_type() != target.scalar_type())
    return Error{ErrorCode::kBadFormat, "checkpoint tensor \"" + key + "\" is " + device::shape_text(source) +
                                            ", this run needs " + device::shape_text(target) +
                                            "; was it made with another model or scenario?"};
  torch::NoGradGuard no_grad;
  target.copy_(source);
  return {};
}

Status write_checkpoint(const std::string& path, const StateDict& state) {
  std::vector<char> bytes;
  try {
    using Section = c10::impl::GenericDict;
    std::map<std::string, Section> sections;
    for (const auto& [key, value] : state.values()) {
      const std::size_t slash = key.find('/');
      COMRAD_CHECK(slash != std::string::npos, "checkpoint keys are spelled section/name");
      const auto section =
          sections.try_emplace(key.substr(0, slash), Section(c10::StringType::get(), c10::AnyType::get()))
              .first;
      section->second.insert(key.substr(slash + 1), to_ivalue(value));
    }
    Section root(c10::StringType::get(), c10::AnyType::get());
    root.insert("format", std::string(kFormatName));
    root.insert("layout_version", kCheckpointVersion);
    for (const auto& [name, section] : sections) root.insert(name, section);
    bytes = pack(root);
  } catch (const std::exception& error) {
    return Error{ErrorCode::kSystem, "cannot pack checkpoint " + path + ": " + error.what()};
  }

  return write_file_atomically(path, {bytes.data(), bytes.size()}, /*durable=*/true);
}

namespace {

constexpr int64_t kRoundedFrom = 1024;  // numbers: matrices, and statistics of pixels
constexpr int kBitsOfWeights = 7, kBitsOfStatistics = 12;

torch::Tensor with_significant_bits(const torch::Tensor& x, int bits) {
  const auto [mantissa, exponent] = torch::frexp(x);  // |mantissa| in [0.5, 1)
  const double steps = 1 << bits;
  return torch::ldexp(torch::round(mantissa * steps) / steps, exponent);
}

}  // namespace

Status write_to_be_played(const std::string& from, const std::string& to, const std::string& settings) {
  COMRAD_TRY_ASSIGN(const StateDict whole, read_checkpoint(from));
  StateDict kept;
  for (const auto& [key, value] : whole.values()) {
    const auto* const tensor = std::get_if<torch::Tensor>(&value);
    if (tensor != nullptr && key.starts_with("optimizer/"))
      kept.put(key, torch::zeros_like(*tensor));
    else if (tensor != nullptr && tensor->is_floating_point() && tensor->numel() >= kRoundedFrom)
      kept.put(key,
               with_significant_bits(
                   *tensor, tensor->scalar_type() == torch::kFloat64 ? kBitsOfStatistics : kBitsOfWeights));
    else
      std::visit([&](const auto& same) { kept.put(key, same); }, value);
  }
  kept.put("config/toml", settings);
  return write_checkpoint(to, kept);
}

Expected<StateDict> read_checkpoint(const std::string& path) {
  // Not to wait for the writer of a pipe that lies there under a checkpoint's name.
  const Descriptor file(open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (file.get() < 0) {
    if (errno == ENOENT) return Error{ErrorCode::kNotFound, "no checkpoint at " + path};
    return file_error("cannot open " + path, errno);
  }
  struct stat information {};
  if (fstat(file.get(), &information) != 0) return file_error("cannot stat " + path, errno);
  if (!S_ISREG(information.st_mode)) return Error{ErrorCode::kBadFormat, path + ": not a regular file"};
  if (information.st_size > kFileBytesMax)
    return Error{ErrorCode::kBadFormat, path + ": too large for a checkpoint"};
  std::vector<char> bytes(static_cast<std::size_t>(information.st_size));
  std::size_t have = 0;
  while (have < bytes.size()) {
    const ssize_t count = read(file.get(), bytes.data() + have, bytes.size() - have);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) return file_error("cannot read " + path, errno);
    if (count == 0) break;
    have += static_cast<std::size_t>(count);
  }
  if (have < bytes.size()) return Error{ErrorCode::kBadFormat, path + ": shrank while it was read"};
  // A torch archive is a zip; anything else would only produce a long message from deep inside libtorch.
  if (bytes.size() < 4 || std::memcmp(bytes.data(), "PK\x03\x04", 4) != 0)
    return Error{ErrorCode::kBadFormat, path + ": not a torch archive"};
  COMRAD_TRY(check_archive(bytes, path));
  try {
    COMRAD_TRY_ASSIGN(StateDict state, from_ivalue(torch::jit::pickle_load(bytes), path));
    COMRAD_TRY(check_finite(state, path));
    return state;
  } catch (const c10::Error& error) {
    return Error{ErrorCode::kBadFormat,
                 path + ": truncated or damaged torch archive (" + error.what_without_backtrace() + ")"};
  } catch (const std::exception& error) {
    return Error{ErrorCode::kBadFormat, path + ": truncated or damaged torch archive (" + error.what() + ")"};
  }
}

CheckpointStore::CheckpointStore(std::string folder, int64_t keep)
    : folder_(std::move(folder)), keep_(std::max<int64_t>(1, keep)) {}

Status CheckpointStore::prepare_folder() {
  if (is_prepared_) return {};
  std::error_code code;
  fs::create_directories(folder_, code);
  if (code) return Error{ErrorCode::kSystem, "cannot make folder " + folder_ + ": " + code.message()};
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_, code)) {
    std::error_code ignored;
    if (entry.path().filename().string().starts_with(kHalfWrittenMark)) fs::remove(entry.path(), ignored);
  }
  is_prepared_ = true;
  return {};
}

std::string checkpoint_file_name(const std::string& name, uint64_t version, uint64_t env_frames) {
  char numbers[64];
  std::snprintf(numbers, sizeof(numbers), "_%09llu_%llu.pt", static_cast<unsigned long long>(version),
                static_cast<unsigned long long>(env_frames));
  return name + numbers;
}

Expected<std::string> CheckpointStore::save_beside(const StateDict& state, const std::string& file) {
  COMRAD_TRY(prepare_folder());
  std::string path = folder_ + "/" + file;
  COMRAD_TRY(write_checkpoint(path, state));
  return path;
}

Expected<std::string> CheckpointStore::save(const StateDict& state, uint64_t version, uint64_t env_frames) {
  COMRAD_TRY_ASSIGN(std::string path,
                    save_beside(state, checkpoint_file_name("checkpoint", version, env_frames)));
  const std::vector<CheckpointFile> files = list();
  for (std::size_t i = static_cast<std::size_t>(keep_); i < files.size(); ++i) {
    std::error_code ignored;
    if (files[i].path != path) fs::remove(files[i].path, ignored);
  }
  return path;
}

Expected<std::string> CheckpointStore::save_best(const StateDict& state, double score) {
  COMRAD_TRY(prepare_folder());
  char name[64];
  std::snprintf(name, sizeof(name), "best_%.3f.pt", score);
  const std::string path = folder_ + "/" + name;
  COMRAD_TRY(write_checkpoint(path, state));
  std::error_code code;
  std::vector<fs::path> older;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_, code)) {
    const std::string file = entry.path().filename().string();
    if (file.starts_with("best_") && file.ends_with(".pt") && file != name) older.push_back(entry.path());
  }
  for (const fs::path& file : older) fs::remove(file, code);
  return path;
}

std::vector<CheckpointFile> CheckpointStore::list() const {
  std::vector<CheckpointFile> files;
  std::error_code code;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_, code)) {
    const std::string name = entry.path().filename().string();
    std::string_view rest = name;
    CheckpointFile file{.path = entry.path().string()};
    if (take_number(rest, "checkpoint_", file.version) && take_number(rest, "_", file.env_frames) &&
        rest == ".pt")
      files.push_back(std::move(file));
  }
  std::sort(files.begin(), files.end(), [](const CheckpointFile& a, const CheckpointFile& b) {
    return std::pair(a.env_frames, a.version) > std::pair(b.env_frames, b.version);
  });
  return files;
}

std::string CheckpointStore::best() const {
  std::string path;
  double best_score = 0;
  std::error_code code;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_, code)) {
    const std::string name = entry.path().filename().string();
    if (!name.starts_with("best_") || !name.ends_with(".pt")) continue;
    const std::string digits = name.substr(5, name.size() - 8);
    double score = 0;
    const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), score);
    if (error != std::errc() || end != digits.data() + digits.size()) continue;
    if (path.empty() || score > best_score) {
      path = entry.path().string();
      best_score = score;
    }
  }
  return path;
}

std::size_t CheckpointStore::set_aside_count() const {
  std::size_t count = 0;
  std::error_code code;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_, code))
    count += entry.path().filename().string().ends_with(std::string(".pt") + kBrokenMark);
  return count;
}

void CheckpointStore::set_aside(const std::string& path) const {
  std::error_code code;
  fs::rename(path, path + kBrokenMark, code);
  if (code) spdlog::warn("cannot set {} aside: {}", path, code.message());
}

}  // namespace comrad::learn

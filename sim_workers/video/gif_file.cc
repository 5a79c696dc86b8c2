#include "sim_workers/video/gif_file.h"

#include <fcntl.h>
#include <gif_lib.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <utility>

#include "rollout_buffer/core/check.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/schema/version.h"

namespace comrad::sim {
namespace {

constexpr std::size_t kCountedColours = 1 << 15;
constexpr std::size_t kColours = 127;  // and the transparent one; 255 made files a third larger
constexpr int kTransparent = static_cast<int>(kColours);
constexpr std::size_t kGroupBytes = 64u << 20;
constexpr int kUnseenDistance = 3 * 14 * 14;  // squared; colours so close are one

std::size_t counted(const cv::Vec3b& colour) {
  return static_cast<std::size_t>(colour[0] >> 3) << 10 | static_cast<std::size_t>(colour[1] >> 3) << 5 |
         static_cast<std::size_t>(colour[2] >> 3);
}

int distance(const cv::Vec3b& a, const cv::Vec3b& b) {
  const int blue = a[0] - b[0], green = a[1] - b[1], red = a[2] - b[2];
  return blue * blue + green * green + red * red;
}

/// Colours of a part of the cube, with how often each was seen.
struct Box {
  struct Colour {
    cv::Vec3b value;
    uint64_t count;
  };
  std::span<Colour> colours;
  int axis = 0;       ///< along which it is longest
  double spread = 0;  ///< sum of squared distances from the mean along `axis`
  cv::Vec3b mean = {};

  explicit Box(std::span<Colour> members) : colours(members) {
    double sum[3] = {}, squares[3] = {}, total = 0;
    for (const Colour& colour : colours)
      for (int i = 0; i < 3; ++i) {
        const double value = colour.value[i], weight = static_cast<double>(colour.count);
        sum[i] += weight * value, squares[i] += weight * value * value;
        if (i == 0) total += weight;
      }
    for (int i = 0; i < 3; ++i) {
      mean[i] = static_cast<uint8_t>(std::lround(sum[i] / total));
      if (const double along = squares[i] - sum[i] * sum[i] / total; along > spread) spread = along, axis = i;
    }
  }
  bool can_be_cut() const { return colours.size() > 1 && spread > 0; }
  /// The members below and above the mean.
  std::pair<Box, Box> cut() const {
    const auto above = std::ranges::partition(
        colours, [&](const Colour& colour) { return colour.value[axis] <= mean[axis]; });
    const std::size_t below = std::clamp<std::size_t>(colours.size() - above.size(), 1, colours.size() - 1);
    return {Box(colours.first(below)), Box(colours.subspan(below))};
  }
};

}  // namespace

std::vector<cv::Vec3b> choose_palette(std::span<const uint32_t> counts, std::size_t colours_max) {
  COMRAD_CHECK(counts.size() == kCountedColours, "five bits of each of three channels are counted");
  std::vector<Box::Colour> colours;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    if (counts[i] == 0) continue;
    const auto channel = [&](int shift) { return static_cast<uint8_t>((i >> shift & 31) << 3 | 4); };
    colours.push_back({{channel(10), channel(5), channel(0)}, counts[i]});
  }
  std::vector<Box> boxes;
  if (!colours.empty()) boxes.emplace_back(colours);
  while (boxes.size() < colours_max) {
    const auto widest = std::ranges::max_element(
        boxes, {}, [](const Box& box) { return box.can_be_cut() ? box.spread : -1; });
    if (widest == boxes.end() || !widest->can_be_cut()) break;
    const auto [below, above] = widest->cut();
    *widest = below;
    boxes.push_back(above);
  }
  std::vector<cv::Vec3b> palette;
  for (const Box& box : boxes) palette.push_back(box.mean);
  return palette;
}

GifFile::GifFile(std::string path, cv::Size size, GifFileType* file)
    : path_(std::move(path)), size_(size), file_(file), row_(static_cast<std::size_t>(size.width)) {}

GifFile::~GifFile() {
  if (file_ != nullptr) EGifCloseFile(file_, nullptr);
}

Expected<std::unique_ptr<GifFile>> GifFile::create(const std::string& path, cv::Size size) {
  // giflib would make a file that its owner alone may read.
  const int descriptor = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (descriptor < 0) return file_error(path + ": cannot be made; is the folder writable?", errno);
  int code = 0;
  GifFileType* const file = EGifOpenFileHandle(descriptor, &code);  // closes it where it fails
  if (file == nullptr) return Error{ErrorCode::kSystem, path + ": " + GifErrorString(code)};
  return std::unique_ptr<GifFile>(new GifFile(path, size, file));
}

Error GifFile::failure(int giflib_code) const {
  const char* const text = GifErrorString(giflib_code);
  return Error{ErrorCode::kNoSpace,
               path_ + ": " + (text != nullptr ? text : "cannot be written") + "; is the disk full?"};
}

Status GifFile::add(const cv::Mat& picture, int64_t tics) {
  // A delay is whole hundredths of a second: it ends where the sum of all is rounded to.
  const auto centiseconds = [](int64_t at) { return (200 * at + kTicRateHz) / (2 * kTicRateHz); };
  const int64_t began = centiseconds(tics_);
  tics_ += tics;
  group_.push_back({picture.clone(), static_cast<int>(centiseconds(tics_) - began)});
  if (group_.size() * 3 * picture.total() < kGroupBytes) return {};
  return write_group();
}

Status GifFile::finish() {
  COMRAD_TRY(write_group());
  int code = 0;
  if (EGifCloseFile(std::exchange(file_, nullptr), &code) != GIF_OK) return failure(code);
  return {};
}

Status GifFile::write_group() {
  if (group_.empty()) return {};
  std::vector<uint32_t> counts(kCountedColours);
  for (const Shown& shown : group_)
    for (const cv::Vec3b& pixel : cv::Mat_<cv::Vec3b>(shown.picture)) ++counts[counted(pixel)];
  const std::vector<cv::Vec3b> palette = choose_palette(counts, kColours);
  const std::unique_ptr<ColorMapObject, decltype(&GifFreeMapObject)> colours(
      GifMakeMapObject(kColours + 1, nullptr), &GifFreeMapObject);
  COMRAD_CHECK(colours != nullptr, "a palette's size is a power of two");
  for (std::size_t i = 0; i < palette.size(); ++i)
    colours->Colors[i] = {palette[i][2], palette[i][1], palette[i][0]};
  nearest_.assign(kCountedColours, -1);
  // The first group's palette is the file's; most videos have no other.
  bool is_written = true;
  const bool is_first = !std::exchange(has_head_, true);
  if (is_first) is_written = write_head(colours.get());
  for (const Shown& shown : group_)
    is_written = is_written && write_picture(shown, palette, is_first ? nullptr : colours.get());
  group_.clear();
  return is_written ? Status() : failure(file_->Error);
}

bool GifFile::write_head(const ColorMapObject* colours) {
  EGifSetGifVersion(file_, /*gif89=*/true);
  return EGifPutScreenDesc(file_, size_.width, size_.height, /*color_res=*/8, /*background=*/0, colours) ==
             GIF_OK &&
         EGifPutExtensionLeader(file_, APPLICATION_EXT_FUNC_CODE) == GIF_OK &&
         EGifPutExtensionBlock(file_, 11, "NETSCAPE2.0") == GIF_OK &&
         EGifPutExtensionBlock(file_, 3, "\1\0\0") == GIF_OK &&  // for ever
         EGifPutExtensionTrailer(file_) == GIF_OK;
}

int GifFile::index_of(const cv::Vec3b& colour, const std::vector<cv::Vec3b>& palette) {
  int16_t& nearest = nearest_[counted(colour)];
  if (nearest < 0)
    nearest = static_cast<int16_t>(
        std::ranges::min_element(palette, {}, [&](const cv::Vec3b& one) { return distance(one, colour); }) -
        palette.begin());
  return nearest;
}

bool GifFile::write_picture(const Shown& shown, const std::vector<cv::Vec3b>& palette,
                            const ColorMapObject* own_colours) {
  const bool is_first = canvas_.empty();
  if (is_first) canvas_.create(size_, CV_8UC3);
  const GraphicsControlBlock control{.DisposalMode = DISPOSE_DO_NOT,
                                     .UserInputFlag = false,
                                     .DelayTime = shown.delay_centiseconds,
                                     .TransparentColor = kTransparent};
  GifByteType block[4];
  EGifGCBToExtension(&control, block);
  if (EGifPutExtension(file_, GRAPHICS_EXT_FUNC_CODE, sizeof block, block) != GIF_OK ||
      EGifPutImageDesc(file_, 0, 0, size_.width, size_.height, /*interlaced=*/false, own_colours) != GIF_OK)
    return false;
  for (int y = 0; y < size_.height; ++y) {
    const cv::Vec3b* const wanted = shown.picture.ptr<cv::Vec3b>(y);
    cv::Vec3b* const seen = canvas_.ptr<cv::Vec3b>(y);
    int left = -1;  // its index
    for (int x = 0; x < size_.width; ++x) {
      const cv::Vec3b& colour = wanted[x];
      const auto is_close = [&](const cv::Vec3b& other) {
        return distance(colour, other) <= kUnseenDistance;
      };
      const bool is_still = !is_first && is_close(seen[x]);
      const bool repeats =
          left == kTransparent ? is_still : left >= 0 && is_close(palette[static_cast<std::size_t>(left)]);
      if (!repeats) left = is_still ? kTransparent : index_of(colour, palette);
      row_[static_cast<std::size_t>(x)] = static_cast<uint8_t>(left);
      if (left != kTransparent) seen[x] = palette[static_cast<std::size_t>(left)];
    }
    if (EGifPutLine(file_, row_.data(), size_.width) != GIF_OK) return false;
  }
  return true;
}

}  // namespace comrad::sim

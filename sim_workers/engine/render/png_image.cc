#include "sim_workers/engine/render/png_image.h"

#include <spdlog/fmt/fmt.h>

#include <png.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstring>
#include <string>

#ifdef COMRAD_PNG_ARCHIVE
// Where libpng.a, as CMakeLists.txt changed it, finds stderr.
extern "C" {
extern FILE* comrad_png_stderr;
FILE* comrad_png_stderr = stderr;
}
#endif

namespace comrad::doom {
namespace {

constexpr std::array<uint8_t, 8> kSignature = {0x89, 'P', 'N', 'G', 0x0D, 0x0A, 0x1A, 0x0A};
constexpr int32_t kOffsetMax = 4096;

uint32_t big_endian(std::span<const uint8_t> bytes, std::size_t at) {
  return uint32_t{bytes[at]} << 24 | uint32_t{bytes[at + 1]} << 16 | uint32_t{bytes[at + 2]} << 8 |
         uint32_t{bytes[at + 3]};
}

/// Reads the grAb chunk, which stands before the pixels.
void read_offsets(std::span<const uint8_t> lump, RgbaImage* image) {
  for (std::size_t at = kSignature.size(); at + 12 <= lump.size();) {
    const std::size_t length = big_endian(lump, at);
    if (length > lump.size() - at - 12 || std::memcmp(&lump[at + 4], "IDAT", 4) == 0) return;
    if (std::memcmp(&lump[at + 4], "grAb", 4) == 0 && length >= 8) {
      const auto offset = [&](std::size_t from) {
        return std::clamp(static_cast<int32_t>(big_endian(lump, from)), -kOffsetMax, kOffsetMax);
      };
      image->left_offset = offset(at + 8), image->top_offset = offset(at + 12);
      return;
    }
    at += length + 12;
  }
}

}  // namespace

bool is_png(std::span<const uint8_t> lump) {
  return lump.size() >= kSignature.size() && std::equal(kSignature.begin(), kSignature.end(), lump.begin());
}

Expected<RgbaImage> decode_png(std::span<const uint8_t> lump, std::string_view name) {
  const auto broken = [&](const std::string& what) {
    return Error{ErrorCode::kBadFormat, "PNG lump " + std::string(name) + ": " + what};
  };
  png_image reader;
  std::memset(&reader, 0, sizeof reader);
  reader.version = PNG_IMAGE_VERSION;
  if (!png_image_begin_read_from_memory(&reader, lump.data(), lump.size())) return broken(reader.message);
  RgbaImage image;
  if (reader.width < 1 || reader.height < 1 || reader.width > kPngSideMax || reader.height > kPngSideMax) {
    const std::string size = fmt::format("{}x{}", reader.width, reader.height);
    png_image_free(&reader);
    return broken(
        fmt::format("a picture of {} texels is not supported; {} a side is the most", size, kPngSideMax));
  }
  image.width = static_cast<int>(reader.width), image.height = static_cast<int>(reader.height);
  reader.format = PNG_FORMAT_RGBA;
  image.rgba.resize(PNG_IMAGE_SIZE(reader));
  if (!png_image_finish_read(&reader, nullptr, image.rgba.data(), 0, nullptr)) {
    const std::string message = reader.message;
    png_image_free(&reader);
    return broken(message);
  }
  read_offsets(lump, &image);
  return image;
}

Status write_png(const std::string& path, std::span<const uint8_t> planes, int width, int height) {
  const std::size_t plane = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  COMRAD_CHECK(planes.size() == 3 * plane, "a picture has three planes");
  std::vector<uint8_t> rgb(3 * plane);
  for (std::size_t pixel = 0; pixel < plane; ++pixel)
    for (std::size_t channel = 0; channel < 3; ++channel)
      rgb[3 * pixel + channel] = planes[channel * plane + pixel];
  png_image writer;
  std::memset(&writer, 0, sizeof writer);
  writer.version = PNG_IMAGE_VERSION;
  writer.width = static_cast<png_uint_32>(width), writer.height = static_cast<png_uint_32>(height);
  writer.format = PNG_FORMAT_RGB;
  if (!png_image_write_to_file(&writer, path.c_str(), 0, rgb.data(), 0, nullptr))
    return Error{ErrorCode::kSystem, path + ": " + writer.message};
  return {};
}

}  // namespace comrad::doom

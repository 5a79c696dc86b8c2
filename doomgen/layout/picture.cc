#include "doomgen/layout/picture.h"

#include <spdlog/fmt/fmt.h>

#include <zlib.h>

#include <algorithm>
#include <array>
#include <map>

#include "rollout_buffer/core/check.h"

namespace comrad::doomgen {
namespace {

const Bytef* bytes_of(std::string_view text) { return reinterpret_cast<const Bytef*>(text.data()); }

void put_big_endian(std::string& out, uint32_t value) {
  for (int shift = 24; shift >= 0; shift -= 8) out += static_cast<char>(value >> shift & 0xFF);
}

void put_chunk(std::string& out, std::string_view name, std::string_view data) {
  put_big_endian(out, static_cast<uint32_t>(data.size()));
  std::string body(name);
  body += data;
  out += body;
  put_big_endian(out, static_cast<uint32_t>(crc32_z(0, bytes_of(body), body.size())));
}

/// A zlib stream of stored blocks.
std::string stored(std::string_view data) {
  constexpr std::size_t kBlockBytes = 65535;
  std::string out("\x78\x01", 2);
  std::size_t done = 0;
  do {
    const std::size_t count = std::min(kBlockBytes, data.size() - done);
    out += done + count == data.size() ? '\1' : '\0';
    for (const std::size_t value : {count, ~count & 0xFFFF})
      out += static_cast<char>(value & 0xFF), out += static_cast<char>(value >> 8 & 0xFF);
    out += data.substr(done, count);
    done += count;
  } while (done < data.size());
  put_big_endian(out, static_cast<uint32_t>(adler32_z(adler32(0, nullptr, 0), bytes_of(data), data.size())));
  return out;
}

void put_u16(std::string& out, int value) {
  out += static_cast<char>(value & 0xFF), out += static_cast<char>(value >> 8 & 0xFF);
}

/// A PNG of one IHDR, the palette if there is one, and one IDAT.
std::string png_file(const Picture& picture, std::string_view kind, std::string_view palette,
                     std::string_view data) {
  std::string head;
  put_big_endian(head, static_cast<uint32_t>(picture.width));
  put_big_endian(head, static_cast<uint32_t>(picture.height));
  head += kind;
  head += std::string(3, '\0');  // deflate, adaptive filters, no interlacing
  std::string out("\x89PNG\r\n\x1A\n", 8);
  put_chunk(out, "IHDR", head);
  if (!palette.empty()) put_chunk(out, "PLTE", palette);
  put_chunk(out, "IDAT", data);
  put_chunk(out, "IEND", {});
  return out;
}

}  // namespace

std::string encode_png(const Picture& picture) {
  std::string rows;
  rows.reserve(static_cast<std::size_t>(picture.height) * (4 * static_cast<std::size_t>(picture.width) + 1));
  for (int y = 0; y < picture.height; ++y) {
    rows += '\0';  // no filter
    for (int x = 0; x < picture.width; ++x) {
      const Colour& c = picture.at(x, y);
      for (const uint8_t value : {c.red, c.green, c.blue, c.alpha}) rows += static_cast<char>(value);
    }
  }
  return png_file(picture, "\x08\x06", {}, stored(rows));  // 8 bits, RGBA
}

Expected<std::string> encode_indexed_png(const Picture& picture) {
  constexpr std::size_t kColoursMax = 256;
  std::map<std::array<uint8_t, 3>, char> indices;
  std::string palette, rows;
  rows.reserve(static_cast<std::size_t>(picture.height) * (static_cast<std::size_t>(picture.width) + 1));
  for (int y = 0; y < picture.height; ++y) {
    rows += '\0';  // no filter: it would hide equal indices from deflate
    for (int x = 0; x < picture.width; ++x) {
      const Colour& c = picture.at(x, y);
      const auto [found, is_new] =
          indices.try_emplace({c.red, c.green, c.blue}, static_cast<char>(indices.size()));
      if (is_new)
        for (const uint8_t value : found->first) palette += static_cast<char>(value);
      rows += found->second;
    }
    if (indices.size() > kColoursMax)
      return Error{ErrorCode::kBadInput, "an indexed PNG has at most 256 colours; this picture has more"};
  }
  std::string data(compressBound(rows.size()), '\0');
  uLongf size = data.size();
  const int compressed = compress2(reinterpret_cast<Bytef*>(data.data()), &size, bytes_of(rows), rows.size(),
                                   Z_BEST_COMPRESSION);
  COMRAD_CHECK(compressed == Z_OK, "zlib compresses a picture into compressBound() bytes");
  data.resize(size);
  return png_file(picture, "\x08\x03", palette, data);  // 8 bits, indices
}

Expected<std::string> encode_patch(const Picture& picture, std::string_view palette) {
  constexpr int kWidthMax = 1024, kHeightMax = 254;  // a post's row is one byte, 255 ends the column
  if (picture.width < 1 || picture.height < 1 || picture.width > kWidthMax || picture.height > kHeightMax)
    return Error{ErrorCode::kBadInput,
                 fmt::format("a patch measures 1x1 to 1024x254, not {}x{}", picture.width, picture.height)};
  if (palette.size() < 768) return Error{ErrorCode::kBadInput, "a palette has 768 bytes"};
  const auto nearest = [&](const Colour& c) {
    int best = 0;
    int64_t best_distance = INT64_MAX;
    for (int i = 0; i < 256; ++i) {
      const int red = static_cast<uint8_t>(palette[3 * i]), green = static_cast<uint8_t>(palette[3 * i + 1]),
                blue = static_cast<uint8_t>(palette[3 * i + 2]);
      const int64_t distance = (red - c.red) * (red - c.red) + (green - c.green) * (green - c.green) +
                               (blue - c.blue) * (blue - c.blue);
      if (distance < best_distance) best_distance = distance, best = i;
    }
    return static_cast<char>(best);
  };
  std::string columns;
  std::vector<std::size_t> offsets;
  const std::size_t data_start = 8 + 4 * static_cast<std::size_t>(picture.width);
  for (int x = 0; x < picture.width; ++x) {
    offsets.push_back(data_start + columns.size());
    for (int y = 0; y < picture.height;) {
      if (picture.at(x, y).alpha < 128) {
        ++y;
        continue;
      }
      int end = y;
      while (end < picture.height && picture.at(x, end).alpha >= 128) ++end;
      columns += static_cast<char>(y), columns += static_cast<char>(end - y), columns += '\0';
      for (; y < end; ++y) columns += nearest(picture.at(x, y));
      columns += '\0';
    }
    columns += '\xFF';
  }
  std::string out;
  for (const int value : {picture.width, picture.height, 0, 0}) put_u16(out, value);
  for (const std::size_t offset : offsets)
    for (int shift = 0; shift < 32; shift += 8) out += static_cast<char>(offset >> shift & 0xFF);
  return out + columns;
}

}  // namespace comrad::doomgen

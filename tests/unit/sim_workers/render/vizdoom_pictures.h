// A traced game beside ViZDoom's pictures of it: draws ours at 160x120 and measures the difference.
#pragma once

#include <gtest/gtest.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "doomgen/wad/iwad_search.h"
#include "sim_workers/engine/render/art_archive.h"
#include "sim_workers/engine/render/png_image.h"
#include "sim_workers/trace/trace_game.h"
#include "tests/support/picture_difference.h"

namespace comrad::doom::test {

constexpr int kReferenceWidth = 160, kReferenceHeight = 120;

inline std::vector<uint8_t> file_bytes(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

inline Expected<RgbaImage> read_png(const std::string& path) { return decode_png(file_bytes(path), path); }

/// Depth edges of many pictures: they lie within a pixel of ViZDoom's, but for a few in a hundred (its buffer
/// counts walls and floors a little differently).
struct EdgeCount {
  int edges = 0, missed = 0, invented = 0;
  void add(const PictureDifference& d) {
    edges += d.edges, missed += d.edges_missed, invented += d.edges_invented;
  }
  void expect_few() const {
    EXPECT_LE(missed, 5 + edges * 3 / 100) << "of " << edges << " depth edges";
    EXPECT_LE(invented, 5 + edges * 3 / 100) << "of " << edges << " depth edges";
  }
};

/// What a game shows, drawn with and without its weapon, and how deep it lies.
class ReferencePainter {
 public:
  static Expected<ReferencePainter> create(trace::TraceGame& game, const std::string& iwad) {
    COMRAD_TRY_ASSIGN(auto art, ArtArchive::open(iwad, game.art_paths));
    ReferencePainter painter;
    RenderOptions options = game.render;
    options.width = kReferenceWidth, options.height = kReferenceHeight;
    COMRAD_TRY_ASSIGN(painter.full_, Renderer::create(art, options));
    options.weapon = false;
    COMRAD_TRY_ASSIGN(painter.bare_, Renderer::create(art, options));
    return painter;
  }

  /// `stem`.png and, where it exists, `stem`_depth.png are ViZDoom's. Writes ours beside each other to
  /// `picture_folder` where that is not empty.
  Expected<PictureDifference> compare(const World& world, const std::string& stem,
                                      const std::string& picture_folder) {
    COMRAD_TRY_ASSIGN(const RgbaImage theirs, read_png(stem + ".png"));
    if (theirs.width != kReferenceWidth || theirs.height != kReferenceHeight)
      return Error{ErrorCode::kBadInput, stem + ".png is not of 160x120"};
    constexpr std::size_t kPlane = std::size_t{kReferenceWidth} * kReferenceHeight;
    std::vector<uint8_t> picture(3 * kPlane), bare(3 * kPlane);
    const ViewRequest request{&world, 0, picture.data()}, bare_request{&world, 0, bare.data()};
    full_->draw({&request, 1});
    bare_->draw({&bare_request, 1});
    std::vector<float> depth;
    const int rows = full_->draw_depth(world, 0, &depth);
    // The weapon and a pixel round it, and the bar.
    std::vector<bool> ignored(kPlane);
    for (int y = 0; y < kReferenceHeight; ++y)
      for (int x = 0; x < kReferenceWidth; ++x) {
        const auto at = static_cast<std::size_t>(y * kReferenceWidth + x);
        bool differs = false;
        for (std::size_t channel = 0; channel < 3; ++channel)
          differs = differs || picture[channel * kPlane + at] != bare[channel * kPlane + at];
        if (!differs && y < rows) continue;
        for (int dy = -2; dy <= 2; ++dy)
          for (int dx = -2; dx <= 2; ++dx)
            if (y < rows && x + dx >= 0 && y + dy >= 0 && x + dx < kReferenceWidth &&
                y + dy < kReferenceHeight)
              ignored[static_cast<std::size_t>((y + dy) * kReferenceWidth + x + dx)] = true;
        ignored[at] = true;
      }
    PictureDifference difference;
    compare_colors(picture, theirs.rgba, kReferenceWidth, kReferenceHeight, ignored, &difference);
    const Expected<RgbaImage> depth_picture = read_png(stem + "_depth.png");
    if (depth_picture)
      compare_depths(depth, depth_picture->rgba, kReferenceWidth, rows, ignored, &difference);
    if (!picture_folder.empty()) {
      std::filesystem::create_directories(picture_folder);
      const std::string name = std::filesystem::path(stem).filename().string();
      std::vector<uint8_t> both(6 * kPlane);
      for (std::size_t channel = 0; channel < 3; ++channel)
        for (std::size_t y = 0; y < kReferenceHeight; ++y)
          for (std::size_t x = 0; x < kReferenceWidth; ++x) {
            uint8_t* row = &both[(channel * kReferenceHeight + y) * 2 * kReferenceWidth];
            row[x] = theirs.rgba[4 * (y * kReferenceWidth + x) + channel];
            row[kReferenceWidth + x] = picture[channel * kPlane + y * kReferenceWidth + x];
          }
      COMRAD_TRY(
          write_png(picture_folder + "/" + name + ".png", both, 2 * kReferenceWidth, kReferenceHeight));
      std::ofstream raw(picture_folder + "/" + name + ".depth", std::ios::binary);
      raw.write(reinterpret_cast<const char*>(depth.data()),
                static_cast<std::streamsize>(depth.size() * sizeof(float)));
    }
    return difference;
  }

  static void print_header() {
    std::printf("%-34s %8s %8s %8s %7s %7s %9s\n", "picture", "mean abs", "equal", "depth", "edges", "missed",
                "invented");
  }
  static void print(const std::string& name, const PictureDifference& d) {
    std::printf("%-34s %8.2f %7.1f%% %7.1f%% %7d %7d %9d\n", name.c_str(), d.mean_absolute,
                100 * d.equal_share, 100 * d.depth_share, d.edges, d.edges_missed, d.edges_invented);
  }
  /// Colours lie within `limit` of ViZDoom's on average, and nearly every pixel is as deep.
  static void expect_alike(const std::string& name, const PictureDifference& d, double limit) {
    EXPECT_LE(d.mean_absolute, limit) << name;
    EXPECT_GE(d.depth_share, 0.9) << name;
  }

 private:
  std::unique_ptr<Renderer> full_, bare_;
};

}  // namespace comrad::doom::test

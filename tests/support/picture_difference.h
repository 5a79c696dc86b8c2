// How far two pictures of the same view lie apart: colours, and the edges of depth.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <span>
#include <vector>

namespace comrad::doom::test {

struct PictureDifference {
  double mean_absolute = 0;  ///< of all channels of the pixels that count, 0..255
  double equal_share = 0;    ///< of pixels that are equal in all channels
  int pixels = 0;
  double depth_share = 0;  ///< of pixels whose depth is the other's within two steps of its scale
  int edges = 0;           ///< depth edges of the reference
  int edges_missed = 0;    ///< of those, without one of ours within a pixel
  int edges_invented = 0;  ///< of ours, without one of the reference's within a pixel
};

/// `ours` planar RGB [3, height, width], `theirs` RGBA [height, width, 4]; pixels with `ignored` are
/// left out.
inline void compare_colors(std::span<const uint8_t> ours, std::span<const uint8_t> theirs, int width,
                           int height, const std::vector<bool>& ignored, PictureDifference* difference) {
  const auto plane = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  int64_t sum = 0, equal = 0, count = 0;
  for (std::size_t i = 0; i < plane; ++i) {
    if (ignored[i]) continue;
    int here = 0;
    for (std::size_t channel = 0; channel < 3; ++channel)
      here += std::abs(int{ours[channel * plane + i]} - int{theirs[4 * i + channel]});
    sum += here, equal += here == 0, ++count;
  }
  difference->pixels = static_cast<int>(count);
  if (count == 0) return;
  difference->mean_absolute = static_cast<double>(sum) / (3.0 * static_cast<double>(count));
  difference->equal_share = static_cast<double>(equal) / static_cast<double>(count);
}

/// ViZDoom's depth buffer: map units of a step, and where the steps begin; measured. Planes begin two steps
/// later than walls, and walls farther than 62 steps stand at 63.
constexpr double kDepthStep = 7.22, kDepthBegin = 6.0, kDepthMost = 62.0;

/// `ours` [height, width] in map units, 0 for sky; `theirs` in ViZDoom's steps, RGBA [height, width, 4].
/// An edge is where depth jumps between two neighbours of a row or column, beyond the slope on either side
/// of them.
inline void compare_depths(std::span<const float> ours, std::span<const uint8_t> theirs, int width,
                           int height, const std::vector<bool>& ignored, PictureDifference* difference) {
  const auto at = [width](int x, int y) {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
  };
  std::vector<double> mine, reference;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const double depth = ours[at(x, y)];
      mine.push_back(depth <= 0
                         ? kDepthMost
                         : std::clamp(std::floor((depth - kDepthBegin) / kDepthStep), 0.0, kDepthMost));
      reference.push_back(std::min<double>(kDepthMost, theirs[4 * at(x, y)]));
    }
  // The weapon and texts on the screen stand at 0; they and two pixels round them are left out too.
  std::vector<bool> left_out = ignored;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      if (reference[at(x, y)] > 0) continue;
      for (int near_y = std::max(0, y - 2); near_y <= std::min(height - 1, y + 2); ++near_y)
        for (int near_x = std::max(0, x - 2); near_x <= std::min(width - 1, x + 2); ++near_x)
          left_out[at(near_x, near_y)] = true;
    }
  int64_t near = 0, count = 0;
  for (std::size_t i = 0; i < mine.size(); ++i)
    if (!left_out[i]) near += std::abs(mine[i] - reference[i]) <= 2, ++count;
  difference->depth_share = count == 0 ? 1 : static_cast<double>(near) / static_cast<double>(count);
  // A jump of two neighbours against the slope on either side of it.
  const auto edge = [&](const std::vector<double>& depth, int x, int y, double least) {
    const auto jump = [&](int step_x, int step_y) {
      const int x0 = x - step_x, y0 = y - step_y, x1 = x + step_x, y1 = y + step_y, x2 = x1 + step_x,
                y2 = y1 + step_y;
      if (x0 < 0 || y0 < 0 || x2 >= width || y2 >= height) return false;
      const double middle = depth[at(x1, y1)] - depth[at(x, y)];
      const double slope = std::max(std::abs(depth[at(x, y)] - depth[at(x0, y0)]),
                                    std::abs(depth[at(x2, y2)] - depth[at(x1, y1)]));
      return std::abs(middle) - slope >= least;
    };
    return jump(1, 0) || jump(0, 1);
  };
  constexpr double kJump = 12, kSmallJump = 3;
  const auto found_near = [&](const std::vector<double>& depth, int x, int y) {
    for (int dy = -1; dy <= 1; ++dy)
      for (int dx = -1; dx <= 1; ++dx)
        if (x + dx >= 0 && y + dy >= 0 && x + dx < width && y + dy < height &&
            edge(depth, x + dx, y + dy, kSmallJump))
          return true;
    return false;
  };
  for (int y = 1; y + 2 < height; ++y)
    for (int x = 1; x + 2 < width; ++x) {
      bool skip = false;
      for (int dy = -1; dy <= 2; ++dy)
        for (int dx = -1; dx <= 2; ++dx) skip = skip || left_out[at(x + dx, y + dy)];
      if (skip) continue;
      if (edge(reference, x, y, kJump))
        ++difference->edges, difference->edges_missed += !found_near(mine, x, y);
      if (edge(mine, x, y, kJump)) difference->edges_invented += !found_near(reference, x, y);
    }
}

}  // namespace comrad::doom::test

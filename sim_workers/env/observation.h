// How a drawn view becomes an observation: the size it is drawn at, and the filter that brings it to 128x72.
// Drawn at that size already, it needs none and lands in the slab without a copy. Stage: render.
#pragma once

#include <cstdint>
#include <string>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/words.h"

namespace comrad::sim {

struct ViewSize {
  int width = 128, height = 72;
  friend bool operator==(const ViewSize&, const ViewSize&) = default;
};

constexpr ViewSize kObservationSize{128, 72};

/// Reads "160x120". Errors: kBadInput naming the text and the range 16..4096.
Expected<ViewSize> parse_view_size(const std::string& text);

/// False in the Python package, which is built without OpenCV.
bool can_resize();

/// Resizes a planar picture, plane by plane.
///   source       [3, source_size.height, source_size.width] u8
///   destination  [3, 72, 128] u8
/// Call it where can_resize().
void resize_planes(const uint8_t* source, ViewSize source_size, Resize filter, uint8_t* destination);

}  // namespace comrad::sim

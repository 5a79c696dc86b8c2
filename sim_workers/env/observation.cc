#include "sim_workers/env/observation.h"

#include <charconv>
#include <cstring>
#ifdef COMRAD_HAVE_OPENCV
#include <opencv2/imgproc.hpp>
#endif

namespace comrad::sim {

Expected<ViewSize> parse_view_size(const std::string& text) {
  ViewSize size;
  const char* const end = text.data() + text.size();
  const auto width = std::from_chars(text.data(), end, size.width);
  if (width.ec == std::errc() && width.ptr != end && *width.ptr == 'x') {
    const auto height = std::from_chars(width.ptr + 1, end, size.height);
    if (height.ec == std::errc() && height.ptr == end && size.width >= 16 && size.width <= 4096 &&
        size.height >= 16 && size.height <= 4096)
      return size;
  }
  return Error{ErrorCode::kBadInput,
               "render_size is '" + text + "'; write WIDTHxHEIGHT with both in 16..4096"};
}

#ifndef COMRAD_HAVE_OPENCV
bool can_resize() { return false; }
void resize_planes(const uint8_t*, ViewSize, Resize, uint8_t*) {
  COMRAD_CHECK(false, "can_resize() was not asked");
}
#else
bool can_resize() { return true; }
void resize_planes(const uint8_t* source, ViewSize source_size, Resize filter, uint8_t* destination) {
  const std::size_t source_bytes = std::size_t(source_size.width) * source_size.height;
  const std::size_t destination_bytes = std::size_t{kObservationSize.width} * kObservationSize.height;
  for (int plane = 0; plane < 3; ++plane) {
    // cv::Mat has no const view; the source is only read.
    const cv::Mat from(source_size.height, source_size.width, CV_8UC1,
                       const_cast<uint8_t*>(source + plane * source_bytes));
    cv::Mat to(kObservationSize.height, kObservationSize.width, CV_8UC1,
               destination + plane * destination_bytes);
    cv::resize(from, to, to.size(), 0, 0, filter == Resize::kArea ? cv::INTER_AREA : cv::INTER_NEAREST);
  }
}
#endif

}  // namespace comrad::sim

// How long a GIF is shown. OpenCV's frame rate of one is the first picture's alone in newer releases, and pictures last 11 and 12
// hundredths in turn.
#pragma once

#include <gif_lib.h>
#include <gtest/gtest.h>

#include <string>

namespace comrad::test {

inline double gif_seconds(const std::string& path) {
  GifFileType* const gif = DGifOpenFileName(path.c_str(), nullptr);
  if (gif == nullptr || DGifSlurp(gif) != GIF_OK) {
    ADD_FAILURE() << path << " is no GIF";
    return 0;
  }
  double hundredths = 0;
  for (int i = 0; i < gif->ImageCount; ++i) {
    GraphicsControlBlock control;
    EXPECT_EQ(DGifSavedExtensionToGCB(gif, i, &control), GIF_OK) << "picture " << i;
    hundredths += control.DelayTime;
  }
  DGifCloseFile(gif, nullptr);
  return hundredths / 100;
}

}  // namespace comrad::test

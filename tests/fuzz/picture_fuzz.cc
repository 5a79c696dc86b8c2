// Pictures: Doom's columns, PNG, and a WAD of them. The first byte chooses.
#include "sim_workers/engine/render/art_archive.h"
#include "sim_workers/engine/render/png_image.h"
#include "tests/fuzz/play.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, std::size_t size) {
  using namespace comrad::doom;
  comrad::fuzz::be_quiet();
  if (size < 2 || size > 1 << 17) return 0;
  const std::span<const uint8_t> rest(data + 1, size - 1);
  switch (data[0] % 3) {
    case 0:
      (void)decode_picture(rest, "FUZZ");
      return 0;
    case 1:
      (void)decode_png(rest, "FUZZ");
      return 0;
    default: {
      const auto archive = ArtArchive::from_bytes({std::vector<uint8_t>(rest.begin(), rest.end())});
      if (!archive) return 0;
      for (const char* name : {"WALL", "FLAT", "STEP", "STBAR", "F_SKY1", "SKY1"}) {
        (void)(*archive)->wall(name);
        (void)(*archive)->flat(name);
        (void)(*archive)->graphic(name);
      }
      for (uint32_t lump = 0; lump < std::min<uint32_t>((*archive)->lump_count(), 40); ++lump)
        (void)(*archive)->sprite_image(lump);
      return 0;
    }
  }
}

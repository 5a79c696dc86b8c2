#include "sim_workers/engine/render/art_archive.h"

#include <gtest/gtest.h>

#include <cstdlib>

#include "tests/support/random_bytes.h"
#include "tests/unit/sim_workers/render/tiny_iwad.h"

namespace comrad::doom {
namespace art_archive_test {

std::vector<uint8_t> to_bytes(const std::string& text) { return {text.begin(), text.end()}; }

TEST(DecodePicture, ReadsPostsHolesAndOffsets) {
  // 255 is a hole.
  const std::string lump = test::picture_lump(3, 4, -2, 7,
                                              {1, 255, 2,    //
                                               3, 255, 255,  //
                                               255, 4, 5,    //
                                               6, 255, 7});
  const auto image = decode_picture(to_bytes(lump), "TEST");
  ASSERT_TRUE(image.has_value());
  EXPECT_EQ(image->width, 3);
  EXPECT_EQ(image->height, 4);
  EXPECT_EQ(image->left_offset, -2);
  EXPECT_EQ(image->top_offset, 7);
  EXPECT_EQ(image->texels, (std::vector<uint8_t>{1, 0, 2, 3, 0, 0, 0, 4, 5, 6, 0, 7}));
}

TEST(DecodePicture, RefusesEveryTruncation) {
  const std::string lump = test::filled_picture(5, 9, 33);
  ASSERT_TRUE(decode_picture(to_bytes(lump), "WHOLE").has_value());
  for (std::size_t size = 0; size < lump.size(); ++size) {
    const auto image = decode_picture(to_bytes(lump.substr(0, size)), "CUT");
    ASSERT_FALSE(image.has_value()) << "cut to " << size << " of " << lump.size() << " bytes";
    EXPECT_EQ(image.error().code, ErrorCode::kBadFormat);
    EXPECT_NE(image.error().message.find("CUT"), std::string::npos) << "the message names the lump";
  }
}

TEST(DecodePicture, RefusesAColumnThatPointsOutside) {
  std::string lump = test::filled_picture(2, 2, 1);
  lump[8] = lump[9] = lump[10] = static_cast<char>(0xFF), lump[11] = static_cast<char>(0xFF);
  EXPECT_FALSE(decode_picture(to_bytes(lump), "BENT").has_value());
}

TEST(DecodePicture, ClipsPostsBelowThePicture) {
  std::string lump = test::filled_picture(1, 3, 9);
  lump[2] = 2;  // the picture claims two rows, the post has three
  const auto image = decode_picture(to_bytes(lump), "LOW");
  ASSERT_TRUE(image.has_value());
  EXPECT_EQ(image->texels, (std::vector<uint8_t>{9, 9}));
}

TEST(ArtArchive, SurvivesRandomPictures) {
  const uint64_t seed = comrad::test::fuzz_seed();
  Rng rng{seed};
  const std::string whole = test::filled_picture(16, 16, 77);
  for (int round = 0; round < 3000; ++round) {
    std::vector<uint8_t> bytes = comrad::test::mutated(rng, to_bytes(whole));
    const auto image = decode_picture(bytes, "FUZZ");
    if (image) {
      EXPECT_EQ(image->texels.size(), static_cast<std::size_t>(image->width) * image->height)
          << "COMRAD_FUZZ_SEED=" << seed << " round " << round;
    }
  }
}

TEST(ArtArchive, SurvivesRandomWads) {
  const uint64_t seed = comrad::test::fuzz_seed();
  Rng rng{seed};
  const std::vector<uint8_t> whole = test::tiny_iwad().build();
  int opened = 0;
  for (int round = 0; round < 400; ++round) {
    const auto archive = ArtArchive::from_bytes({comrad::test::mutated(rng, whole)});
    if (!archive) continue;
    ++opened;
    for (const char* name : {"BRICK6", "ASHWALL6", "RSKY1"}) (void)(*archive)->wall(name);
    (void)(*archive)->flat("FLAT1");
    for (uint32_t lump = 0; lump < (*archive)->lump_count(); ++lump) (void)(*archive)->sprite_image(lump);
  }
  EXPECT_GT(opened, 0) << "COMRAD_FUZZ_SEED=" << seed << ": nothing behind the directory was reached";
}

TEST(ArtArchive, ComposesTexturesAndFindsFlatsBothWays) {
  const auto archive = test::tiny_archive();
  const auto wall = archive->wall("brick6");
  ASSERT_TRUE(wall.has_value()) << wall.error().message;
  EXPECT_EQ(wall->width, 64);
  EXPECT_EQ(wall->at(63, 63), 10);
  EXPECT_FALSE(wall->masked);
  EXPECT_EQ(archive->wall("FLAT1")->at(0, 0), 70) << "a flat may be hung on a wall";
  EXPECT_EQ(archive->flat("ASHWALL6")->at(0, 0), 20) << "a texture may be laid on a floor";
  EXPECT_TRUE(archive->has_surface("FLAT1"));
  EXPECT_FALSE(archive->has_surface("NOSUCH"));
  EXPECT_EQ(archive->wall("NOSUCH").error().code, ErrorCode::kNotFound);
}

TEST(ArtArchive, OpaqueTexelsNeverCarryTheTransparentIndex) {
  auto wad = test::tiny_iwad();
  wad.add("DARK", test::picture_lump(2, 1, 0, 0, {kTransparentIndex, 255}));
  const auto archive = ArtArchive::from_bytes({wad.build()});
  ASSERT_TRUE(archive.has_value());
  const auto image = (*archive)->graphic("DARK");
  ASSERT_TRUE(image.has_value());
  EXPECT_EQ(image->at(0, 0), 1) << "the nearest other colour of the palette";
  EXPECT_EQ(image->at(1, 0), kTransparentIndex);
  EXPECT_TRUE(image->masked);
}

TEST(ArtArchive, PairsMirroredSidesOfASprite) {
  const auto archive = test::tiny_archive();
  const SpriteFrame* frame = archive->sprite("ORB1", 0);
  ASSERT_NE(frame, nullptr);
  EXPECT_TRUE(frame->rotates);
  for (const auto& [side, twin] : {std::pair{1, 7}, {2, 6}, {3, 5}}) {
    ASSERT_TRUE(frame->views[static_cast<std::size_t>(side)] && frame->views[static_cast<std::size_t>(twin)]);
    EXPECT_EQ(frame->views[static_cast<std::size_t>(side)]->lump,
              frame->views[static_cast<std::size_t>(twin)]->lump);
    EXPECT_FALSE(frame->views[static_cast<std::size_t>(side)]->mirrored);
    EXPECT_TRUE(frame->views[static_cast<std::size_t>(twin)]->mirrored);
  }
  const SpriteFrame* still = archive->sprite("STIM", 0);
  ASSERT_NE(still, nullptr);
  EXPECT_FALSE(still->rotates);
  EXPECT_EQ(archive->sprite("STIM", 1), nullptr);
  EXPECT_EQ(archive->sprite("NONE", 0), nullptr);
}

TEST(ArtArchive, LaterWadsOverrideEarlierOnes) {
  wad::test::WadBytes pwad;
  pwad.add("FF_START").add("FLAT1", std::string(4096, 99)).add("FF_END");
  pwad.add("SS_START").add("STIMA0", test::filled_picture(4, 4, 98)).add("SS_END");
  const auto archive = ArtArchive::from_bytes({test::tiny_iwad().build(), pwad.build()});
  ASSERT_TRUE(archive.has_value());
  EXPECT_EQ((*archive)->flat("FLAT1")->at(5, 5), 99);
  const SpriteFrame* frame = (*archive)->sprite("STIM", 0);
  ASSERT_NE(frame, nullptr);
  EXPECT_EQ((*archive)->sprite_image(frame->views[0]->lump)->width, 4);
}

TEST(ArtArchive, ReportsWhatToInstallWhenThereIsNoIwad) {
  const auto archive = ArtArchive::open("/nonexistent/freedoom2.wad");
  ASSERT_FALSE(archive.has_value());
  EXPECT_EQ(archive.error().code, ErrorCode::kNotFound);
  EXPECT_NE(archive.error().message.find("no freedoom2.wad found in /nonexistent/freedoom2.wad"),
            std::string::npos);
  EXPECT_NE(archive.error().message.find("install the Debian package freedoom or set COMRAD_IWAD"),
            std::string::npos);
}

TEST(ArtArchive, AWadWithoutPaletteIsNoIwad) {
  wad::test::WadBytes pwad;
  pwad.add("FF_START").add("FF_END");
  const auto archive = ArtArchive::from_bytes({pwad.build()});
  ASSERT_FALSE(archive.has_value());
  EXPECT_NE(archive.error().message.find("PLAYPAL"), std::string::npos);
}

TEST(ArtArchive, TexturesThatNameMissingPatchNumbersAreRefused) {
  auto wad = test::tiny_iwad();
  for (auto& [name, bytes] : wad.lumps)
    if (name == "PNAMES") bytes[0] = 1;
  const auto archive = ArtArchive::from_bytes({wad.build()});
  ASSERT_FALSE(archive.has_value());
  EXPECT_NE(archive.error().message.find("ASHWALL6"), std::string::npos) << archive.error().message;
}

}  // namespace art_archive_test
}  // namespace comrad::doom

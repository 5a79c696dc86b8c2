#include "doomgen/wad/special_names.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/text.h"

namespace comrad::wad {
namespace special_names_test {

TEST(SpecialNames, AreFoundByNameInAnyCaseAndByNumber) {
  EXPECT_EQ(find_special("Door_Open"), 11);
  EXPECT_EQ(find_special("acs_EXECUTE"), 80);
  EXPECT_EQ(find_special("Exit_Normal"), 243);
  EXPECT_EQ(special_name(11), "Door_Open");
  EXPECT_EQ(special_name(226), "ACS_ExecuteAlways");
  EXPECT_FALSE(find_special("Door_Opens"));
  EXPECT_FALSE(find_special(""));
}

TEST(SpecialNames, NumbersWithoutASpecialHaveNoName) {
  for (const int32_t number : {-1, 0, 108, 255 + 26, INT32_MAX, INT32_MIN})
    EXPECT_EQ(special_name(number), "");
}

TEST(SpecialNames, RiseByNumberAndNoNameStandsTwice) {
  int32_t last = 0;
  for (const SpecialName& special : special_names()) {
    EXPECT_GT(special.number, last);
    last = special.number;
    EXPECT_EQ(find_special(lower_case(special.name)), special.number);
    EXPECT_EQ(special_name(special.number), special.name);
  }
  EXPECT_EQ(last, 280);
}

TEST(SpecialNames, TheDocumentCountsTheSupportedOnes) {
  const auto all = special_names();
  const auto supported = std::ranges::count(all, SpecialSupport::kSupported,
                                            [](const SpecialName& name) { return name.support; });
  const std::string words = std::to_string(supported) + " of ZDoom's " + std::to_string(all.size()) +
                            " by number, from lines, things, states and scripts; each of the " +
                            std::to_string(static_cast<int64_t>(all.size()) - supported) + " others";
  const std::string document = read_file(data_dir() + "/sim_workers/SUPPORTED.md").value_or("");
  EXPECT_NE(document.find(words), std::string::npos) << "sim_workers/SUPPORTED.md should say: " << words;
}

}  // namespace special_names_test
}  // namespace comrad::wad

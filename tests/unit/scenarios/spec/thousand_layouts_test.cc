// A thousand layouts of every scenario, as users get them: drawn (with retries), checked, with their scripts
// compiled, written, read back. Half have the recipe's defaults, half an option of every axis. Takes minutes:
// label long. COMRAD_LAYOUTS=100 makes it a hundred.
#include <gtest/gtest.h>

#include <cstdlib>
#include <ctime>
#include <set>

#include "doomgen/wad/udmf_reader.h"
#include "doomgen/wad/wad_reader.h"
#include "scenarios/spec/layout_pool.h"
#include "scenarios/spec/registry.h"

namespace comrad::scenarios {
namespace thousand_layouts_test {

int layout_count() {
  const char* asked = std::getenv("COMRAD_LAYOUTS");
  return asked == nullptr ? 1000 : std::max(2, std::atoi(asked));
}

class AThousandLayouts : public testing::TestWithParam<std::string> {};

TEST_P(AThousandLayouts, AreValidAndComeAtTwentyASecond) {
  const LayoutRecipe recipe = *layout_recipe(GetParam());
  const int count = layout_count();
  int failed = 0, refused = 0, left_out = 0;
  std::set<uint64_t> hashes;
  const std::clock_t start = std::clock();
  for (int i = 0; i < count; ++i) {
    LayoutRequest request{.seed = static_cast<uint64_t>(i / 2)};
    if (i % 2 == 1) {
      for (const auto& [name, value] : recipe.pool_values)
        request.parameters.emplace_back(name, std::to_string(value));
      Rng rng(RngKey(request.seed).split("axes"));
      for (const LayoutAxis& axis : recipe.axes)
        for (const auto& [name, value] : axis.options[rng.below(static_cast<uint32_t>(axis.options.size()))])
          request.parameters.emplace_back(name, std::to_string(value));
    }
    const auto layout = generate_layout(GetParam(), request);
    // Options that do not go together: a pool draws the next seed instead.
    if (!layout && i % 2 == 1 && layout.error().code == ErrorCode::kUnsupported) {
      ++left_out;
      continue;
    }
    if (!layout) {
      ++failed;
      ADD_FAILURE() << "seed " << request.seed << (i % 2 == 1 ? ", axes drawn: " : ": ")
                    << layout.error().message;
      continue;
    }
    refused += static_cast<int>(layout->refusals.size());
    hashes.insert(layout->map_hash);
    const auto wad = wad::WadFile::from_bytes({layout->wad.begin(), layout->wad.end()}, "layout");
    ASSERT_TRUE(wad) << wad.error().message;
    const auto map = wad->find_map("MAP01");
    ASSERT_TRUE(map && map->textmap && map->behavior) << "seed " << request.seed;
    ASSERT_TRUE(wad::parse_udmf(wad->text(*map->textmap), "layout"));
  }
  const double seconds = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
  std::printf("%s: %d layouts, %d failed, %d left out, %d attempts refused, %zu distinct, %.0f a second\n",
              GetParam().c_str(), count, failed, left_out, refused, hashes.size(), count / seconds);
  EXPECT_EQ(failed, 0);
  // Of the half that draws axes; Dumb Enemies for two makes one combination in six.
  EXPECT_LT(left_out, count * 9 / 20);
  EXPECT_GE(static_cast<int>(hashes.size()), count / 2 - left_out)
      << "every layout with drawn axes is its own map";
  EXPECT_LE(refused, count / 20);
#ifdef NDEBUG  // the claim is about optimised builds
  EXPECT_GT(count / seconds, 20.0);
#endif
}

INSTANTIATE_TEST_SUITE_P(All, AThousandLayouts, testing::ValuesIn(layout_recipes()),
                         [](const auto& one) { return one.param; });

}  // namespace thousand_layouts_test
}  // namespace comrad::scenarios

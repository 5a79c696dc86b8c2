#include "rollout_buffer/core/toml_text.h"

#include <gtest/gtest.h>

namespace comrad {
namespace toml_text_test {

TEST(TomlScalarText, ReadsBackAsTheValueThatWasWritten) {
  const toml::table document =
      toml::parse("a = \"x, y\"\nb = -7\nc = 0.1\nd = 2.0\ne = true\nf = false\ng = inf\n");
  const auto text = [&](const char* key) { return toml_scalar_text(*document.get(key)); };
  EXPECT_EQ(text("a"), "x, y");
  EXPECT_EQ(text("b"), "-7");
  EXPECT_EQ(text("c"), "0.1");
  EXPECT_EQ(text("d"), "2.0") << "a real number stays one";
  EXPECT_EQ(text("e"), "true");
  EXPECT_EQ(text("f"), "false");
  EXPECT_EQ(text("g"), "inf");
}

TEST(TomlScalarText, ListsTablesAndDatesAreNone) {
  const toml::table document = toml::parse("a = [1]\nb = {c = 1}\nd = 2020-01-01\n");
  for (const char* key : {"a", "b", "d"})
    EXPECT_FALSE(toml_scalar_text(*document.get(key)).has_value()) << key;
}

}  // namespace toml_text_test
}  // namespace comrad

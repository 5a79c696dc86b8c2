#include "rollout_buffer/core/layout_list.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace comrad {
namespace layout_list_test {

using ::testing::HasSubstr;

std::string error_of(std::string_view text) {
  const auto list = parse_layout_list(text, "pool.toml");
  return list ? "no error" : list.error().message;
}

TEST(LayoutListFile, WhatIsWrittenIsReadBack) {
  const LayoutList list{
      .layouts = {{"a_1", "/pool/a \"quoted\".wad", 47.0, 35.5}, {"b", "/pool/\xC3\xA4/b.wad", 0.0}},
      .interestingness_graph = "/pool/interestingness.json"};
  const auto read = parse_layout_list(layout_list_text(list), "pool.toml");
  ASSERT_TRUE(read) << read.error().message;
  ASSERT_EQ(read->layouts.size(), 2u);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(read->layouts[i].id, list.layouts[i].id);
    EXPECT_EQ(read->layouts[i].path, list.layouts[i].path);
    EXPECT_EQ(read->layouts[i].metric_scale, list.layouts[i].metric_scale);
    EXPECT_EQ(read->layouts[i].ceiling, list.layouts[i].ceiling);
  }
  EXPECT_EQ(read->interestingness_graph, list.interestingness_graph);
}

TEST(LayoutListFile, BadOnesAreNamed) {
  EXPECT_THAT(error_of(""), HasSubstr("lists no layouts"));
  EXPECT_THAT(error_of("layout = 3"), HasSubstr("lists no layouts"));
  EXPECT_THAT(error_of("layout = [{id = \"a\"}]"), HasSubstr("layout 0 needs the texts 'id' and 'path'"));
  EXPECT_THAT(error_of("layout = [{id = \"a\", path = \"x\"}, {id = \"a\", path = \"y\"}]"),
              HasSubstr("layout 1: there is another one named a"));
  EXPECT_THAT(error_of("layout = [{id = "), HasSubstr("pool.toml:1:"));
  EXPECT_THAT(error_of("[=]"), HasSubstr("pool.toml:1:"));
  EXPECT_THAT(read_layout_list("/nowhere").error().message, HasSubstr("--layout_pool"));
}

}  // namespace layout_list_test
}  // namespace comrad

#include "deploy/evaluation/csv.h"

#include <gtest/gtest.h>

#include <cmath>

namespace comrad::deploy {
namespace csv_test {

using Json = nlohmann::ordered_json;

TEST(Csv, ListsBecomeColumnsAndOddTextsAreQuoted) {
  const std::vector<Json> rows = {
      {{"policy", "a,b"}, {"J", 1.5}, {"J_per_agent", {1.0, 2.0}}, {"share", nullptr}, {"ended", true}},
      {{"policy", "say \"go\""},
       {"J", std::nan("")},
       {"J_per_agent", {3.0, 4.0}},
       {"share", 0.5},
       {"ended", false}}};
  EXPECT_EQ(csv_text(rows),
            "policy,J,J_per_agent_0,J_per_agent_1,share,ended\n"
            "\"a,b\",1.5,1.0,2.0,,true\n"
            "\"say \"\"go\"\"\",,3.0,4.0,0.5,false\n");
  EXPECT_EQ(csv_text({}), "");
  EXPECT_EQ(json_lines({Json{{"a", 1}}, Json{{"a", 2}}}), "{\"a\":1}\n{\"a\":2}\n");
}

}  // namespace csv_test
}  // namespace comrad::deploy

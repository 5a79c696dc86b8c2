#include "rollout_buffer/core/text.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "rollout_buffer/core/rng.h"

namespace comrad {
namespace text_test {

TEST(Case, TurnsLettersOfAsciiAndNothingElse) {
  for (int code = 0; code < 256; ++code) {
    const char c = static_cast<char>(code);
    const bool is_upper = code >= 65 && code <= 90, is_lower = code >= 97 && code <= 122;
    EXPECT_EQ(lower_case(c), static_cast<char>(is_upper ? code + 32 : code)) << code;
    EXPECT_EQ(upper_case(c), static_cast<char>(is_lower ? code - 32 : code)) << code;
  }
  EXPECT_EQ(lower_case(std::string_view("Door_Open2 [\xC4]")), "door_open2 [\xC4]");
  EXPECT_EQ(upper_case(std::string_view("Map01 {\xE4}")), "MAP01 {\xE4}");
  EXPECT_EQ(lower_case(std::string_view("A\0B", 3)), std::string("a\0b", 3));
}

TEST(SameIgnoringCase, ComparesWholeTexts) {
  EXPECT_TRUE(same_ignoring_case("", ""));
  EXPECT_TRUE(same_ignoring_case("ZombieMan", "zOMBIEmAN"));
  EXPECT_FALSE(same_ignoring_case("Zombie", "ZombieMan"));
  EXPECT_FALSE(same_ignoring_case("ZombieMan", "Zombie"));
  EXPECT_FALSE(same_ignoring_case("a[", "a{"));  // 32 apart, and no letters
  EXPECT_FALSE(same_ignoring_case("a@", "a`"));
}

TEST(Trimmed, TakesSpaceFromBothEndsAlone) {
  EXPECT_EQ(trimmed(" \t\r\n\f\v a b \v\f\n\r\t "), "a b");
  EXPECT_EQ(trimmed(" \t "), "");
  EXPECT_EQ(trimmed(""), "");
  EXPECT_EQ(trimmed("\x1F"
                    "a\xA0"),
            "\x1F"
            "a\xA0");
}

TEST(EditDistance, CountsTypingErrors) {
  EXPECT_EQ(edit_distance("", ""), 0u);
  EXPECT_EQ(edit_distance("", "abc"), 3u);
  EXPECT_EQ(edit_distance("abc", ""), 3u);
  EXPECT_EQ(edit_distance("kitten", "sitting"), 3u);
  EXPECT_EQ(edit_distance("szie", "size"), 1u);  // a swap is one
  EXPECT_EQ(edit_distance("ca", "abc"), 3u);     // no part is edited twice
  EXPECT_EQ(edit_distance("a", "A"), 1u);
}

/// The definition, written as it stands: the cheapest of four last steps.
std::size_t distance_by_definition(std::string_view a, std::string_view b) {
  if (a.empty() || b.empty()) return a.size() + b.size();
  const std::string_view a1 = a.substr(0, a.size() - 1), b1 = b.substr(0, b.size() - 1);
  std::size_t least = std::min({distance_by_definition(a1, b) + 1, distance_by_definition(a, b1) + 1,
                                distance_by_definition(a1, b1) + (a.back() != b.back())});
  if (!a1.empty() && !b1.empty() && a.back() == b1.back() && b.back() == a1.back())
    least =
        std::min(least, distance_by_definition(a1.substr(0, a1.size() - 1), b1.substr(0, b1.size() - 1)) + 1);
  return least;
}

TEST(EditDistance, IsThePlainRecursionOfItsDefinition) {
  Rng rng(RngKey(5).split("words"));
  const auto word = [&] {
    std::string text(static_cast<std::size_t>(rng.between(0, 6)), ' ');
    for (char& c : text) c = static_cast<char>('a' + rng.between(0, 2));
    return text;
  };
  for (int i = 0; i < 300; ++i) {
    const std::string a = word(), b = word();
    EXPECT_EQ(edit_distance(a, b), distance_by_definition(a, b)) << a << " " << b;
  }
}

TEST(NearestWord, FindsTyposAndRefusesUnknownWords) {
  const std::vector<std::string> known = {"seed", "rollout", "batch_size"};
  EXPECT_EQ(nearest_word("rolout", known), "rollout");
  EXPECT_EQ(nearest_word("Batch_Szie", known), "batch_size");
  EXPECT_EQ(nearest_word("sede", known), "seed");
  EXPECT_EQ(nearest_word("kangaroo", known), "");
  EXPECT_EQ(nearest_word("", known), "");
  EXPECT_EQ(nearest_word("seed", {}), "");
}

TEST(NearestWord, TheFirstOfEquallyNearOnesWins) {
  EXPECT_EQ(nearest_word("seet", {"seeb", "seed"}), "seeb");
  EXPECT_EQ(did_you_mean("rolout", {"rollout"}), "; did you mean 'rollout'?");
  EXPECT_EQ(did_you_mean("kangaroo", {"rollout"}), "");
}

TEST(BytesText, IsInMegabytesBelowAGigabyte) {
  EXPECT_EQ(bytes_text(0), "0.0 MB");
  EXPECT_EQ(bytes_text(20'000'000), "20.0 MB");
  EXPECT_EQ(bytes_text(999'000'000), "999.0 MB");
  EXPECT_EQ(bytes_text(1'000'000'000), "1.0 GB");
  EXPECT_EQ(bytes_text(1'540'000'000'000), "1540.0 GB");
}

TEST(ShellWord, QuotesWhatAShellWouldRead) {
  EXPECT_EQ(shell_word("plain-1.toml"), "plain-1.toml");
  EXPECT_EQ(shell_word("a b"), "'a b'");
  EXPECT_EQ(shell_word("it's"), "'it'\\''s'");
  EXPECT_EQ(shell_word(""), "''");
}

TEST(RealText, IsTheShortestThatReadsBack) {
  EXPECT_EQ(real_text(0.9995), "0.9995");
  EXPECT_EQ(real_text(0.1 + 0.2), "0.30000000000000004");
  EXPECT_EQ(real_text(-2), "-2.0") << "still a real number in TOML";
  EXPECT_EQ(real_text(0), "0.0");
  EXPECT_EQ(std::stod(real_text(4e-4)), 4e-4);
  EXPECT_EQ(std::stod(real_text(1e-300)), 1e-300);
  EXPECT_EQ(real_text(INFINITY), "inf");
}

TEST(Joined, SeparatesWordsByCommas) {
  EXPECT_EQ(joined({}), "");
  EXPECT_EQ(joined({"ippo"}), "ippo");
  EXPECT_EQ(joined({"ippo", "mappo", "happo"}), "ippo, mappo, happo");
  EXPECT_EQ(joined(std::vector<std::string>{"", "", "x"}), ", , x") << "an empty word keeps its place";
  EXPECT_EQ(joined(std::vector<int>{3, 3, 2}, ","), "3,3,2");
  EXPECT_EQ(joined(std::vector<std::string_view>{"a", "b"}, " | "), "a | b");
}

}  // namespace text_test
}  // namespace comrad

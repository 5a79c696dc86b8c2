#include "rollout_buffer/dds/keys.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <ctime>
#include <filesystem>
#include <fstream>
#include <random>

#include "rollout_buffer/core/files.h"
#include "rollout_buffer/dds/bus_config.h"
#include "tests/support/scratch_folder.h"

namespace comrad::dds {
namespace keys_test {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr int64_t kDay_s = 86'400;

std::string refusal(const std::string& folder) {
  const auto checked = check_keys(folder);
  return checked ? "" : checked.error().message;
}

std::string refusal(const Status& status) { return status ? "" : status.error().message; }

void write(const std::string& path, const std::string& bytes) {
  std::ofstream(path, std::ios::trunc | std::ios::binary) << bytes;
}

/// Keys of one authority with hosts a and b, rebuilt for each test.
class Keys : public ::testing::Test {
 protected:
  void SetUp() override {
    made_between_s_[0] = std::time(nullptr);
    ASSERT_EQ(refusal(make_keys({.folder = keys_, .hosts = {"a", "b"}, .days = 30, .start_s = 0})), "");
    made_between_s_[1] = std::time(nullptr);
  }
  const test::ScratchFolder folder_;
  const std::string keys_ = folder_.string() + "/keys", host_ = keys_ + "/hosts/a";
  int64_t made_between_s_[2] = {};
};

TEST_F(Keys, AreAsCheckExpectsThemAndForTheirOwnerAlone) {
  const auto run = check_keys(keys_ + "/run"), a = check_keys(host_), b = check_keys(keys_ + "/hosts/b");
  ASSERT_TRUE(run && a && b);
  EXPECT_EQ(run->role, KeyRole::kRun);
  EXPECT_EQ(a->role, KeyRole::kHost);
  EXPECT_EQ(a->name, "a");
  EXPECT_EQ(a->authority, run->authority);
  EXPECT_EQ(a->authority.size(), 16u);
  EXPECT_GE(a->until_s, made_between_s_[0] + 29 * kDay_s);
  EXPECT_LE(a->until_s, made_between_s_[1] + 29 * kDay_s);
  int files = 0;
  for (const auto& entry : fs::recursive_directory_iterator(keys_)) {
    struct stat status {};
    ASSERT_EQ(stat(entry.path().c_str(), &status), 0);
    EXPECT_EQ(status.st_mode & 0777, entry.is_directory() ? 0700u : 0600u) << entry.path();
    files += entry.is_regular_file();
  }
  EXPECT_EQ(files, 2 + 3 * 5);
  EXPECT_FALSE(fs::exists(host_ + "/authority.key")) << "the authority's key went to a host";
}

TEST_F(Keys, AreNeverReplaced) {
  const std::optional<std::string> before = read_file(host_ + "/identity.key");
  EXPECT_THAT(refusal(make_keys({.folder = keys_, .hosts = {"c"}})), HasSubstr("never replaced"));
  EXPECT_THAT(refusal(add_keys({.folder = keys_, .hosts = {"c", "a"}})), HasSubstr("hosts/a"));
  EXPECT_FALSE(fs::exists(keys_ + "/hosts/c")) << "half of the hosts were added";
  EXPECT_EQ(read_file(host_ + "/identity.key"), before);
}

TEST_F(Keys, MoreHostsHaveTheSameAuthorityAndEndWithIt) {
  ASSERT_EQ(refusal(add_keys({.folder = keys_, .hosts = {"c"}, .days = 3650})), "");
  const auto a = check_keys(host_), c = check_keys(keys_ + "/hosts/c");
  ASSERT_TRUE(a && c);
  EXPECT_EQ(c->authority, a->authority);
  EXPECT_EQ(c->until_s, a->until_s);
  EXPECT_THAT(refusal(add_keys({.folder = keys_, .hosts = {}})), HasSubstr("--hosts"));
  EXPECT_THAT(refusal(add_keys({.folder = folder_.string(), .hosts = {"c"}})), HasSubstr("keys make"));
}

TEST_F(Keys, NamesAndDaysAreChecked) {
  for (const char* name : {"", ".", "..", "../x", "a/b", "-x", "a b", "CN=x,O=y", "\xC3\xA4"})
    EXPECT_THAT(refusal(add_keys({.folder = keys_, .hosts = {name}})), HasSubstr("letters")) << name;
  EXPECT_THAT(refusal(add_keys({.folder = keys_, .hosts = {std::string(64, 'x')}})), HasSubstr("63"));
  EXPECT_THAT(refusal(add_keys({.folder = keys_, .hosts = {"x", "x"}})), HasSubstr("twice"));
  for (const int days : {0, -1, kMostKeyDays + 1})
    EXPECT_THAT(refusal(add_keys({.folder = keys_, .hosts = {"x"}, .days = days})), HasSubstr("days"));
}

TEST_F(Keys, WhatIsMissingOrReadableByOthersIsNamed) {
  for (const char* name :
       {"authority.pem", "identity.pem", "identity.key", "governance.p7s", "permissions.p7s"}) {
    fs::rename(host_ + "/" + name, host_ + "/away");
    EXPECT_THAT(refusal(host_), HasSubstr(host_ + "/" + name));
    fs::rename(host_ + "/away", host_ + "/" + name);
  }
  fs::permissions(host_ + "/identity.key", fs::perms::group_read, fs::perm_options::add);
  EXPECT_THAT(refusal(host_), AllOf(HasSubstr("identity.key"), HasSubstr("chmod 600")));
  EXPECT_THAT(refusal(keys_), HasSubstr("/hosts/<name>"));
  EXPECT_THAT(refusal(keys_ + "/no"), HasSubstr("keys make"));
}

TEST_F(Keys, TamperedDocumentsAreRefusedByName) {
  for (const std::string& name : std::vector<std::string>{"permissions.p7s", "governance.p7s"}) {
    const std::string path = host_ + "/" + name, whole = *read_file(path);
    std::string changed = whole;
    const std::size_t at = changed.find("<max>230");  // digits alone may lie in the boundary too
    ASSERT_NE(at, std::string::npos);
    changed[at + 5] = '9';
    write(path, changed);
    EXPECT_THAT(refusal(host_), AllOf(HasSubstr(path), HasSubstr("changed")));
    write(path, whole.substr(0, whole.size() / 2));
    EXPECT_THAT(refusal(host_), HasSubstr(path));
    write(path, whole);
  }
  EXPECT_EQ(refusal(host_), "");
}

TEST_F(Keys, PartsOfOtherKeysAreRefusedByName) {
  const std::string others = folder_.string() + "/others";
  ASSERT_EQ(refusal(make_keys({.folder = others, .hosts = {"a"}})), "");
  for (const std::string& name : std::vector<std::string>{"identity.pem", "identity.key", "authority.pem",
                                                          "governance.p7s", "permissions.p7s"}) {
    const std::string path = host_ + "/" + name, whole = *read_file(path);
    write(path, *read_file(others + "/hosts/a/" + name));
    EXPECT_NE(refusal(host_), "") << name;
    write(path, whole);
  }
  // Rights of another host with the same authority.
  write(host_ + "/permissions.p7s", *read_file(keys_ + "/hosts/b/permissions.p7s"));
  EXPECT_THAT(refusal(host_), AllOf(HasSubstr("permissions.p7s"), HasSubstr("CN=b"), HasSubstr("CN=a")));
}

TEST_F(Keys, ExpiredAndFutureOnesAreRefusedByName) {
  const int64_t now_s = std::time(nullptr);
  const std::string old = folder_.string() + "/old", early = folder_.string() + "/early";
  ASSERT_EQ(refusal(make_keys({.folder = old, .hosts = {"a"}, .days = 1, .start_s = now_s - kDay_s - 1})),
            "");
  ASSERT_EQ(refusal(make_keys({.folder = early, .hosts = {"a"}, .days = 1, .start_s = now_s + 3600})), "");
  EXPECT_THAT(refusal(old + "/hosts/a"), AllOf(HasSubstr("permissions.p7s"), HasSubstr("ended")));
  EXPECT_THAT(refusal(early + "/hosts/a"), AllOf(HasSubstr("permissions.p7s"), HasSubstr("clock")));
  EXPECT_THAT(refusal(add_keys({.folder = old, .hosts = {"b"}})), HasSubstr("ended"));
}

TEST_F(Keys, AnyBytesInAnyFileAreRefusedInWords) {
  const unsigned seed = std::random_device()();
  std::mt19937 random(seed);
  for (const std::string& name : std::vector<std::string>{"authority.pem", "identity.pem", "identity.key",
                                                          "governance.p7s", "permissions.p7s"}) {
    const std::string path = host_ + "/" + name, whole = *read_file(path);
    for (int round = 0; round < 20; ++round) {
      std::string bent = whole;
      for (int i = 0; i < 8; ++i) bent[random() % bent.size()] = static_cast<char>(random());
      write(path, bent);
      const auto checked = check_keys(host_);  // a change in an unsigned part may do no harm
      EXPECT_TRUE(checked || !checked.error().message.empty()) << name << " seed " << seed;
    }
    for (const std::string& bytes : {std::string("x"), std::string(1 << 21, '\n')}) {
      write(path, bytes);
      EXPECT_THAT(refusal(host_), HasSubstr(path));
    }
    write(path, whole);
  }
}

TEST_F(Keys, OnlyTheRunsMayServe) {
  BusConfig config = link_config(1);
  config.key_folder = host_;
  EXPECT_EQ(refusal(validate(config)), "");
  config.needs_keys_of_run = true;
  EXPECT_THAT(refusal(validate(config)), AllOf(HasSubstr("host 'a'"), HasSubstr("`run`")));
  config.key_folder = keys_ + "/run";
  EXPECT_EQ(refusal(validate(config)), "");
}

TEST_F(Keys, APathThatCyclonesConfigurationCannotHoldIsRefused) {
  const std::string odd = folder_.string() + "/a\"><b";
  fs::copy(host_, odd);
  const auto config = security_config(odd);
  ASSERT_FALSE(config);
  EXPECT_THAT(config.error().message, HasSubstr("move it"));
}

TEST(SecurityPlugins, AreFoundBesideCycloneByTheirFullPath) {
  const auto folder = security_plugins();
  ASSERT_TRUE(folder) << folder.error().message;
  EXPECT_TRUE(fs::path(*folder).is_absolute());
  EXPECT_TRUE(fs::exists(*folder + "/libdds_security_auth.so"));
}

}  // namespace keys_test
}  // namespace comrad::dds

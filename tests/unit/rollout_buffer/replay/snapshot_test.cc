// What a replay leaves on the disk, and what it makes of files that are damaged or made to harm.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <csignal>
#include <cstring>
#include <fstream>
#include <limits>

#include "rollout_buffer/replay/trajectory_store.h"
#include "tests/support/random_bytes.h"
#include "tests/unit/rollout_buffer/replay/replay_slabs.h"

namespace comrad::replay {
namespace snapshot_test {

namespace fs = std::filesystem;
using test::SlabPool;
using ::testing::AnyOf;
using ::testing::HasSubstr;

constexpr int64_t kCapacity = 20'000;

TrajectoryStore make(const TrajectoryShape& shape, int64_t capacity_bytes = kCapacity, bool compress = false,
                     const std::string& file = "") {
  auto store = TrajectoryStore::create(
      {.shape = shape, .capacity_bytes = capacity_bytes, .file = file, .compress = compress});
  EXPECT_TRUE(store.has_value()) << store.error().message;
  return std::move(*store);
}

uint32_t length_of(uint64_t number) { return static_cast<uint32_t>(1 + number % 8); }

void append(TrajectoryStore& store, uint64_t first, uint64_t count) {
  const SlabPool pool(store.shape(), 1);
  for (uint64_t number = first; number < first + count; ++number) {
    fill_slab(pool, store.shape(), number);
    ASSERT_EQ(store.append(pool.view(0), length_of(number)), static_cast<ItemId>(number));
  }
}

void expect_whole(const TrajectoryStore& store) {
  const SlabPool pool(store.shape(), 1);
  for (ItemId id = store.oldest(); id < store.end(); ++id) {
    fill_slab(pool, store.shape(), static_cast<uint64_t>(id));
    expect_same(store.item(id), pool.view(0), static_cast<int>(length_of(static_cast<uint64_t>(id))));
  }
}

std::string read_file(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

void write_file(const std::string& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

class SnapshotBetween : public ::testing::TestWithParam<std::tuple<Backing, Backing>> {};

TEST_P(SnapshotBetween, ComesBackWhole) {
  const auto& [from, to] = GetParam();
  const test::ScratchFolder folder;
  TrajectoryStore saver = make(small_shape(), kCapacity, from.compressed, from.mapped ? folder / "a" : "");
  append(saver, 0, 40);
  ASSERT_TRUE(saver.save(folder / "replay").has_value());
  EXPECT_FALSE(fs::exists(folder / "replay.new"));
  TrajectoryStore loader = make(small_shape(), 2 * kCapacity, to.compressed, to.mapped ? folder / "b" : "");
  append(loader, 0, 3);  // what was there before is replaced
  const Status loaded = loader.load(folder / "replay");
  ASSERT_TRUE(loaded.has_value()) << loaded.error().message;
  EXPECT_EQ(loader.end(), 40);
  EXPECT_EQ(loader.oldest(), saver.oldest());
  EXPECT_EQ(loader.transition_count(), saver.transition_count());
  EXPECT_EQ(loader.broken_decisions(), saver.broken_decisions());
  expect_whole(loader);
  append(loader, 40, 40);
  expect_whole(loader);
}

INSTANTIATE_TEST_SUITE_P(Backings, SnapshotBetween,
                         ::testing::Combine(::testing::ValuesIn(backings()), ::testing::ValuesIn(backings())),
                         [](const auto& one) {
                           return std::string(std::get<0>(one.param).name) + "To" +
                                  std::get<1>(one.param).name;
                         });

TEST(Snapshot, ContinuesExactlyAsTheSavedOne) {
  const test::ScratchFolder folder;
  TrajectoryStore saver = make(small_shape()), loader = make(small_shape());
  append(saver, 0, 57);  // somewhere in a later round of the ring
  ASSERT_TRUE(saver.save(folder / "replay").has_value());
  ASSERT_TRUE(loader.load(folder / "replay").has_value());
  for (uint64_t number = 57; number < 150; ++number) {
    append(saver, number, 1);
    append(loader, number, 1);
    ASSERT_EQ(loader.oldest(), saver.oldest()) << "after " << number << ": another item was evicted";
    ASSERT_EQ(loader.used_bytes(), saver.used_bytes());
  }
  expect_whole(loader);
}

TEST(Snapshot, TheNewestComeBackWhereNotAllFit) {
  const test::ScratchFolder folder;
  TrajectoryStore saver = make(small_shape(), 60'000), loader = make(small_shape(), kCapacity);
  append(saver, 0, 25);
  ASSERT_TRUE(saver.save(folder / "replay").has_value());
  ASSERT_TRUE(loader.load(folder / "replay").has_value());
  EXPECT_EQ(loader.end(), 25);
  EXPECT_GT(loader.oldest(), saver.oldest());
  EXPECT_GE(loader.item_count(), 4);
  expect_whole(loader);
}

TEST(Snapshot, AnEmptyOneIsOneToo) {
  const test::ScratchFolder folder;
  TrajectoryStore saver = make(small_shape()), loader = make(small_shape());
  ASSERT_TRUE(saver.save(folder / "replay").has_value());
  append(loader, 0, 3);
  ASSERT_TRUE(loader.load(folder / "replay").has_value());
  EXPECT_EQ(loader.item_count(), 0);
}

TEST(Snapshot, AnotherShapeIsNamed) {
  const test::ScratchFolder folder;
  TrajectoryStore saver = make(small_shape());
  append(saver, 0, 2);
  ASSERT_TRUE(saver.save(folder / "replay").has_value());
  TrajectoryShape shape = small_shape();
  shape.env.num_agents = 3;
  Status loaded = make(shape).load(folder / "replay");
  ASSERT_FALSE(loaded.has_value());
  EXPECT_EQ(loaded.error().code, ErrorCode::kBadInput);
  EXPECT_THAT(loaded.error().message, HasSubstr("num_agents 2, this run has 3"));
  shape = small_shape();
  shape.env.head_sizes = {4, 3};
  loaded = make(shape).load(folder / "replay");
  ASSERT_FALSE(loaded.has_value());
  EXPECT_THAT(loaded.error().message, HasSubstr("heads"));
}

TEST(Snapshot, APathThatCannotBeUsedIsNamed) {
  const test::ScratchFolder folder;
  TrajectoryStore store = make(small_shape());
  append(store, 0, 2);
  Status status = store.load(folder / "nothing");
  ASSERT_FALSE(status.has_value());
  EXPECT_EQ(status.error().code, ErrorCode::kNotFound);
  EXPECT_THAT(status.error().message, HasSubstr("nothing"));
  EXPECT_EQ(store.item_count(), 2) << "a file that is not there takes nothing away";
  status = store.save(folder / "no/such/folder");
  ASSERT_FALSE(status.has_value());
  EXPECT_EQ(status.error().code, ErrorCode::kNotFound);
  EXPECT_FALSE(store.load(folder / "").has_value());
  EXPECT_FALSE(store.save("/dev/null/replay").has_value());
}

TEST(Snapshot, ADiskThatFillsUpLeavesTheOlderOne) {
  const test::ScratchFolder folder;
  TrajectoryStore store = make(small_shape());
  append(store, 0, 4);
  ASSERT_TRUE(store.save(folder / "replay").has_value());
  const std::string before = read_file(folder / "replay");
  append(store, 4, 3);
  // A limit on the size of files replaces the full disk.
  struct rlimit old {};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &old), 0);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  const struct rlimit tight { 2000, old.rlim_max };
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &tight), 0);
  const Status saved = store.save(folder / "replay");
  setrlimit(RLIMIT_FSIZE, &old);
  std::signal(SIGXFSZ, handler);
  ASSERT_FALSE(saved.has_value());
  EXPECT_THAT(saved.error().message, HasSubstr("replay snapshot"));
  EXPECT_EQ(read_file(folder / "replay"), before);
  EXPECT_FALSE(fs::exists(folder / "replay.new"));
}

class DamagedSnapshot : public ::testing::Test {
 protected:
  void SetUp() override {
    TrajectoryStore saver = make(small_shape());
    append(saver, 0, 30);
    ASSERT_TRUE(saver.save(folder_ / "replay").has_value());
    sound_ = read_file(folder_ / "replay");
  }
  /// The error of loading these bytes; empty where they load. Afterwards the store is empty and usable.
  std::string error_of(const std::string& bytes) {
    write_file(folder_ / "damaged", bytes);
    append(store_, static_cast<uint64_t>(store_.end()), 1);
    const Status loaded = store_.load(folder_ / "damaged");
    if (loaded) return "";
    EXPECT_EQ(store_.item_count(), 0);
    EXPECT_EQ(store_.used_bytes(), 0);
    EXPECT_EQ(store_.transition_count(), 0);
    EXPECT_THAT(loaded.error().message, HasSubstr("damaged"));  // the file's name at least
    return loaded.error().message;
  }
  test::ScratchFolder folder_;
  std::string sound_;
  TrajectoryStore store_ = make(small_shape());
};

TEST_F(DamagedSnapshot, CutAnywhereIsRefused) {
  Rng rng(test::fuzz_seed());
  std::vector<std::size_t> sizes = {0, 1, 7, 55, 56, 57, sound_.size() - 1, sound_.size() - 56};
  for (int i = 0; i < 200; ++i) sizes.push_back(rng.below(static_cast<uint32_t>(sound_.size())));
  for (const std::size_t size : sizes)
    ASSERT_THAT(error_of(sound_.substr(0, size)), HasSubstr("cut short")) << size << " bytes";
}

TEST_F(DamagedSnapshot, AnotherVersionIsRefusedByItsNumberRatherThanByItsChecksums) {
  std::string bytes = sound_;
  constexpr std::size_t kVersionAt = sizeof(SectionHeader) + 8;  // behind the magic letters
  bytes[kVersionAt] = 3;
  bytes[sizeof(SectionHeader) - 1] ^= 1;  // of the first header's sum
  EXPECT_THAT(error_of(bytes), AllOf(HasSubstr("version 3"), HasSubstr("version 4"), HasSubstr("remove it")));
}

TEST_F(DamagedSnapshot, AFlippedBitAnywhereIsFound) {
  Rng rng(test::fuzz_seed());
  for (int i = 0; i < 400; ++i) {
    std::string bytes = sound_;
    const std::size_t at =
        i < 100 ? static_cast<std::size_t>(i) : rng.below(static_cast<uint32_t>(bytes.size()));
    bytes[at] = static_cast<char>(bytes[at] ^ (1 << rng.below(8)));
    ASSERT_NE(error_of(bytes), "") << "byte " << at << ", seed " << test::fuzz_seed();
  }
}

TEST_F(DamagedSnapshot, BytesOfChanceAndBytesBehindTheEndAreRefused) {
  Rng rng(test::fuzz_seed());
  for (int i = 0; i < 200; ++i) {
    const std::vector<uint8_t> noise = test::random_bytes(rng, rng.below(3000));
    ASSERT_NE(error_of({noise.begin(), noise.end()}), "");
    ASSERT_NE(error_of(test::mutated(rng, sound_) + "x"), "");
  }
  EXPECT_THAT(error_of(sound_ + "x"), HasSubstr("continues behind its end"));
  EXPECT_THAT(error_of(read_file("/proc/self/exe").substr(0, 100'000)), HasSubstr("damaged"));
}

/// Sections of a snapshot, to be changed and written again with right checksums.
struct Section {
  SectionHeader header;
  std::vector<std::byte> bytes;
};

std::vector<Section> sections_of(const std::string& path) {
  auto reader = SnapshotReader::open(path);
  std::vector<Section> sections;
  while (true) {
    Section section;
    auto header = reader->next(section.bytes);
    if (!header || header->tag == static_cast<uint32_t>(SectionTag::kEnd)) return sections;
    section.header = *header;
    sections.push_back(section);
  }
}

TEST_F(DamagedSnapshot, NonsenseWithRightChecksumsIsRefusedOrHarmless) {
  const std::vector<Section> sound = sections_of(folder_ / "replay");
  ASSERT_GT(sound.size(), 5u);
  const auto load_changed = [&](const std::vector<Section>& sections) {
    auto writer = SnapshotWriter::create(folder_ / "made", 0);
    for (const Section& section : sections)
      EXPECT_TRUE(writer->write(section.header, section.bytes).has_value());
    EXPECT_TRUE(writer->finish().has_value());
    return error_of(read_file(folder_ / "made"));
  };
  ASSERT_EQ(load_changed(sound), "");
  const auto change = [&](auto&& how) {
    std::vector<Section> sections = sound;
    how(sections);
    return load_changed(sections);
  };
  EXPECT_NE(change([](auto& all) { all[2].header.length = 9; }), "");
  EXPECT_NE(change([](auto& all) { all[2].header.length = -1; }), "");
  EXPECT_NE(change([](auto& all) { all[2].header.length = INT32_MAX; }), "");
  EXPECT_NE(change([](auto& all) { all[2].header.finals = 4; }), "");
  EXPECT_NE(change([](auto& all) { all[2].header.finals = INT32_MIN; }), "");
  EXPECT_NE(change([](auto& all) { all[2].header.flags ^= 1; }), "");
  EXPECT_NE(change([](auto& all) { all[2].header.flags = 0xFFFF; }), "");
  EXPECT_NE(change([](auto& all) { all[2].header.flags ^= 4; }), "");
  EXPECT_NE(change([](auto& all) { all[2].header.id += 1; }), "");
  EXPECT_NE(change([](auto& all) { all[2].header.offset = -64; }), "");
  EXPECT_NE(change([](auto& all) { all[2].header.offset = 1; }), "");
  EXPECT_NE(change([](auto& all) { all[2].header.offset = INT64_MAX - 63; }), "");
  EXPECT_NE(change([](auto& all) { all[2].header.offset = all[3].header.offset; }), "");
  EXPECT_NE(change([](auto& all) { all[2].bytes.resize(all[2].bytes.size() - 1); }), "");
  EXPECT_NE(change([](auto& all) { all.erase(all.begin() + 2); }), "");
  EXPECT_NE(change([](auto& all) { all.erase(all.begin()); }), "");
  EXPECT_NE(change([](auto& all) { std::swap(all[2], all[3]); }), "");
  EXPECT_NE(change([](auto& all) { all[0].bytes.pop_back(); }), "");

  // Any byte of header and small fields: refused, or what loads can be read without harm.
  Rng rng(test::fuzz_seed());
  int harmless = 0;
  for (int round = 0; round < 400; ++round) {
    std::vector<Section> sections = sound;
    Section& victim = sections[rng.below(4) == 0 ? 0 : rng.below(static_cast<uint32_t>(sections.size()))];
    const std::size_t small = std::min<std::size_t>(victim.bytes.size(), 700);
    for (uint32_t i = 0; i <= rng.below(3); ++i)
      victim.bytes[rng.below(static_cast<uint32_t>(small))] = static_cast<std::byte>(rng.next());
    if (!load_changed(sections).empty()) continue;
    ++harmless;
    for (ItemId id = store_.oldest(); id < store_.end(); ++id) {
      const StoredTrajectory item = store_.item(id);
      for (int step = 0; step < item.length(); ++step) {
        for (std::size_t i = 0; i < 4; ++i)
          ASSERT_LT(item.action(step)[i], small_shape().env.head_sizes[i % 2]);
        ASSERT_TRUE(std::isfinite(item.reward(step)[1]));
        ASSERT_LT(item.final_row(step), item.final_count());
        ASSERT_TRUE(item.final_row(step) >= 0 || !item.truncated(step) || !item.valid(step));
      }
    }
  }
  EXPECT_GT(harmless, 10);
}

TEST(Snapshot, DamageInACompressedOneIsRefusedOrHarmless) {
  const test::ScratchFolder folder;
  TrajectoryStore saver = make(small_shape(), kCapacity, true), loader = make(small_shape());
  append(saver, 0, 10);
  ASSERT_TRUE(saver.save(folder / "replay").has_value());
  const std::vector<Section> sound = sections_of(folder / "replay");
  Rng rng(test::fuzz_seed());
  int refused = 0, loaded = 0;
  for (int round = 0; round < 200; ++round) {
    std::vector<Section> sections = sound;
    Section& victim = sections[1 + rng.below(static_cast<uint32_t>(sections.size() - 1))];
    victim.bytes[rng.below(static_cast<uint32_t>(victim.bytes.size()))] = static_cast<std::byte>(rng.next());
    auto writer = SnapshotWriter::create(folder / "made", 0);
    for (const Section& section : sections)
      ASSERT_TRUE(writer->write(section.header, section.bytes).has_value());
    ASSERT_TRUE(writer->finish().has_value());
    (loader.load(folder / "made") ? loaded : refused) +=
        1;  // frames are decoded on the way: a sanitizer's eye
  }
  EXPECT_GT(refused, 10);
  EXPECT_GT(loaded, 10);
}

}  // namespace snapshot_test
}  // namespace comrad::replay

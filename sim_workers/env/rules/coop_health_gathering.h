// The rules of Co-op Health Gathering: a floor that hurts, kits that appear, a tether that pulls, and a map
// that ends one tic after the first death. Stage: tic.
//
// Exported variables: 1 kits lying about, 2 kits spawned, 3 tether stretches, 4 kits taken by the team, 5
// flash timer, 57..60 kits taken by player 1..4.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "sim_workers/env/rules/native_rules.h"

namespace comrad::sim {

class CoopHealthGatheringRules final : public NativeRules {
 public:
  static constexpr int kFirstPickupExport = 57;
  static constexpr int kTetherNodeCount = 30;

  /// Adds TetherCalm, TetherWarn and TetherHot.
  static void add_actors(doom::ActorCatalog& catalog);
  /// Reads tether, damage and kit_cap from the layout; the published defaults where it does not say.
  static std::unique_ptr<NativeRules> make(const scenarios::LayoutInfo& layout,
                                           const doom::ActorCatalog& catalog);

  void on_open(doom::World& world) override;
  void on_enter(doom::World& world, int player) override;
  void on_tic(doom::World& world) override;
  void on_death(doom::World& world, int player) override;
  void on_pickup(doom::World& world, int player, const doom::Actor& item) override;
  uint64_t state_hash() const override;

 private:
  enum class Strain : uint8_t { kCalm, kWarn, kHot };
  /// The tether between player i and player i + 1.
  struct Link {
    int64_t distance = 0;   ///< 16.16, max + min / 2
    bool is_stuck = false;  ///< overstretched after the last pull
    Strain drawn_as = Strain::kCalm;
    std::vector<uint32_t> nodes;  ///< actor ids
  };
  struct Spot {
    doom::Fixed x = 0, y = 0, z = 0;
  };

  CoopHealthGatheringRules(const scenarios::LayoutInfo& layout, const doom::ActorCatalog& catalog);
  void spawn_kits(doom::World& world);
  void pull(doom::World& world, int first);
  void draw_tether(doom::World& world, int first);
  void draw_bar(doom::World& world) const;
  void export_counters(doom::World& world) const;
  Strain strain(int64_t distance) const;

  doom::Fixed tether_;
  int32_t damage_, kit_cap_;
  uint32_t stimpack_, medikit_;
  std::array<uint32_t, 3> node_types_{};  // by Strain

  std::vector<Spot> spots_;
  std::vector<Link> links_;
  std::array<int32_t, 4> taken_by_{};
  int64_t tic_ = 0;
  int32_t spawned_ = 0, taken_ = 0, stretches_ = 0, flash_tics_ = 0;
  int32_t exit_in_tics_ = -1;  // -1: nobody has died
};

}  // namespace comrad::sim

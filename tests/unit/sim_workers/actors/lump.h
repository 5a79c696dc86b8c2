// A DECORATE lump read on top of the built-in actors, with its warnings.
#pragma once

#include <gtest/gtest.h>

#include <string>
#include <string_view>
#include <vector>

#include "sim_workers/engine/actors/actor_catalog.h"
#include "sim_workers/engine/actors/decorate.h"

namespace comrad::doom::test {

inline const ActorCatalog& builtin_catalog() {
  static const ActorCatalog kCatalog;
  return kCatalog;
}

struct Lump {
  explicit Lump(std::string_view text) : catalog(builtin_catalog()) {
    const Status status = parse_decorate(text, "test.wad", &catalog, &warnings);
    if (!status) error = status.error().message;
  }
  const ActorType& type(std::string_view name) const {
    const auto index = catalog.find(name);
    EXPECT_TRUE(index.has_value()) << name;
    return catalog[index.value_or(0)];
  }
  uint32_t label(std::string_view name, std::string_view label_name) const {
    return type(name).find_label(label_name);
  }
  const State& state(std::string_view name, std::string_view label_name, uint32_t offset = 0) const {
    const uint32_t first = label(name, label_name);
    EXPECT_NE(first, kNoState) << name << " " << label_name;
    return catalog.state(first == kNoState ? 0 : first + offset);
  }

  ActorCatalog catalog;
  std::vector<std::string> warnings;
  std::string error;
};

/// "POSS A 10 Look -> +1" and the like, one line per state, until the program leads back or ends.
inline std::string walk(const ActorCatalog& catalog, uint32_t first, int limit = 64) {
  std::string text;
  std::vector<uint32_t> seen;
  for (uint32_t place = first; place != kNoState && limit > 0; --limit) {
    for (std::size_t i = 0; i < seen.size(); ++i)
      if (seen[i] == place) return text + "@" + std::to_string(i);
    seen.push_back(place);
    const State& state = catalog.state(place);
    text +=
        catalog.sprite_name(state.sprite) + static_cast<char>('A' + state.frame) + std::to_string(state.tics);
    if (state.bright) text += "*";
    if (state.action != ActionId::kNone) text += ":" + std::string(action_name(state.action));
    text += " ";
    place = state.next;
  }
  return text + ".";
}

}  // namespace comrad::doom::test

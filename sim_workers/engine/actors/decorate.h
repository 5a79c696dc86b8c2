// Reads DECORATE lumps: new actors that inherit from known ones. A subset, listed in sim_workers/ACTORS_AND_SCRIPTS.md;
// what it does not know is one warning that names it, what is broken is an error. Stage: loading.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "sim_workers/engine/actors/actor_catalog.h"

namespace comrad::doom {

/// The text of a lump that #include names; it stays valid while the parser runs.
using DecorateIncludes = std::function<std::optional<std::string_view>(std::string_view name)>;

/// Adds the actors of `text` to `catalog`, those of lumps that it includes in their place. `label` names the lump in messages. `warnings` gets one line per
/// unknown property, flag or action function ("label:line: ..."). Errors: kBadFormat as "label:line:column:
/// what", the catalog is then as it was.
Status parse_decorate(std::string_view text, const std::string& label, ActorCatalog* catalog,
                      std::vector<std::string>* warnings, const DecorateIncludes& includes = nullptr);

}  // namespace comrad::doom

// Reads DECORATE lumps: new actors that inherit from known ones. A subset, listed in sim_workers/README.md;
// what it does not know is one warning that names it, what is broken is an error. Stage: loading.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "sim_workers/engine/actors/actor_catalog.h"

namespace comrad::doom {

/// Adds the actors of `text` to `catalog`. `label` names the lump in messages. `warnings` gets one line per
/// unknown property, flag or action function ("label:line: ..."). Errors: kBadFormat as "label:line:column:
/// what", the catalog is then as it was.
Status parse_decorate(std::string_view text, const std::string& label, ActorCatalog* catalog,
                      std::vector<std::string>* warnings);

}  // namespace comrad::doom

#include "sim_workers/engine/acs/behavior_linker.h"

#include <algorithm>
#include <cstddef>

#include "rollout_buffer/core/log.h"
#include "sim_workers/engine/acs/strings.h"

namespace comrad::doom::acs {

void BehaviorLinker::add(const Behavior& library, const BehaviorLinks& links) {
  links_.push_back(links);
  while (all_.code_.size() % 4 != 0) all_.code_.push_back(0);  // as the lump's own tables are aligned
  Module module = library.modules_.front();
  module.begin = static_cast<uint32_t>(all_.code_.size());
  module.first_function = static_cast<uint32_t>(all_.functions_.size());
  module.first_string = static_cast<uint32_t>(all_.strings_.size());
  module.first_jump = static_cast<uint32_t>(all_.jumps_.size());
  const auto first_variable = static_cast<uint16_t>(all_.map_variables_.size());
  for (uint16_t& number : module.variables) number = static_cast<uint16_t>(number + first_variable);

  all_.code_.insert(all_.code_.end(), library.code_.begin(), library.code_.end());
  all_.strings_.insert(all_.strings_.end(), library.strings_.begin(), library.strings_.end());
  all_.jumps_.insert(all_.jumps_.end(), library.jumps_.begin(), library.jumps_.end());
  for (Function function : library.functions_) {
    if (!function.imported) function.address += module.begin;
    all_.functions_.push_back(std::move(function));
  }
  int32_t last_named = 0;
  for (const Script& script : all_.scripts_) last_named = std::min(last_named, script.number);
  for (Script script : library.scripts_) {
    if (script.number >= 0 ? all_.find_script(script.number) != nullptr
                           : all_.find_script(script.name) != nullptr)
      continue;
    if (script.number < 0) script.number = --last_named;
    script.address += module.begin;
    all_.scripts_.push_back(std::move(script));
  }

  const auto text_number = [&](int32_t number) { return number + static_cast<int32_t>(module.first_string); };
  std::vector<int32_t> variables = library.map_variables_;
  std::vector<MapArray> arrays = library.arrays_;
  for (const uint32_t number : links.texts) {
    if (const int slot = library.array_of(number); slot >= 0) {
      for (int32_t& value : arrays[static_cast<std::size_t>(slot)].initial) value = text_number(value);
    } else if (number < variables.size()) {
      variables[number] = text_number(variables[number]);
    }
  }
  all_.map_variables_.insert(all_.map_variables_.end(), variables.begin(), variables.end());
  all_.array_slots_.resize(all_.map_variables_.size(), -1);
  for (MapArray& array : arrays) {
    array.index += first_variable;
    all_.array_slots_[static_cast<std::size_t>(array.index)] = static_cast<int16_t>(all_.arrays_.size());
    all_.arrays_.push_back(std::move(array));
  }
  all_.modules_.push_back(module);
}

void BehaviorLinker::resolve() {
  for (Function& function : all_.functions_) {
    if (!function.imported) continue;
    const auto found =
        std::find_if(all_.functions_.begin(), all_.functions_.end(),
                     [&](const Function& other) { return !other.imported && other.name == function.name; });
    if (found != all_.functions_.end()) function = *found;  // a call that does not find one is an error
  }
  for (std::size_t module = 0; module < all_.modules_.size(); ++module) {
    for (const BehaviorLinks::Variable& wanted : links_[module].imported) {
      bool found = false;
      for (std::size_t other = 0; other < all_.modules_.size() && !found; ++other) {
        const std::vector<std::string>& names = links_[other].exported;
        const auto name = std::find(names.begin(), names.end(), wanted.name);
        const auto number = static_cast<std::size_t>(name - names.begin());
        if (other == module || number >= std::min(names.size(), kMapVariableCount)) continue;
        all_.modules_[module].variables[wanted.number] = all_.modules_[other].variables[number];
        found = true;
      }
      if (!found)
        spdlog::warn("{}: the variable {} is in none of the libraries; it is 0", all_.label_,
                     printable(wanted.name));
    }
  }
}

}  // namespace comrad::doom::acs

#include "sim_workers/engine/actors/builtin.h"

#include <algorithm>
#include <charconv>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "rollout_buffer/core/check.h"
#include "sim_workers/engine/actors/builtin_tables.h"
#include "sim_workers/engine/actors/state_program.h"

namespace comrad::doom {
namespace {

/// Reads one row of a program. A mistake in a table is a bug of ours, so it trips a check.
class RowReader {
 public:
  RowReader(ActorCatalog* catalog, StateProgram* program, std::string_view row)
      : catalog_(catalog), program_(program), row_(row) {}

  void read(uint32_t* sprite) {
    std::string_view word = next_word();
    while (word.ends_with(':')) {
      program_->add_label(word.substr(0, word.size() - 1));
      word = next_word();
    }
    if (word.empty()) return;
    if (word == "again") {
      check(program_->loop());
    } else if (word == "stay") {
      check(program_->wait());
    } else if (word == "gone") {
      check(program_->stop());
    } else if (word == "to") {
      check(program_->go_to(target(next_word())));
    } else {
      read_picture(word, sprite);
    }
    check(next_word().empty());
  }

 private:
  void check(bool good) const {
    COMRAD_CHECK(good, "row of a built-in actor's states: " + std::string(row_));
  }

  std::string_view next_word() {
    const std::size_t start = std::min(row_.find_first_not_of(' ', place_), row_.size());
    std::size_t end = std::min(row_.find(' ', start), row_.size());
    if (const std::size_t open = row_.find('(', start); open < end) end = row_.find(')', open) + 1;
    place_ = end;
    return row_.substr(start, end - start);
  }

  StateTarget target(std::string_view word) const {
    StateTarget target;
    const std::size_t plus = word.find('+');
    if (plus != std::string_view::npos) target.offset = number(word.substr(plus + 1));
    target.label = word.substr(0, plus);
    return target;
  }

  int32_t number(std::string_view word) const {
    int32_t value = 0;
    check(std::from_chars(word.data(), word.data() + word.size(), value).ptr == word.data() + word.size());
    return value;
  }

  void read_picture(std::string_view word, uint32_t* sprite) {
    State state;
    std::string_view letters = word, tics = next_word();
    if (!tics.empty() && tics.front() != '-' && (tics.front() < '0' || tics.front() > '9')) {
      *sprite = catalog_->add_sprite(word);
      letters = tics;
      tics = next_word();
    }
    state.sprite = *sprite;
    if (tics.ends_with('f')) state.fast = true, tics.remove_suffix(1);
    if (tics.ends_with('*')) state.bright = true, tics.remove_suffix(1);
    state.tics = static_cast<int16_t>(number(tics));
    std::vector<PendingArg> args;
    if (std::string_view call = next_word(); !call.empty()) {
      const std::size_t open = call.find('(');
      const std::optional<ActionId> action = find_action(call.substr(0, open));
      check(action.has_value());
      state.action = *action;
      if (open != std::string_view::npos) {
        std::string_view list = call.substr(open + 1, call.size() - open - 2);
        while (!list.empty()) {
          const std::size_t comma = std::min(list.find(','), list.size());
          args.push_back(argument(list.substr(0, comma)));
          list.remove_prefix(std::min(comma + 1, list.size()));
        }
      }
    }
    for (const char letter : letters) {
      check(letter >= 'A' && letter <= ']');
      state.frame = static_cast<uint8_t>(letter - 'A');
      program_->add_state(state, args);
    }
  }

  PendingArg argument(std::string_view word) const {
    PendingArg arg;
    if (word.front() == '-' || (word.front() >= '0' && word.front() <= '9')) {
      arg.value = {ActionArg::Kind::kInteger, number(word), 0};
    } else if (const std::optional<uint32_t> type = catalog_->find(word)) {
      arg.value = {ActionArg::Kind::kType, static_cast<int32_t>(*type), 0};
    } else {
      arg.is_target = true;
      arg.target = target(word);
    }
    return arg;
  }

  ActorCatalog* catalog_;
  StateProgram* program_;
  std::string_view row_;
  std::size_t place_ = 0;
};

}  // namespace

ActorType start_type(const ActorCatalog& catalog, std::string_view parent, std::string_view name,
                     int32_t editor_number, int32_t spawn_id) {
  ActorType type = catalog.derived(type_index(catalog, parent), name);
  type.editor_number = editor_number;
  type.spawn_id = spawn_id;
  return type;
}

void set_flags(ActorType* type, FlagList flags, bool on) {
  for (const ActorFlag flag : flags) type->flags.set(flag, on);
}

uint32_t type_index(const ActorCatalog& catalog, std::string_view name) {
  const std::optional<uint32_t> index = catalog.find(name);
  COMRAD_CHECK(index.has_value(), "a built-in actor names '" + std::string(name) + "' before it is there");
  return *index;
}

uint32_t add_type(ActorCatalog* catalog, ActorType type, std::string_view program) {
  StateProgram states;
  uint32_t sprite = 0;
  while (!program.empty()) {
    const std::size_t end = std::min(program.find(';'), program.size());
    RowReader(catalog, &states, program.substr(0, end)).read(&sprite);
    program.remove_prefix(std::min(end + 1, program.size()));
  }
  const Status status = states.finish(catalog, &type);
  COMRAD_CHECK(status.has_value(), type.name + ": " + (status ? std::string() : status.error().message));
  return catalog->add(std::move(type));
}

void add_builtin_actors(ActorCatalog* catalog) {
  add_base_types(catalog);
  add_effects(catalog);
  add_items(catalog);
  add_weapons(catalog);
  add_players(catalog);
  add_monsters(catalog);
  add_marines(catalog);
  add_scenery(catalog);
  add_markers(catalog);
}

}  // namespace comrad::doom

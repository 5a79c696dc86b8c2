#include "sim_workers/engine/actors/state_program.h"

#include <spdlog/fmt/fmt.h>

#include <optional>
#include <utility>

#include "rollout_buffer/core/text.h"
#include "sim_workers/engine/actors/state_labels.h"

namespace comrad::doom {
namespace {

Error no_place(const StateTarget& target, const std::string& what) {
  return {ErrorCode::kBadFormat, fmt::format("{}:{}: {}", target.line, target.column, what)};
}

std::string name_of(const StateTarget& target) {
  return (target.scope.empty() ? "" : target.scope + "::") + target.label;
}

/// The type whose labels `scope` means; null for a name that is no ancestor's.
const ActorType* scope_type(const ActorCatalog& catalog, const ActorType& type, const std::string& scope) {
  if (same_ignoring_case(scope, "Super"))
    return type.parent < catalog.size() ? &catalog[type.parent] : nullptr;
  const std::optional<uint32_t> named = catalog.find(scope);
  return named && catalog.is_a(type.parent, *named) ? &catalog[*named] : nullptr;
}

}  // namespace

void StateProgram::add_label(std::string_view name) {
  labels_.push_back({.name = lower_case(name), .place = states_.size(), .alias = {}});
  ++open_labels_;
}

void StateProgram::add_state(const State& state, std::vector<PendingArg> args) {
  states_.push_back({.state = state, .args = std::move(args), .target = {}});
  open_labels_ = 0;
  linked_ = false;
}

bool StateProgram::end_labels(bool gone, const StateTarget* alias) {
  if (open_labels_ == 0) return false;
  for (std::size_t label = labels_.size() - open_labels_; label < labels_.size(); ++label) {
    labels_[label].gone = gone;
    labels_[label].is_alias = alias != nullptr;
    if (alias != nullptr) labels_[label].alias = *alias;
  }
  open_labels_ = 0;
  return true;
}

bool StateProgram::loop() {
  if (linked_ || open_labels_ > 0 || labels_.empty()) return false;
  std::size_t label = labels_.size() - 1;
  while (label > 0 && (labels_[label].gone || labels_[label].is_alias)) --label;
  if (labels_[label].place >= states_.size()) return false;
  states_.back().link = Link::kLoop;
  states_.back().loop_to = labels_[label].place;
  return linked_ = true;
}

bool StateProgram::wait() {
  if (linked_ || open_labels_ > 0) return false;
  states_.back().link = Link::kSelf;
  return linked_ = true;
}

bool StateProgram::stop() {
  if (end_labels(true, nullptr)) return true;
  if (linked_) return false;
  states_.back().link = Link::kGone;
  return linked_ = true;
}

bool StateProgram::fail() {
  if (!stop()) return false;
  if (!states_.empty()) states_.back().state.fails = true;
  return true;
}

bool StateProgram::go_to(StateTarget target) {
  if (end_labels(false, &target)) return true;
  if (linked_) return false;
  states_.back().link = Link::kTarget;
  states_.back().target = std::move(target);
  return linked_ = true;
}

Status StateProgram::finish(ActorCatalog* catalog, ActorType* type, std::vector<StateTarget>* missing) const {
  const uint32_t base = static_cast<uint32_t>(catalog->state_count());
  const uint64_t end = uint64_t{base} + states_.size();

  // The label list that targets see: the parent's with the type's own on top. Aliases come last, because they
  // may name any of them.
  ActorType labelled;
  labelled.parent = type->parent;
  labelled.labels = type->labels;
  labelled.states = type->states;
  for (const Label& label : labels_)
    if (!label.is_alias)
      set_label(
          &labelled, label.name,
          label.gone || label.place >= states_.size() ? kNoState : base + static_cast<uint32_t>(label.place));
  const auto find = [&](const StateTarget& target) -> Expected<uint32_t> {
    const ActorType* owner = &labelled;
    if (!target.scope.empty()) owner = scope_type(*catalog, labelled, target.scope);
    if (owner == nullptr) return no_place(target, "'" + target.scope + "' is no ancestor of this actor");
    bool known = false;
    uint32_t state = kNoState;
    for (const ActorType::Label& label : owner->labels)
      if (same_ignoring_case(label.name, target.label)) known = true, state = label.state;
    if (!known) return no_place(target, "no state label '" + name_of(target) + "'");
    if (state == kNoState) return kNoState;
    const int64_t place = int64_t{state} + target.offset;
    if (place < 0 || place >= static_cast<int64_t>(end))
      return no_place(target, "'" + name_of(target) + "' has no state so many further on");
    return static_cast<uint32_t>(place);
  };
  for (const Label& label : labels_)
    if (label.is_alias) {
      COMRAD_TRY_ASSIGN(const uint32_t state, find(label.alias));
      set_label(&labelled, label.name, state);
    }

  std::vector<State> states;
  std::vector<std::vector<ActionArg>> args(states_.size());
  states.reserve(states_.size());
  for (std::size_t place = 0; place < states_.size(); ++place) {
    const Step& step = states_[place];
    State state = step.state;
    const uint32_t own = base + static_cast<uint32_t>(place);
    switch (step.link) {
      case Link::kNext:
        state.next = place + 1 < states_.size() ? own + 1 : kNoState;
        break;
      case Link::kSelf:
        state.next = own;
        break;
      case Link::kLoop:
        state.next = base + static_cast<uint32_t>(step.loop_to);
        break;
      case Link::kGone:
        state.next = kNoState;
        break;
      case Link::kTarget: {
        COMRAD_TRY_ASSIGN(state.next, find(step.target));
        break;
      }
    }
    for (const PendingArg& arg : step.args) {
      ActionArg value = arg.value;
      if (arg.is_target) {
        value.kind = ActionArg::Kind::kState;
        if (arg.target.label.empty()) {
          const int64_t target = int64_t{own} + arg.target.offset;
          if (target < base || target >= static_cast<int64_t>(end))
            return no_place(arg.target, "the jump leaves this actor's states");
          value.a = static_cast<int32_t>(target);
        } else if (const Expected<uint32_t> target = find(arg.target); target.has_value()) {
          value.a = static_cast<int32_t>(*target);
        } else if (missing != nullptr && arg.target.scope.empty() && arg.target.offset == 0) {
          missing->push_back(arg.target);
          value.a = static_cast<int32_t>(kNoState);
        } else {
          return target.error();
        }
      }
      args[place].push_back(value);
    }
    states.push_back(state);
  }

  // Nothing can fail any more.
  for (std::size_t place = 0; place < states.size(); ++place) {
    const Step& step = states_[place];
    for (std::size_t arg = 0; arg < args[place].size(); ++arg)
      if (const StateTarget& target = step.args[arg].target;
          step.args[arg].is_target && target.scope.empty() && !target.label.empty() && target.offset == 0)
        args[place][arg].b = catalog->add_text(lower_case(target.label));
    states[place].arg_count = static_cast<uint8_t>(args[place].size());
    if (!args[place].empty()) states[place].first_arg = catalog->add_args(args[place]);
    catalog->add_state(states[place]);
  }
  type->labels = std::move(labelled.labels);
  type->states = labelled.states;
  return {};
}

}  // namespace comrad::doom

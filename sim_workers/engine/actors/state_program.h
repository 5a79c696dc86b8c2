// States of one type on their way into the catalog: written down in order with the labels and links between
// them, then added all at once when every link is known. DECORATE lumps and the built-in tables both end
// here. Stage: loading.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "sim_workers/engine/actors/actor_catalog.h"

namespace comrad::doom {

constexpr std::size_t kStatesPerTypeMax = 4096;

/// A place that states lead to: "See", "See+2", "Super::See", "Cacodemon::See".
struct StateTarget {
  std::string scope;  ///< empty: the type itself; "Super": its parent; else an ancestor's name
  std::string label;  ///< empty: relative to the state that names it
  int32_t offset = 0;
  int32_t line = 0, column = 0;  ///< where it was written, for messages
};

/// One argument of an action: known, or a place to be found when the type is complete.
struct PendingArg {
  ActionArg value;
  bool is_target = false;
  StateTarget target;
};

class StateProgram {
 public:
  std::size_t size() const { return states_.size(); }
  /// The following state is called `name`.
  void add_label(std::string_view name);
  /// `state.next` is the one that follows, until a link changes it.
  void add_state(const State& state, std::vector<PendingArg> args = {});

  // Links of the last state, or of the labels before them where no state follows. False: there is nothing
  // that they could belong to.
  bool loop();  ///< back to the last label
  bool wait();  ///< the last state again and again
  bool stop();  ///< the actor goes
  bool fail();  ///< a custom item is not taken
  bool go_to(StateTarget target);

  /// Adds states and labels to the catalog and to `type`, whose labels are still its parent's. On an error
  /// neither changes; the message begins with "line:column: " of the target that could not be found. A label
  /// in an argument may be one that only descendants have: those go to `missing`, or are errors without one.
  Status finish(ActorCatalog* catalog, ActorType* type, std::vector<StateTarget>* missing = nullptr) const;

 private:
  enum class Link : uint8_t { kNext, kSelf, kLoop, kGone, kTarget };
  struct Step {
    State state;
    std::vector<PendingArg> args;
    Link link = Link::kNext;
    std::size_t loop_to = 0;  ///< of kLoop: place in states_
    StateTarget target;       ///< of kTarget
  };
  struct Label {
    std::string name;
    std::size_t place = 0;  ///< in states_, where it has its own state
    bool gone = false;      ///< "Label: stop"
    bool is_alias = false;  ///< "Label: goto Other"
    StateTarget alias;
  };
  bool end_labels(bool gone, const StateTarget* alias);

  std::vector<Step> states_;
  std::vector<Label> labels_;
  std::size_t open_labels_ = 0;  ///< labels at the end of labels_ that no state follows yet
  bool linked_ = true;           ///< the last state has its link, or there is none
};

}  // namespace comrad::doom

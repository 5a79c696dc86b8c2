#include "learner/worker/weights_publisher.h"

#include <utility>

#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/stage_clock.h"

namespace comrad::learn {

WeightsPublisher::WeightsPublisher(const Algorithm& algorithm, Publish publish, double interval_s)
    : algorithm_(algorithm), publish_(std::move(publish)), interval_s_(interval_s) {}

void WeightsPublisher::offer() {
  is_newer_offered_ = true;
  deliver();
}

void WeightsPublisher::deliver() { publish_what_is_there(/*at_once=*/false); }

void WeightsPublisher::publish_what_is_there(bool at_once) {
  if (!on_its_way_ && !is_newer_offered_) return;
  StageClock stage;
  stage.begin();
  while (on_its_way_ || is_newer_offered_) {
    if (!on_its_way_) {
      const double now_s = monotonic_s();
      if (!at_once && now_s < next_s_) break;
      next_s_ = now_s + interval_s_;
      snapshot_.take(algorithm_.weight_tensors());
      on_its_way_ = algorithm_.version();
      is_newer_offered_ = false;
    }
    if (!snapshot_.is_ready()) break;
    publish_(snapshot_.bytes(), *on_its_way_);
    on_its_way_.reset();
  }
  stage.end(Stage::kPublish);
}

void WeightsPublisher::finish() {
  for (publish_what_is_there(true); on_its_way_; publish_what_is_there(true)) snapshot_.wait();
}

}  // namespace comrad::learn

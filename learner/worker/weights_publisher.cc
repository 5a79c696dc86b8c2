#include "learner/worker/weights_publisher.h"

#include <utility>

#include "rollout_buffer/core/stage_clock.h"

namespace comrad::learn {

WeightsPublisher::WeightsPublisher(const Algorithm& algorithm, Publish publish)
    : algorithm_(algorithm), publish_(std::move(publish)) {}

void WeightsPublisher::offer() {
  is_newer_offered_ = true;
  deliver();
}

void WeightsPublisher::deliver() {
  if (!on_its_way_ && !is_newer_offered_) return;
  StageClock stage;
  stage.begin();
  publish_what_is_there();
  stage.end(Stage::kPublish);
}

void WeightsPublisher::publish_what_is_there() {
  while (on_its_way_ || is_newer_offered_) {
    if (!on_its_way_) {
      algorithm_.copy_weights(snapshot_);
      on_its_way_ = algorithm_.version();
      is_newer_offered_ = false;
    }
    if (!snapshot_.is_ready()) return;
    publish_(snapshot_.bytes(), *on_its_way_);
    on_its_way_.reset();
  }
}

void WeightsPublisher::finish() {
  for (deliver(); on_its_way_; deliver()) snapshot_.wait();
}

}  // namespace comrad::learn

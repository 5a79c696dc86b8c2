#include "sim_workers/engine/render/labels.h"

#include <algorithm>
#include <cstddef>
#include <iterator>

namespace comrad::doom {
namespace {

/// Boxes of what has pixels, by subject; right is 0 where none has.
std::vector<ThingLabel> boxes_of(std::span<const uint32_t> subjects, int width, std::size_t actor_count) {
  std::vector<ThingLabel> boxes(kFirstActor + actor_count);
  for (std::size_t at = 0; at < subjects.size(); ++at) {
    const uint32_t subject = subjects[at];
    if (subject < kWeaponSubject || subject >= boxes.size()) continue;
    ThingLabel& box = boxes[subject];
    const int x = static_cast<int>(at) % width, y = static_cast<int>(at) / width;
    if (box.right == 0) box.left = x, box.top = y;  // rows come from the top
    box.left = std::min(box.left, x), box.right = std::max(box.right, x + 1);
    box.bottom = y + 1;
  }
  return boxes;
}

}  // namespace

void label_subjects(const DrawList& list, std::span<const uint32_t> subjects, int width,
                    const StableList<Actor>& actors, uint32_t own_id, std::vector<uint8_t>* labels,
                    std::vector<ThingLabel>* things) {
  std::vector<ThingLabel> boxes = boxes_of(subjects, width, actors.size());
  std::vector<std::size_t> shown;  // from far to near
  for (std::size_t at = list.opaque_end; at < list.strips.size(); ++at) {
    const auto subject = static_cast<std::size_t>(list.strips[at].subject);
    if (subject < kFirstActor || subject >= boxes.size() || boxes[subject].right == 0) continue;
    if (boxes[subject].actor_id != 0) continue;  // a thing may have come to several strips
    boxes[subject].actor_id = actors[subject - kFirstActor].id;
    shown.push_back(subject);
  }
  if (shown.size() > kLabelledThingsMax)
    shown.erase(shown.begin(), std::prev(shown.end(), kLabelledThingsMax));

  // As ViZDoom spreads them: 255 k / (n + 1). Of so many that the first would be a plane's, the values next to 255.
  std::vector<uint8_t> values(boxes.size());
  values[kPlaneSubject] = kPlaneLabel;
  values[kWeaponSubject] = kOwnLabel;
  things->clear();
  const std::size_t count = shown.size();
  for (std::size_t k = 1; k <= count; ++k) {
    const std::size_t value = 255 / (count + 1) >= 2 ? 255 * k / (count + 1) : 254 - (count - k);
    ThingLabel& thing = boxes[shown[k - 1]];
    values[shown[k - 1]] = thing.value = static_cast<uint8_t>(value);
    things->push_back(thing);
  }
  if (ThingLabel& weapon = boxes[kWeaponSubject]; weapon.right != 0) {
    weapon.value = kOwnLabel, weapon.actor_id = own_id;
    things->push_back(weapon);
  }
  labels->resize(subjects.size());
  std::ranges::transform(subjects, labels->begin(), [&](uint32_t subject) {
    return subject < values.size() ? values[subject] : uint8_t{0};
  });
}

}  // namespace comrad::doom

#include "scenarios/dumb_enemies/layout.h"

#include <algorithm>

#include "scenarios/smart_enemies/layout.h"
#include "scenarios/spec/variety.h"

namespace comrad::scenarios::dumb_enemies {

namespace {

constexpr int64_t kRadius = 1000, kCap = 10, kInterval = 3, kProximity = 512;  // of the default map

/// The team is one party. Its way ends where two hunters are near enough to slow a demon down and pellets reach it.
smart_enemies::Hunt hunt_of(int64_t radius, int64_t interval, int64_t cap, int64_t proximity,
                            int num_agents) {
  return {.radius = static_cast<double>(radius),
          .reach = std::min(static_cast<double>(proximity), smart_enemies::kPelletReach),
          .interval_tics = static_cast<double>(interval) * 35,
          .cap = static_cast<int>(cap),
          .parties = 1,
          .guns = num_agents};
}

Status check_resources(const LayoutTask& task) {
  return smart_enemies::check_hunt(task,
                                   hunt_of(task.value("radius"), task.value("interval"), task.value("cap"),
                                           task.value("proximity"), task.num_agents),
                                   hunt_of(kRadius, kInterval, kCap, kProximity, task.num_agents));
}

}  // namespace

LayoutRecipe recipe() {
  return {.parameters = {{"radius", kRadius, 500, 4000, "radius of the arena, units (axis: 850, 1000, 1150)"},
                         {"obstacles", 30, 0, 200, "obstacles (axis: 18, 30, 42)"},
                         {"cap", kCap, 1, 32, "demons that live at a time (axis: 6, 10, 14)"},
                         {"interval", kInterval, 1, 60, "seconds between two demons (axis: 2, 3, 4)"},
                         {"proximity", kProximity, 64, 2000,
                          "how near a hunter counts, units (axis: 384, 512, 640)"},
                         organic_parameter()},
          .draw = smart_enemies::draw_arena,
          .axes = {{"radius", {{{"radius", 850}}, {{"radius", 1000}}, {{"radius", 1150}}}},
                   {"obstacles", {{{"obstacles", 18}}, {{"obstacles", 30}}, {{"obstacles", 42}}}},
                   {"cap", {{{"cap", 6}}, {{"cap", 10}}, {{"cap", 14}}}},
                   {"interval", {{{"interval", 2}}, {{"interval", 3}}, {{"interval", 4}}}},
                   {"proximity", {{{"proximity", 384}}, {{"proximity", 512}}, {{"proximity", 640}}}}},
          .ceiling = smart_enemies::most_kills,
          .check_resources = check_resources};
}

}  // namespace comrad::scenarios::dumb_enemies

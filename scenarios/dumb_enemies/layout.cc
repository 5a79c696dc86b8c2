#include "scenarios/dumb_enemies/layout.h"

#include "scenarios/smart_enemies/layout.h"
#include "scenarios/spec/variety.h"

namespace comrad::scenarios::dumb_enemies {

LayoutRecipe recipe() {
  return {
      .parameters = {{"radius", 1000, 500, 4000, "radius of the arena, units (axis: 850, 1000, 1150)"},
                     {"obstacles", 30, 0, 200, "obstacles (axis: 18, 30, 42)"},
                     {"cap", 10, 1, 32, "demons that live at a time (axis: 6, 10, 14)"},
                     {"interval", 3, 1, 60, "seconds between two demons (axis: 2, 3, 4)"},
                     {"proximity", 512, 64, 2000, "how near a hunter counts, units (axis: 384, 512, 640)"},
                     organic_parameter()},
      .draw = smart_enemies::draw_arena,
      .axes = {{"radius", {{{"radius", 850}}, {{"radius", 1000}}, {{"radius", 1150}}}},
               {"obstacles", {{{"obstacles", 18}}, {{"obstacles", 30}}, {{"obstacles", 42}}}},
               {"cap", {{{"cap", 6}}, {{"cap", 10}}, {{"cap", 14}}}},
               {"interval", {{{"interval", 2}}, {{"interval", 3}}, {{"interval", 4}}}},
               {"proximity", {{{"proximity", 384}}, {{"proximity", 512}}, {{"proximity", 640}}}}},
      .ceiling = smart_enemies::most_kills};
}

}  // namespace comrad::scenarios::dumb_enemies

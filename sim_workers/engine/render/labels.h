// From what each pixel of a view is of to labels: a value for each thing that shows, as in ViZDoom's labels buffer.
// Stage: render.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "sim_workers/engine/render/draw_list.h"
#include "sim_workers/engine/render/renderer.h"

namespace comrad::doom {

constexpr uint8_t kPlaneLabel = 1, kOwnLabel = 255;  ///< floors and ceilings; the weapon in hand
constexpr int kLabelledThingsMax = 253;              ///< there are as many values between

/// Labels of one picture; see Renderer::draw_labels().
///   list      what was drawn, from far to near
///   subjects  [rows, width], as ViewDrawer::draw_subjects() wrote them
///   actors    the world's; own_id: the one that looks
void label_subjects(const DrawList& list, std::span<const uint32_t> subjects, int width,
                    const StableList<Actor>& actors, uint32_t own_id, std::vector<uint8_t>* labels,
                    std::vector<ThingLabel>* things);

}  // namespace comrad::doom

// The table of recipes, which CMake writes from the folders that have a layout.cc (recipe_table.cc in the
// build folder): a new scenario adds its folder and nothing else.
#pragma once

#include <span>

#include "scenarios/spec/layout_recipe.h"

namespace comrad::scenarios {

struct RecipeEntry {
  const char* scenario;
  LayoutRecipe (*recipe)();
};

/// Sorted by name.
std::span<const RecipeEntry> recipe_table();

}  // namespace comrad::scenarios

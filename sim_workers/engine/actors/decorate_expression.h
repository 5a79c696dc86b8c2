// Values in DECORATE lumps: numbers, arithmetic of constants, draws, words. Stage: loading.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

#include "rollout_buffer/core/expected.h"
#include "sim_workers/engine/actors/decorate_lexer.h"
#include "sim_workers/engine/fixed.h"

namespace comrad::doom {

/// A number, a draw from a range, or a text.
struct DecorateValue {
  enum class Kind : uint8_t { kNumber, kRandom, kText };
  Kind kind = Kind::kNumber;
  // Always finite; what would not be is an error of the lump.
  double number = 0.0;  ///< of kRandom: the lowest
  double high = 0.0;    ///< of kRandom: the highest
  double step = 1.0;    ///< of kRandom: what the draw was multiplied with
  bool decimal = false;
  bool name = false;            ///< a word without quotes: kText, or the kNumber that it stands for
  bool in_parentheses = false;  ///< which Damage distinguishes
  std::string text;
  int32_t line = 0, column = 0;

  int32_t integer() const;  ///< held to what 32 bits can say
  Fixed fixed() const;      ///< nearest
  Fixed fixed_cut() const;  ///< towards 0, as ViZDoom takes arguments of action functions
};

/// What a word stands for, and what an expression of the running game (health, args[0]) is reported to.
struct DecorateNames {
  std::function<std::optional<double>(std::string_view)> constant;
  std::function<void(const Token&)> unknown;
};

/// Reads an expression up to a symbol that cannot belong to it.
Expected<DecorateValue> read_expression(DecorateLexer* lexer, const DecorateNames& names);

/// Reads a property's value: a literal with or without a sign, a word, a text, or an expression
/// in parentheses.
Expected<DecorateValue> read_property_value(DecorateLexer* lexer, const DecorateNames& names);

/// "line:column: what".
Error error_at(const Token& token, const std::string& what);

}  // namespace comrad::doom

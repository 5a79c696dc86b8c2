// Members of a JSON object that another host or an earlier run wrote. Stage: beside the flow.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <type_traits>

namespace comrad::link {

/// Text, a flag, a whole number that is not negative or a real one; an empty value where the member is missing or of
/// another kind.
template <typename T>
T member(const nlohmann::json& object, const char* key) {
  const auto found = object.find(key);
  if (found == object.end()) return T();
  bool is_of_kind = found->is_number();
  if constexpr (std::is_same_v<T, std::string>)
    is_of_kind = found->is_string();
  else if constexpr (std::is_same_v<T, bool>)
    is_of_kind = found->is_boolean();
  else if constexpr (std::is_integral_v<T>)
    is_of_kind = found->is_number_unsigned();
  return is_of_kind ? found->get<T>() : T();
}

}  // namespace comrad::link

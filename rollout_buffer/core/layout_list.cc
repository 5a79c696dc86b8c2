#include "rollout_buffer/core/layout_list.h"

#include <spdlog/fmt/fmt.h>

#include <optional>
#include <set>
#include <sstream>

#include <toml++/toml.h>

#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/toml_text.h"

namespace comrad {

std::string layout_list_text(const LayoutList& list) {
  toml::array layouts;
  for (const LayoutEntry& layout : list.layouts) {
    toml::table one{{"id", layout.id}, {"path", layout.path}};
    if (layout.metric_scale > 0) one.insert("metric_scale", layout.metric_scale);
    if (layout.ceiling > 0) one.insert("ceiling", layout.ceiling);
    layouts.push_back(std::move(one));
  }
  toml::table document{{"layout", std::move(layouts)}};
  if (!list.interestingness_graph.empty())
    document.insert("interestingness_graph", list.interestingness_graph);
  std::ostringstream text;
  text << document << "\n";
  return std::move(text).str();
}

Expected<LayoutList> parse_layout_list(std::string_view text, const std::string& label) {
  const auto bad = [&](const std::string& what) { return Error{ErrorCode::kBadFormat, label + ": " + what}; };
  COMRAD_TRY(check_toml_text(text, label));
  LayoutList list;
  std::set<std::string> ids;
  try {
    const toml::table document = toml::parse(text, label);
    if (const auto graph = document["interestingness_graph"].value<std::string>())
      list.interestingness_graph = *graph;
    const toml::array* layouts = document["layout"].as_array();
    if (layouts == nullptr || layouts->empty()) return bad("lists no layouts");
    for (const toml::node& node : *layouts) {
      const std::string where = fmt::format("layout {}", list.layouts.size());
      const toml::table* one = node.as_table();
      const auto id = one == nullptr ? std::nullopt : (*one)["id"].value<std::string>();
      const auto path = one == nullptr ? std::nullopt : (*one)["path"].value<std::string>();
      if (!id || !path) return bad(where + " needs the texts 'id' and 'path'");
      if (!ids.insert(*id).second) return bad(where + ": there is another one named " + *id);
      list.layouts.push_back(
          {*id, *path, (*one)["metric_scale"].value_or(0.0), (*one)["ceiling"].value_or(0.0)});
    }
  } catch (const toml::parse_error& failure) {
    return Error{ErrorCode::kBadFormat, fmt::format("{}:{}:{}: {}", label, failure.source().begin.line,
                                                    failure.source().begin.column, failure.description())};
  }
  return list;
}

Expected<LayoutList> read_layout_list(const std::string& run_dir) {
  const std::string path = run_dir + "/" + kLayoutListFile;
  const std::optional<std::string> text = read_file(path);
  if (!text)
    return Error{
        ErrorCode::kNotFound,
        path + ": cannot be read; `comrad train` writes it from --layout_pool, start the run with it"};
  return parse_layout_list(*text, path);
}

}  // namespace comrad

#include "doomgen/acs/source_loader.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <unordered_set>

#include "rollout_buffer/core/text.h"

namespace comrad::acs_compiler {
namespace {

constexpr int kIncludeDepthMax = 16;
constexpr int kFilesMax = 256;

class SourceLoader {
 public:
  SourceLoader(const CompileOptions& options, TextPool& pool, std::deque<std::string>& texts,
               Diagnostics& diagnostics)
      : options_(options), pool_(pool), texts_(texts), diagnostics_(diagnostics) {}

  void add(std::string text, const std::string& path, Place from, int depth, bool imported) {
    const bool first = files_ == 0;
    if (first) imported_paths_.insert(path);
    const uint32_t file = first ? diagnostics_.add_file(path) : next_file(path);
    const Place place = first ? Place{file, 1, 1} : from;
    if (++files_ > kFilesMax)
      return diagnostics_.error(place, fmt::format("more than {} files in one program", kFilesMax));
    bytes_ += text.size();
    if (bytes_ > options_.source_bytes_max)
      return diagnostics_.error(place,
                                fmt::format("sources of more than {} bytes", options_.source_bytes_max));
    texts_.push_back(std::move(text));
    const std::vector<Token> tokens = lex(texts_.back(), file, pool_, diagnostics_);
    for (std::size_t i = 0; i < tokens.size() && !diagnostics_.full(); ++i) {
      if (tokens[i].is("#")) {
        directive(tokens, i, path, depth, imported);
      } else {
        result_.tokens.push_back(tokens[i]);
      }
    }
    if (first) {
      Token end;
      const std::string& last = texts_.front();
      end.place = {file, 1 + static_cast<uint32_t>(std::count(last.begin(), last.end(), '\n')),
                   static_cast<uint32_t>(last.size() - std::min(last.rfind('\n') + 1, last.size()) + 1)};
      result_.tokens.push_back(end);
    }
  }

  SourceTokens take() { return std::move(result_); }

 private:
  uint32_t next_file(const std::string& path) { return diagnostics_.add_file(path); }

  /// tokens[i] is '#'; leaves i at the last token that belongs to the directive.
  void directive(const std::vector<Token>& tokens, std::size_t& i, const std::string& path, int depth,
                 bool imported) {
    const Place place = tokens[i].place;
    if (i + 1 >= tokens.size() || tokens[i + 1].kind != TokenKind::kName)
      return diagnostics_.error(place, "# without a directive", "#define, #include or another directive");
    const Token& word = tokens[++i];
    if (word.text == "define" || word.text == "libdefine" || word.text == "library") {
      Token token = word;
      token.kind = TokenKind::kDirective;
      token.place = place;
      result_.tokens.push_back(token);
      return;
    }
    if (word.text == "encryptstrings") {
      if (!imported) result_.encrypts_texts = true;
      return;
    }
    if (word.text == "nocompact" || word.text == "compact" || word.text == "nowadauthor" ||
        word.text == "wadauthor")
      return;
    if (word.text == "region" || word.text == "endregion") {  // folds of an editor, with a title
      while (i + 1 < tokens.size() && tokens[i + 1].place.line == place.line) ++i;
      return;
    }
    if (word.text != "include" && word.text != "import")
      return diagnostics_.error(word.place, "the directive " + in_quotes(word.spelling),
                                "define, libdefine, include, import, library, encryptstrings, nocompact or "
                                "nowadauthor");
    if (i + 1 >= tokens.size() || tokens[i + 1].kind != TokenKind::kText)
      return diagnostics_.error(word.place, "#" + std::string(word.text) + " without a file",
                                "#" + std::string(word.text) + " \"name\"");
    const Token& name = tokens[++i];
    if (is_built_in_header(name.text)) return;
    const bool imports = word.text == "import";
    if (depth >= kIncludeDepthMax)
      return diagnostics_.error(
          name.place, fmt::format("files that include each other more than {} deep", kIncludeDepthMax));
    if (!options_.reader)
      return diagnostics_.error(name.place, "the file " + in_quotes(name.text) + " cannot be read here",
                                "a source that includes nothing but the built-in headers");
    Expected<SourceFile> file = options_.reader(std::string(name.text), path);
    if (!file) return diagnostics_.error(name.place, file.error().message);
    // A library's own libraries are read for their constants, once: two may import each other.
    if (imports && !imported_paths_.insert(file->path).second && imported) return;
    Token mark = name;
    mark.kind = TokenKind::kImportBegin;
    if (imports) result_.tokens.push_back(mark);
    add(std::move(file->text), file->path, name.place, depth + 1, imported || imports);
    mark.kind = TokenKind::kImportEnd;
    if (imports) result_.tokens.push_back(mark);
  }

  const CompileOptions& options_;
  TextPool& pool_;
  std::deque<std::string>& texts_;
  Diagnostics& diagnostics_;
  SourceTokens result_;
  std::unordered_set<std::string> imported_paths_;
  int files_ = 0;
  std::size_t bytes_ = 0;
};

}  // namespace

bool is_built_in_header(std::string_view name) {
  constexpr std::array<std::string_view, 8> kHeaders = {"zcommon.acs", "zdefs.acs",  "zspecial.acs",
                                                        "zwvars.acs",  "common.acs", "specials.acs",
                                                        "defs.acs",    "wvars.acs"};
  return std::any_of(kHeaders.begin(), kHeaders.end(),
                     [&](std::string_view header) { return same_ignoring_case(name, header); });
}

SourceTokens load_source(std::string_view source, const std::string& path, const CompileOptions& options,
                         TextPool& pool, std::deque<std::string>& texts, Diagnostics& diagnostics) {
  SourceLoader loader(options, pool, texts, diagnostics);
  loader.add(std::string(source), path, {}, 0, false);
  SourceTokens result = loader.take();
  if (result.tokens.empty() || result.tokens.back().kind != TokenKind::kEnd) result.tokens.emplace_back();
  return result;
}

}  // namespace comrad::acs_compiler

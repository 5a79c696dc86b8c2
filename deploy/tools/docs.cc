// `comrad docs`: builds the site from the pages in the folders, or serves it on this host. Becomes deploy/site/docs.py.

#include <cstdio>
#include <string>
#include <vector>

#include "deploy/process/child_program.h"
#include "deploy/process/python_program.h"
#include "deploy/run/command.h"

namespace comrad::deploy {
namespace {

struct DocsOptions {
  std::string build, address = "127.0.0.1:8000";
  bool serve = false, update = false;
};

/// The words of docs.py. Errors: bad options; kNotFound without the sources of the pages, or without MkDocs.
Expected<std::vector<std::string>> docs_words(const DocsOptions& options) {
  if (options.serve + options.update + !options.build.empty() != 1)
    return Error{ErrorCode::kBadInput, "expected --serve, --build DIR or --update, one of them"};
  const std::string script = "deploy/site/docs.py";
  COMRAD_TRY(check_checkout_has(script));
  COMRAD_TRY_ASSIGN(const std::string python,
                    python_of_environment(
                        "COMRAD_DOCS_PYTHON", "docs-python", "import material, mkdocs",
                        "no Python here can import mkdocs-material; ./comrad docs installs it in the build "
                        "folder, or name a Python that has it: COMRAD_DOCS_PYTHON=FILE"));
  std::vector<std::string> words = {"--comrad", sibling_program("comrad")};
  if (options.update)
    words.emplace_back("--update");
  else if (options.serve)
    words.insert(words.end(), {"--serve", options.address});
  else
    words.insert(words.end(), {"--build", options.build});
  return python_command(python, script, words);
}

}  // namespace

int docs_command(Arguments arguments) {
  DocsOptions options;
  CommandLine line(
      "docs --serve [--address ADDRESS:PORT] | --build DIR | --update",
      "Builds the documentation as a site: the pages of the folders, and a reference of commands, settings,\n"
      "metrics and files that the program writes. Reading it needs no network.");
  line.add_switch("serve", options.serve, "build it and serve it until Ctrl-C");
  line.add_option("address", options.address, "ADDRESS:PORT",
                  "where --serve listens (default 127.0.0.1:8000)");
  line.add_option("build", options.build, "DIR", "write it into this folder, which is emptied first");
  line.add_switch(
      "update", options.update,
      "write the parts of the pages in this checkout that the program writes: metrics, layout parameters");
  return run_command("docs", line, arguments, [&]() -> Expected<int> {
    COMRAD_TRY_ASSIGN(const std::vector<std::string> words, docs_words(options));
    return replace_process(words);
  });
}

}  // namespace comrad::deploy

#!/usr/bin/env python3
"""The Markdown files name what exists, and the READMEs of the root and of its folders stay short.

    documentation_test.py [ROOT]

* Every relative link leads to a file or folder that exists, and its #heading to a heading there; so does every picture of an <img>.
* Every `name` in the first column of a table whose head begins with "file" or "folder" exists: beside the Markdown file, in
  a folder that the head names in backticks, or in the folder of the first name of the same cell. `.cc` after `x.h` is `x.cc`;
  `*` is a wildcard; names with < or a space are left alone.
* README.md has at most ROOT_WORDS_MAX words, <folder>/README.md at most FOLDER_WORDS_MAX, and all pages together at most
  PAGES_WORDS_MAX of those that a person writes: outside of code blocks, of links' targets and of what a program writes.
* deploy/site/mkdocs.yml names every page: the site's build fails without.

First the same checks run over a folder made for it that breaks each rule once, and must find every fault.
"""
import glob
import os
import re
import sys
import tempfile

ROOT_WORDS_MAX = 450
FOLDER_WORDS_MAX = 500
PAGES_WORDS_MAX = 40_000
NAVIGATION = "deploy/site/mkdocs.yml"
GENERATED = re.compile(r"<!-- results -->.*?<!-- end of results -->|<!-- (comrad [\w ]+): begin -->.*?<!-- \1: end -->", re.DOTALL)
NOT_OURS = {".git", "build", "train_dir"}
MADE_BY_TOOLS = {"CMakeCache.txt", "pyvenv.cfg"}  # a build folder, a Python environment: whatever they are called


def markdown_files(root):
    for folder, folders, names in os.walk(root):
        if MADE_BY_TOOLS & set(names):
            folders[:] = []
            continue
        folders[:] = sorted(name for name in folders if name not in NOT_OURS)
        for name in sorted(names):
            if name.endswith(".md"):
                yield os.path.relpath(os.path.join(folder, name), root)


def lines_of(path):
    """Numbered lines outside of fenced code."""
    fenced = False
    with open(path, encoding="utf-8") as file:
        for number, line in enumerate(file, 1):
            if line.lstrip().startswith("```"):
                fenced = not fenced
            elif not fenced:
                yield number, line.rstrip("\n")


def anchors(path):
    """The #names of a file's headings, as GitHub makes them."""
    found = set()
    for _, line in lines_of(path):
        heading = re.match(r"#+ +(.*)", line)
        if heading:
            found.add(re.sub(r"[^\w\- ]", "", heading.group(1).lower()).replace(" ", "-"))
    return found


def broken_links(root, name):
    here = os.path.dirname(os.path.join(root, name))
    for number, line in lines_of(os.path.join(root, name)):
        text = re.sub(r"`[^`]*`", "", line)
        for link in re.findall(r"\[[^\]]*\]\(([^)\s]+)\)", text) + re.findall(r"<img [^>]*src=\"([^\"]+)\"", text):
            if re.match(r"[a-z]+:", link):
                continue
            path, _, anchor = link.partition("#")
            target = os.path.normpath(os.path.join(here, path)) if path else os.path.join(root, name)
            if not os.path.exists(target):
                yield f"{name}:{number}: the link {link} leads nowhere"
            elif anchor and target.endswith(".md") and anchor not in anchors(target):
                yield f"{name}:{number}: {link}: there is no such heading"


def missing_files(root, name):
    here = os.path.dirname(os.path.join(root, name))
    bases = None  # folders of the table under way; None outside of tables of files
    in_table = False
    for number, line in lines_of(os.path.join(root, name)):
        if not line.startswith("|"):
            in_table, bases = False, None
            continue
        cell = line.split("|")[1].strip()
        if not in_table:
            in_table = True
            if re.match(r"(files?|folders?)\b", cell):
                bases = [here] + [os.path.join(here, folder) for folder in re.findall(r"`([^`]+)`", cell)]
            continue
        if bases is None:
            continue
        first_folder, before = None, None
        for wanted in re.findall(r"`([^`]+)`", cell):
            if re.search(r"[<\s]", wanted):
                continue
            if re.fullmatch(r"\.\w+", wanted) and before:
                wanted = os.path.splitext(before)[0] + wanted
            folders = bases + ([os.path.join(here, first_folder)] if first_folder else [])
            if not any(glob.glob(os.path.join(folder, wanted)) for folder in folders):
                yield f"{name}:{number}: there is no {wanted}"
            if first_folder is None:
                first_folder = os.path.dirname(wanted.rstrip("/"))
            before = wanted


def long_readmes(root):
    for name in markdown_files(root):
        if os.path.basename(name) != "README.md" or name.count("/") > 1:
            continue
        with open(os.path.join(root, name), encoding="utf-8") as file:
            words = len(file.read().split())
        most = ROOT_WORDS_MAX if name == "README.md" else FOLDER_WORDS_MAX
        if words > most:
            yield f"{name}: {words} words, at most {most}: move what is longer to a file beside it"


def written_words(text):
    """How many words of a page a person wrote. A page whose first lines say that a command wrote it has none."""
    if re.match(r".{0,200}Written by `", text, re.DOTALL):
        return 0
    text = GENERATED.sub("", text)
    text = re.sub(r"^```.*?^```[^\n]*$", "", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"\]\([^)]*\)", "] ", text)
    return sum(1 for word in text.split() if re.search(r"\w", word))


def too_many_words(root):
    words = {}
    for name in markdown_files(root):
        with open(os.path.join(root, name), encoding="utf-8") as file:
            words[name] = written_words(file.read())
    if sum(words.values()) > PAGES_WORDS_MAX:
        longest = ", ".join(f"{name} {words[name]}" for name in sorted(words, key=words.get)[:-6:-1])
        yield f"the pages have {sum(words.values())} words, at most {PAGES_WORDS_MAX}: shorten or delete; the longest are {longest}"


def pages_outside_the_site(root):
    path = os.path.join(root, NAVIGATION)
    if not os.path.exists(path):
        return
    with open(path, encoding="utf-8") as file:
        named = set(re.findall(r"(\S+\.md)$", file.read(), re.MULTILINE))
    for name in markdown_files(root):
        if not name.startswith(".") and name not in named:
            yield f"{name}: {NAVIGATION} does not name it"


def findings(root):
    found = []
    for name in markdown_files(root):
        found += broken_links(root, name)
        found += missing_files(root, name)
    return found + list(long_readmes(root)) + list(too_many_words(root)) + list(pages_outside_the_site(root))


SAMPLE = """# A sample

[good](there.md#a-heading), [bad](nowhere.md), [worse](there.md#no-heading), `[code](nowhere.md)`, [web](https://example.org)
<img src="no_picture.png" width="9"><br>[good](there.md)

| file | what it does |
| --- | --- |
| `part/one.h`, `.cc`, `two.h` | three that exist |
| `part/*.h`, `part/` | and these |
| `part/one.h`, `gone.h` | one that does not |
| `part/three.*` | no such file either |

| setting | default |
| --- | --- |
| `rollout` | no file |
"""


def check_itself():
    with tempfile.TemporaryDirectory() as root:
        os.makedirs(os.path.join(root, "part"))
        os.makedirs(os.path.join(root, "made"))
        os.makedirs(os.path.join(root, "deploy", "site"))
        navigation = "nav:\n" + "".join(f"  - P: {page}\n" for page in ("README.md", "part/README.md", "part/long.md", "part/made.md"))
        texts = {NAVIGATION: navigation, "there.md": "# A heading\n", "made/CMakeCache.txt": "", "made/foreign.md": "[bad](nowhere.md)", "part/one.h": "", "part/one.cc": "", "part/two.h": "",
                 "README.md": SAMPLE, "part/README.md": "word " * (FOLDER_WORDS_MAX + 1),
                 "part/long.md": "word " * PAGES_WORDS_MAX, "part/made.md": "# M\nWritten by `x`. " + "word " * PAGES_WORDS_MAX}
        for name, text in texts.items():
            with open(os.path.join(root, name), "w", encoding="utf-8") as file:
                file.write(text)
        found = "\n".join(findings(root))
        wanted = ["README.md:3: the link nowhere.md", "README.md:3: there.md#no-heading", "README.md:4: the link no_picture.png",
                  "README.md:10: there is no gone.h", "README.md:11: there is no part/three.*", f"part/README.md: {FOLDER_WORDS_MAX + 1} words", f"{PAGES_WORDS_MAX}: shorten",
                  f"there.md: {NAVIGATION}"]
        assert written_words("a [b](c d) | `e`\n```\nf\n```\n<!-- comrad x: begin -->\ng\n<!-- comrad x: end -->\n") == 3
        missed = [text for text in wanted if text not in found]
        if missed or found.count("\n") + 1 != len(wanted):
            sys.exit(f"the check itself is broken: it missed {missed}; it found\n{found}")


def main():
    check_itself()
    root = os.path.abspath(sys.argv[1] if len(sys.argv) > 1 else os.path.join(os.path.dirname(__file__), "..", ".."))
    found = findings(root)
    for line in found:
        print(line)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())

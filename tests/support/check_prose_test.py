#!/usr/bin/env python3
"""Tests check_prose on small trees, good ones and bad ones."""
import os
import subprocess
import sys
import tempfile
import unittest
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader

SCRIPT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "check_prose")
sys.dont_write_bytecode = True
loader = SourceFileLoader("check_prose", SCRIPT)
check_prose = module_from_spec(spec_from_loader("check_prose", loader))
loader.exec_module(check_prose)

LONG = "One two three four five six seven eight nine ten eleven twelve thirteen fourteen fifteen sixteen seventeen " \
       "eighteen nineteen twenty and one and two and three."
SHORT = "This sentence is short. "


class CheckProse(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.write("README.md", "# A tree\n\nIt holds nothing.\n")
        self.write(".clang-format", "DisableFormat: true\nSortIncludes: Never\n")

    def tearDown(self):
        self.folder.cleanup()

    def write(self, path, text):
        path = os.path.join(self.folder.name, path)
        os.makedirs(os.path.dirname(path), exist_ok=True)
        with open(path, "w", encoding="utf-8") as file:
            file.write(text)

    def check(self):
        """(exit code, lines)"""
        result = subprocess.run([sys.executable, SCRIPT, self.folder.name], capture_output=True, text=True)
        self.assertEqual(result.stderr, "")
        return result.returncode, result.stdout.splitlines()

    def assert_good(self):
        code, lines = self.check()
        self.assertEqual((code, lines[-1]), (0, "0 findings"), lines)

    def assert_found(self, *beginnings):
        """These findings and no others."""
        code, lines = self.check()
        self.assertEqual((code, lines[-1]), (1, f"{len(beginnings)} findings"), lines)
        for line, beginning in zip(lines[-1 - len(beginnings):], beginnings):
            self.assertTrue(line.startswith(beginning), line)
            self.assertIn("expected", line)

    def wrapped(self, text, start=""):
        """The text on lines that are narrow enough."""
        words, lines = text.split(), [start]
        for word in words:
            if len(lines[-1]) + len(word) > 100:
                lines.append(start)
            lines[-1] += (" " if lines[-1] else "") + word
        return "\n".join(lines) + "\n"

    def test_accepts_tree_that_keeps_the_rules(self):
        self.write("docs/a.md",
                   "# Page\n\nSee [the tree](../README.md#a-tree), [code](../idl), [web](https://x.y).\n")
        self.write("idl/a.idl", "// The wire contract.\nstruct A {};  // empty\n")
        self.assert_good()

    def test_refuses_folder_without_pages(self):
        os.remove(os.path.join(self.folder.name, "README.md"))
        result = subprocess.run([sys.executable, SCRIPT, self.folder.name], capture_output=True, text=True)
        self.assertEqual(result.returncode, 1)
        self.assertIn("expected the root of the tree", result.stderr)

    # Sentences

    def test_finds_long_sentence_in_docs(self):
        self.write("docs/a.md", "# Page\n\nShort one here.\n\n" + self.wrapped(LONG))
        self.assert_found("docs/a.md:5: a sentence of 26 words, expected at most 25: One two")

    def test_finds_long_sentences_in_lists_and_table_cells(self):
        self.write("docs/a.md", "# Page\n\n- item\n" + self.wrapped("- " + LONG) +
                   f"\n| a | b |\n| --- | --- |\n| c | {LONG} |\n")
        self.assert_found("docs/a.md:4:", "docs/a.md:9:")

    def test_allows_two_percent_of_long_sentences(self):
        self.write("docs/a.md", self.wrapped(SHORT * 49) + "\n" + self.wrapped(LONG))
        self.assert_good()  # 1 of 51: the README has one
        self.write("docs/a.md", self.wrapped(SHORT * 47) + "\n" + self.wrapped(LONG))
        self.assert_found("docs/a.md:")  # 1 of 49

    def test_ignores_code_blocks_headings_code_spans_and_link_targets(self):
        self.write("docs/a.md", "# Page\n\n```\n" + self.wrapped(LONG) + "```\n\n## " + "word " * 21 + "\n\n"
                   "Run `" + "word " * 18 + "` and [read](" + "../README.md" + ").\n")
        self.assert_good()

    def test_finds_long_sentence_in_comments_of_each_language(self):
        for path, mark in (("common/a.hpp", "//"), ("services/a.ts", "///"), ("services/CMakeLists.txt", "#"),
                           ("idl/a.idl", "//"), ("services/run", "#")):
            with self.subTest(path):
                shebang = "#!/bin/sh\n" if path == "services/run" else ""
                self.write(path, shebang + self.wrapped(LONG, mark))
                self.assert_found(f"{path}:{2 if shebang else 1}: a sentence of 26 words")
                os.remove(os.path.join(self.folder.name, path))

    def test_finds_long_sentence_in_block_comment(self):
        self.write("services/a.ts", "/**\n" + self.wrapped(LONG, " *") + " */\nconst a = 1;\n")
        self.assert_found("services/a.ts:1: a sentence of 26 words")

    def test_splits_comments_at_code_and_formulas(self):
        half = " ".join(["word"] * 15)
        self.write("common/a.h", f"// {half}\nint a;\n// {half}\n//   a = b + c\n// {half}\n"
                   f"int b;  // {half}\n// {half}\n")
        self.assert_good()

    def test_checks_comments_of_three_folders_only(self):
        self.write("tests/a.cpp", self.wrapped(LONG, "//"))
        self.assert_good()

    # Width

    def test_finds_wide_lines_of_prose_and_code(self):
        wide = "x" * 121
        self.write("docs/a.md", f"# Page\n\n{wide}\n")
        self.write("idl/a.idl", f"{'y' * 120}\n{wide}\n")
        self.write("tests/CMakeLists.txt", f"# {wide}\n")
        self.write("tests/a_script", f"#!/usr/bin/env python3\n# {wide}\n")
        self.assert_found("docs/a.md:3: 121 columns", "idl/a.idl:2: 121 columns", "tests/CMakeLists.txt:1: 123 columns",
                          "tests/a_script:2: 123 columns")

    def test_measures_every_kind_of_code(self):
        kinds = ("hpp", "cpp", "c", "h", "idl", "ts", "mjs", "py", "cmake", "toml", "sh")
        for kind in kinds:
            mark = "#" if kind in ("py", "cmake", "toml", "sh") else "//"
            self.write(f"tests/a.{kind}", f"// clang-format off\n{mark} {'x' * 120}\n")
        self.assert_found(*sorted(f"tests/a.{kind}:2: 12" for kind in kinds))

    def test_allows_wide_tables_code_blocks_and_link_targets(self):
        wide, target = "x" * 121, "a" * 100 + ".md"
        self.write(f"docs/{target}", "# Page\n")
        self.write("docs/a.md", f"| {wide} |\n\n```\n{wide}\n```\n\n"
                   f"The page [has a long name]({target}) and is https://{wide}\n")
        self.write("data.json", f'"{wide}"\n')
        self.assert_good()

    def test_ignores_build_folders(self):
        self.write("build/a.cpp", "x" * 121 + "\n")
        self.assert_good()

    # Format

    @unittest.skipIf(check_prose.find_clang_format() is None, "clang-format 14 is missing")
    def test_finds_code_that_is_not_formatted(self):
        self.write(".clang-format", "BasedOnStyle: Google\n")
        self.write("tests/a.cpp", "int a;\n\nint  b;\n")
        self.write("tests/b.cpp", "int c;\n")
        self.assert_found("tests/a.cpp:3: not formatted")

    # Links

    def test_finds_dead_links_and_images(self):
        self.write("docs/a.md", "# Page\n\nSee [a](b.md).\nSee ![a](images/c.png).\nSee [c].\n\n[c]: ../gone/\n")
        self.assert_found("docs/a.md:3: dead link b.md", "docs/a.md:4: dead link images/c.png",
                          "docs/a.md:7: dead link ../gone/")

    def test_finds_links_out_of_the_tree_and_into_builds(self):
        self.write("build/made.md", "# Made\n")
        self.write("docs/a.md", "# Page\n\nSee [a](../build/made.md).\nSee [a](../../..).\n")
        self.assert_found("docs/a.md:3:", "docs/a.md:4:")

    def test_finds_anchors_without_heading(self):
        self.write("docs/b.md", "# Other\n\n```\n# no heading\n```\n")
        self.write("docs/a.md", "# Page\n\nSee [a](#gone).\nSee [b](b.md#no-heading) and [c](b.md#other).\n")
        self.assert_found("docs/a.md:3: dead link #gone", "docs/a.md:4: dead link b.md#no-heading")

    def test_makes_anchors_as_github_does(self):
        headings = {
            "The energy ledger": "the-energy-ledger",
            "What `--json` of `up` holds: all": "what---json-of-up-holds-all",
            "[A link](x.md), and **bold**": "a-link-and-bold",
            "snake_case & more": "snake_case--more",
            "Größe 1.5": "größe-15",
            "Closed ##": "closed",
        }
        page = [f"## {heading}" for heading in headings]
        self.assertEqual(check_prose.anchors(page), set(headings.values()))
        self.assertEqual(check_prose.anchors(["# Up", "# Up", "# Up"]), {"up", "up-1", "up-2"})
        self.assertEqual(check_prose.anchors(['<a id="here"></a>']), {"here"})

    def test_ignores_links_in_code(self):
        self.write("docs/a.md", "# Page\n\nWrite `[a](gone.md)`.\n\n```\n[a](gone.md)\n```\n")
        self.assert_good()


unittest.main()

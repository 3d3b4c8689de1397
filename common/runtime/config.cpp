#include "runtime/config.hpp"

#include <fmt/format.h>
#include <toml++/toml.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <sstream>

#include "runtime/config_json.hpp"

namespace softhand::config_detail {
namespace {

// Shortest text that reads back as the same number.
std::string text_of(double value) { return fmt::format("{}", value); }

std::string toml_string(std::string_view text) {
  std::ostringstream out;
  out << toml::value<std::string>(std::string(text));
  return out.str();
}

std::string text_of(const toml::node& node) {
  if (node.is_table()) return "a table";
  std::ostringstream out;
  node.visit([&out](const auto& n) { out << n; });
  std::string text = out.str();
  constexpr std::size_t longest = 60;
  if (text.size() > longest) text = text.substr(0, longest) + "...";
  return text;
}

std::string range_text(Range range) {
  const bool lower = std::isfinite(range.minimum);
  const bool upper = std::isfinite(range.maximum);
  if (lower && upper) return fmt::format("[{}, {}]", range.minimum, range.maximum);
  if (lower) return fmt::format(">= {}", range.minimum);
  if (upper) return fmt::format("<= {}", range.maximum);
  return "";
}

std::string expected_number(std::string_view what, std::string_view unit, Range range) {
  std::string text{what};
  const bool both = std::isfinite(range.minimum) && std::isfinite(range.maximum);
  if (const std::string limits = range_text(range); !limits.empty()) text += (both ? " in " : " ") + limits;
  if (!unit.empty() && unit != "1") text += fmt::format(" {}", unit);
  return text;
}

std::string expected_choice(const std::vector<std::string_view>& allowed) {
  std::string text = "one of";
  for (std::size_t i = 0; i < allowed.size(); ++i) text += fmt::format("{} \"{}\"", i == 0 ? "" : ",", allowed[i]);
  return text;
}

bool inside(double value, Range range) {
  return std::isfinite(value) && value >= range.minimum && value <= range.maximum;
}

std::optional<double> number_in(const toml::node& node) {
  if (const auto* integer = node.as_integer()) return static_cast<double>(integer->get());
  if (const auto* real = node.as_floating_point()) return real->get();
  return std::nullopt;
}

std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t substituted = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, substituted});
    }
  }
  return row[b.size()];
}

std::string suggestion(std::string_view key, const std::vector<std::string>& known) {
  std::size_t best_distance = std::max<std::size_t>(2, key.size() / 3) + 1;
  const std::string* best = nullptr;
  for (const std::string& candidate : known) {
    // A missing or added suffix such as a unit is as likely as a typing error, so it counts as distance 1.
    const bool prefix =
        key.size() >= 3 && (candidate.rfind(key, 0) == 0 || (candidate.size() >= 3 && key.rfind(candidate, 0) == 0));
    const std::size_t distance = prefix ? 1 : edit_distance(key, candidate);
    if (distance < best_distance) {
      best_distance = distance;
      best = &candidate;
    }
  }
  if (best != nullptr) return fmt::format("; did you mean '{}'?", *best);
  std::string text;
  for (const std::string& candidate : known)
    text += fmt::format("{}{}", text.empty() ? "; known here: " : ", ", candidate);
  return text;
}

// Sets one leaf from a TOML node. Returns an empty text on success, otherwise the text of what was expected. On failure
// the value is not changed.
std::string assign(const toml::node& node, double& value, std::string_view unit, Range range) {
  const auto number = number_in(node);
  if (!number || !inside(*number, range)) return expected_number("number", unit, range);
  value = *number;
  return {};
}

std::string assign(const toml::node& node, std::int64_t& value, std::string_view unit, Range range) {
  const auto* integer = node.as_integer();
  if (integer == nullptr || !inside(static_cast<double>(integer->get()), range))
    return expected_number("integer", unit, range);
  value = integer->get();
  return {};
}

std::string assign(const toml::node& node, bool& value) {
  const auto* flag = node.as_boolean();
  if (flag == nullptr) return "true or false";
  value = flag->get();
  return {};
}

std::string assign(const toml::node& node, std::string& value) {
  const auto* text = node.as_string();
  if (text == nullptr) return "a string";
  value = text->get();
  return {};
}

std::string assign(const toml::node& node, std::string& value, const OptionVisitor::Check& check) {
  std::string fresh;
  if (std::string expected = assign(node, fresh); !expected.empty()) return expected;
  if (std::string expected = check(fresh); !expected.empty()) return expected;
  value = std::move(fresh);
  return {};
}

std::string assign(const toml::node& node, std::string& value, const std::vector<std::string_view>& allowed) {
  const auto* text = node.as_string();
  if (text == nullptr || std::find(allowed.begin(), allowed.end(), text->get()) == allowed.end())
    return expected_choice(allowed);
  value = text->get();
  return {};
}

std::string assign(const toml::node& node, double* values, std::size_t count, std::string_view unit, Range range) {
  const auto* array = node.as_array();
  const std::string expected = fmt::format("array of {} {}", count, expected_number("numbers, each", unit, range));
  if (array == nullptr || array->size() != count) return expected;
  std::vector<double> fresh;
  for (const toml::node& element : *array) {
    const auto number = number_in(element);
    if (!number || !inside(*number, range)) return expected;
    fresh.push_back(*number);
  }
  std::copy(fresh.begin(), fresh.end(), values);
  return {};
}

std::string text_of(const double* values, std::size_t count) {
  std::string text = "[";
  for (std::size_t i = 0; i < count; ++i) text += (i == 0 ? "" : ", ") + text_of(values[i]);
  return text + "]";
}

std::string joined(const std::string& prefix, std::string_view key) {
  return prefix.empty() ? std::string(key) : fmt::format("{}.{}", prefix, key);
}

class TomlReader final : public OptionVisitor {
 public:
  struct Error {
    toml::source_position where;
    std::string text;
  };
  TomlReader(const toml::table& table, std::string prefix, std::vector<Error>& errors)
      : table_(table), prefix_(std::move(prefix)), errors_(errors) {}

  void number(std::string_view key, double& value, std::string_view unit, Range range, std::string_view) override {
    leaf(key, [&](const toml::node& node) { return assign(node, value, unit, range); });
  }
  void integer(std::string_view key, std::int64_t& value, std::string_view unit, Range range,
               std::string_view) override {
    leaf(key, [&](const toml::node& node) { return assign(node, value, unit, range); });
  }
  void flag(std::string_view key, bool& value, std::string_view) override {
    leaf(key, [&](const toml::node& node) { return assign(node, value); });
  }
  void string(std::string_view key, std::string& value, std::string_view) override {
    leaf(key, [&](const toml::node& node) { return assign(node, value); });
  }
  void string(std::string_view key, std::string& value, const Check& check, std::string_view) override {
    leaf(key, [&](const toml::node& node) { return assign(node, value, check); });
  }
  void choice(std::string_view key, std::string& value, std::vector<std::string_view> allowed,
              std::string_view) override {
    leaf(key, [&](const toml::node& node) { return assign(node, value, allowed); });
  }
  void numbers(std::string_view key, double* values, std::size_t count, std::string_view unit, Range range,
               std::string_view) override {
    leaf(key, [&](const toml::node& node) { return assign(node, values, count, unit, range); });
  }
  void section(std::string_view key, std::string_view, const std::function<void(OptionVisitor&)>& members) override {
    const toml::node* node = take(key);
    if (node == nullptr) return;
    if (const toml::table* inner = node->as_table()) {
      read(*inner, joined(prefix_, key), members);
    } else {
      refuse(*node, key, fmt::format("a table [{}]", joined(prefix_, key)));
    }
  }
  void list(std::string_view key, std::string_view, const std::function<std::size_t()>& size,
            const std::function<void()>& append,
            const std::function<void(OptionVisitor&, std::size_t)>& element) override {
    const toml::node* node = take(key);
    if (node == nullptr) return;
    const toml::array* array = node->as_array();
    if (array == nullptr ||
        !std::all_of(array->begin(), array->end(), [](const toml::node& n) { return n.is_table(); })) {
      refuse(*node, key, fmt::format("an array of tables [[{}]]", joined(prefix_, key)));
      return;
    }
    for (std::size_t i = 0; i < array->size(); ++i) {
      if (i == size()) append();
      read(*array->get(i)->as_table(), fmt::format("{}.{}", joined(prefix_, key), i),
           [&](OptionVisitor& v) { element(v, i); });
    }
  }

  /// Reads the chosen table of the list at `node`.
  void read_variant(Variants& variants, toml::node* node, const Description& members, const ForeignKey& foreign) {
    known_.push_back(variants.list);
    variants.names.clear();
    toml::array* array = node == nullptr ? nullptr : node->as_array();
    toml::table* chosen = nullptr;
    for (std::size_t i = 0; array != nullptr && i < array->size(); ++i) {
      toml::table* table = array->get(i)->as_table();
      const auto name = table == nullptr ? std::nullopt : (*table)["name"].value<std::string>();
      if (!name || name->empty()) {
        refuse(*array->get(i), variants.list, fmt::format("tables [[{}]], each with a name", variants.list));
        return;
      }
      if (std::find(variants.names.begin(), variants.names.end(), *name) != variants.names.end()) {
        refuse(*array->get(i), variants.list, fmt::format("different names; '{}' is there twice", *name));
        return;
      }
      variants.names.push_back(*name);
      if (chosen == nullptr && (variants.chosen.empty() || variants.chosen == *name)) chosen = table;
    }
    if (node != nullptr && array == nullptr)
      refuse(*node, variants.list, fmt::format("an array of tables [[{}]]", variants.list));
    if (chosen == nullptr) {
      if (!variants.chosen.empty() && errors_.empty())
        errors_.push_back(
            {table_.source().begin, fmt::format("no table [[{}]] has the name '{}'", variants.list, variants.chosen)});
      return;
    }
    const std::string name = (*chosen)["name"].value<std::string>().value_or("");
    chosen->erase("name");
    TomlReader inner(*chosen, fmt::format("{}.{}", variants.list, name), errors_);
    members(inner);
    inner.refuse_unknown_keys(foreign);
    variants.chosen = name;
  }

  void refuse_unknown_keys(const ForeignKey& foreign = nullptr) {
    for (const auto& [key, node] : table_) {
      if (std::find(known_.begin(), known_.end(), key.str()) != known_.end()) continue;
      if (foreign && foreign(key.str())) continue;
      errors_.push_back({key.source().begin,
                         fmt::format("unknown key '{}'{}", joined(prefix_, key.str()), suggestion(key.str(), known_))});
    }
  }

 private:
  const toml::node* take(std::string_view key) {
    known_.emplace_back(key);
    return table_.get(key);
  }
  template <typename Assign>
  void leaf(std::string_view key, const Assign& assign_node) {
    const toml::node* node = take(key);
    if (node == nullptr) return;
    if (const std::string expected = assign_node(*node); !expected.empty()) refuse(*node, key, expected);
  }
  void refuse(const toml::node& node, std::string_view key, const std::string& expected) {
    errors_.push_back({node.source().begin,
                       fmt::format("key '{}': expected {}, got {}", joined(prefix_, key), expected, text_of(node))});
  }
  void read(const toml::table& table, std::string prefix, const Description& members) {
    TomlReader inner(table, std::move(prefix), errors_);
    members(inner);
    inner.refuse_unknown_keys();
  }

  const toml::table& table_;
  std::string prefix_;
  std::vector<Error>& errors_;
  std::vector<std::string> known_;
};

// A visitor with one common function for all kinds of leaf.
class LeafVisitor : public OptionVisitor {
 public:
  void number(std::string_view key, double& value, std::string_view unit, Range range, std::string_view text) override {
    leaf(key, text_of(value), unit, range_text(range), text);
  }
  void integer(std::string_view key, std::int64_t& value, std::string_view unit, Range range,
               std::string_view text) override {
    leaf(key, std::to_string(value), unit, range_text(range), text);
  }
  void flag(std::string_view key, bool& value, std::string_view text) override {
    leaf(key, value ? "true" : "false", "", "true, false", text);
  }
  void string(std::string_view key, std::string& value, std::string_view text) override {
    leaf(key, toml_string(value), "", "", text);
  }
  void string(std::string_view key, std::string& value, const Check&, std::string_view text) override {
    string(key, value, text);
  }
  void choice(std::string_view key, std::string& value, std::vector<std::string_view> allowed,
              std::string_view text) override {
    std::string all;
    for (const std::string_view one : allowed) all += fmt::format("{}\"{}\"", all.empty() ? "" : ", ", one);
    leaf(key, toml_string(value), "", all, text);
  }
  void numbers(std::string_view key, double* values, std::size_t count, std::string_view unit, Range range,
               std::string_view text) override {
    const std::string limits = range_text(range);
    leaf(key, text_of(values, count), unit, limits.empty() ? limits : "each " + limits, text);
  }

 protected:
  virtual void leaf(std::string_view key, const std::string& value, std::string_view unit, const std::string& range,
                    std::string_view text) = 0;
};

// Reads the string key `name` of a list's element; empty if the element has no such key.
class NameProbe final : public LeafVisitor {
 public:
  using LeafVisitor::string;
  void string(std::string_view key, std::string& value, std::string_view) override {
    if (key == "name") name = value;
  }
  void section(std::string_view, std::string_view, const std::function<void(OptionVisitor&)>&) override {}
  void list(std::string_view, std::string_view, const std::function<std::size_t()>&, const std::function<void()>&,
            const std::function<void(OptionVisitor&, std::size_t)>&) override {}
  std::string name;

 protected:
  void leaf(std::string_view, const std::string&, std::string_view, const std::string&, std::string_view) override {}
};

class Overrider final : public OptionVisitor {
 public:
  Overrider(std::vector<std::string> path, std::string value) : path_(std::move(path)), value_(std::move(value)) {
    for (const std::string& part : path_) key_ = joined(key_, part);
  }

  AppliedOverride apply(const Description& description) {
    enter(0, description);
    return {key_, before_, after_};
  }

  void number(std::string_view key, double& value, std::string_view unit, Range range, std::string_view) override {
    leaf(
        key, [&](const toml::node& node) { return assign(node, value, unit, range); }, [&] { return text_of(value); },
        false);
  }
  void integer(std::string_view key, std::int64_t& value, std::string_view unit, Range range,
               std::string_view) override {
    leaf(
        key, [&](const toml::node& node) { return assign(node, value, unit, range); },
        [&] { return std::to_string(value); }, false);
  }
  void flag(std::string_view key, bool& value, std::string_view) override {
    leaf(
        key, [&](const toml::node& node) { return assign(node, value); },
        [&] { return std::string(value ? "true" : "false"); }, false);
  }
  void string(std::string_view key, std::string& value, std::string_view) override {
    leaf(
        key, [&](const toml::node& node) { return assign(node, value); }, [&] { return toml_string(value); }, true);
  }
  void string(std::string_view key, std::string& value, const Check& check, std::string_view) override {
    leaf(
        key, [&](const toml::node& node) { return assign(node, value, check); }, [&] { return toml_string(value); },
        true);
  }
  void choice(std::string_view key, std::string& value, std::vector<std::string_view> allowed,
              std::string_view) override {
    leaf(
        key, [&](const toml::node& node) { return assign(node, value, allowed); }, [&] { return toml_string(value); },
        true);
  }
  void numbers(std::string_view key, double* values, std::size_t count, std::string_view unit, Range range,
               std::string_view) override {
    leaf(
        key, [&](const toml::node& node) { return assign(node, values, count, unit, range); },
        [&] { return text_of(values, count); }, false);
  }
  void section(std::string_view key, std::string_view, const std::function<void(OptionVisitor&)>& members) override {
    if (!matches(key)) return;
    if (depth_ + 1 == path_.size()) refuse("a key inside this table");
    enter(depth_ + 1, members);
  }
  void list(std::string_view key, std::string_view, const std::function<std::size_t()>& size,
            const std::function<void()>&, const std::function<void(OptionVisitor&, std::size_t)>& element) override {
    if (!matches(key)) return;
    if (depth_ + 2 >= path_.size())
      refuse(fmt::format("{}.INDEX.KEY or {}.NAME.KEY of this list of {}", key, key, size()));
    const std::size_t index = find_element(path_[depth_ + 1], size(), element);
    enter(depth_ + 2, [&](OptionVisitor& v) { element(v, index); });
  }

 private:
  bool matches(std::string_view key) {
    known_.emplace_back(key);
    if (found_ || key != path_[depth_]) return false;
    found_ = true;
    return true;
  }
  void enter(std::size_t depth, const Description& members) {
    const std::size_t outer_depth = depth_;
    std::vector<std::string> outer_known = std::move(known_);
    depth_ = depth;
    known_.clear();
    found_ = false;
    members(*this);
    if (!found_)
      throw ConfigError(
          fmt::format("--set {}: unknown key '{}'{}", key_, path_[depth_], suggestion(path_[depth_], known_)));
    depth_ = outer_depth;
    known_ = std::move(outer_known);
  }
  [[noreturn]] void refuse(const std::string& expected) const {
    throw ConfigError(fmt::format("--set {}: expected {}, got {}", key_, expected, value_));
  }
  std::size_t find_element(const std::string& selector, std::size_t size,
                           const std::function<void(OptionVisitor&, std::size_t)>& element) {
    std::vector<std::string> names;
    std::optional<std::size_t> match;
    for (std::size_t i = 0; i < size; ++i) {
      NameProbe probe;
      element(probe, i);
      if (probe.name == selector) {
        if (match)
          throw ConfigError(fmt::format("--set {}: two elements are named '{}'; use the index", key_, selector));
        match = i;
      }
      if (!probe.name.empty()) names.push_back(probe.name);
    }
    if (match) return *match;
    const bool digits = !selector.empty() && selector.size() < 10 &&
                        std::all_of(selector.begin(), selector.end(), [](char c) { return c >= '0' && c <= '9'; });
    if (digits && std::stoul(selector) < size) return std::stoul(selector);
    throw ConfigError(
        fmt::format("--set {}: no element '{}' in a list of {}{}", key_, selector, size, suggestion(selector, names)));
  }
  template <typename Assign, typename Text>
  void leaf(std::string_view key, const Assign& assign_node, const Text& text, bool bare_string) {
    if (!matches(key)) return;
    if (depth_ + 1 != path_.size())
      throw ConfigError(fmt::format("--set {}: '{}' is a value and has no keys", key_, key));
    before_ = text();
    toml::table parsed;
    try {
      parsed = toml::parse("value = " + value_);
    } catch (const toml::parse_error&) {
      // not TOML: a bare string, or an invalid value
    }
    const toml::node* node = parsed.size() == 1 ? parsed.get("value") : nullptr;
    const toml::value<std::string> bare(value_);
    if (bare_string && (node == nullptr || !node->is_string())) node = &bare;
    const std::string expected = node != nullptr ? assign_node(*node) : assign_node(bare);
    if (!expected.empty()) refuse(expected);
    after_ = text();
  }

  std::vector<std::string> path_;
  std::string value_;
  std::string key_;
  std::string before_;
  std::string after_;
  std::size_t depth_ = 0;
  bool found_ = false;
  std::vector<std::string> known_;
};

std::string escaped(std::string_view text) {
  std::string out;
  for (const char c : text) {
    if (c == '|') out += '\\';
    out += c == '\n' ? ' ' : c;
  }
  return out;
}

class ReferencePrinter final : public LeafVisitor {
 public:
  explicit ReferencePrinter(std::string& out) : out_(out) {}
  void section(std::string_view key, std::string_view text,
               const std::function<void(OptionVisitor&)>& members) override {
    const std::string full = joined(prefix_, key);
    row(fmt::format("**[{}]**", full), "", "", "", text);
    inside_of(full, members);
  }
  void list(std::string_view key, std::string_view text, const std::function<std::size_t()>& size,
            const std::function<void()>& append,
            const std::function<void(OptionVisitor&, std::size_t)>& element) override {
    const std::string full = joined(prefix_, key);
    row(fmt::format("**[[{}]]**", full), fmt::format("{} elements", size()), "", "", text);
    append();  // on a scratch copy: the reference must describe an element even if the list is empty by default
    const std::size_t last = size() - 1;
    inside_of(full + "[]", [&](OptionVisitor& v) { element(v, last); });
  }

 protected:
  void leaf(std::string_view key, const std::string& value, std::string_view unit, const std::string& range,
            std::string_view text) override {
    row(fmt::format("`{}`", joined(prefix_, key)), fmt::format("`{}`", value), unit, range, text);
  }

 private:
  void row(const std::string& key, const std::string& value, std::string_view unit, const std::string& range,
           std::string_view text) {
    out_ +=
        fmt::format("| {} | {} | {} | {} | {} |\n", key, escaped(value), escaped(unit), escaped(range), escaped(text));
  }
  void inside_of(const std::string& prefix, const Description& members) {
    const std::string outer = std::exchange(prefix_, prefix);
    members(*this);
    prefix_ = outer;
  }
  std::string& out_;
  std::string prefix_;
};

class JsonWriter final : public OptionVisitor {
 public:
  explicit JsonWriter(nlohmann::ordered_json& out) : out_(out) {}
  void number(std::string_view key, double& value, std::string_view, Range, std::string_view) override {
    at(key) = value;
  }
  void integer(std::string_view key, std::int64_t& value, std::string_view, Range, std::string_view) override {
    at(key) = value;
  }
  void flag(std::string_view key, bool& value, std::string_view) override { at(key) = value; }
  void string(std::string_view key, std::string& value, std::string_view) override { at(key) = value; }
  void string(std::string_view key, std::string& value, const Check&, std::string_view) override { at(key) = value; }
  void choice(std::string_view key, std::string& value, std::vector<std::string_view>, std::string_view) override {
    at(key) = value;
  }
  void numbers(std::string_view key, double* values, std::size_t count, std::string_view, Range,
               std::string_view) override {
    at(key) = std::vector<double>(values, values + count);
  }
  void section(std::string_view key, std::string_view, const std::function<void(OptionVisitor&)>& members) override {
    at(key) = to_json(members);
  }
  void list(std::string_view key, std::string_view, const std::function<std::size_t()>& size,
            const std::function<void()>&, const std::function<void(OptionVisitor&, std::size_t)>& element) override {
    nlohmann::ordered_json elements = nlohmann::ordered_json::array();
    for (std::size_t i = 0; i < size(); ++i) elements.push_back(to_json([&](OptionVisitor& v) { element(v, i); }));
    at(key) = std::move(elements);
  }

 private:
  nlohmann::ordered_json& at(std::string_view key) { return out_[std::string(key)]; }
  nlohmann::ordered_json& out_;
};

}  // namespace

std::string read_whole_file(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in || std::filesystem::is_directory(path)) throw ConfigError(path + ": cannot be read");
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

void read_toml_text(const Description& description, std::string_view text, const std::string& path,
                    const ForeignKey& foreign, Variants* variants) {
  toml::table table;
  try {
    table = toml::parse(text, path);
  } catch (const toml::parse_error& error) {
    throw ConfigError(fmt::format("{}:{}: {}", path, error.source().begin.line, error.description()));
  }
  std::vector<TomlReader::Error> errors;
  TomlReader reader(table, "", errors);
  description(reader);
  if (variants != nullptr) reader.read_variant(*variants, table[variants->list].node(), description, foreign);
  reader.refuse_unknown_keys(foreign);
  if (errors.empty()) return;
  std::stable_sort(errors.begin(), errors.end(), [](const auto& a, const auto& b) { return a.where < b.where; });
  std::string message;
  for (const auto& error : errors)
    message += fmt::format("{}{}:{}: {}", message.empty() ? "" : "\n", path, error.where.line, error.text);
  throw ConfigError(message);
}

AppliedOverride apply_override(const Description& description, std::string_view assignment) {
  const std::size_t equals = assignment.find('=');
  if (equals == std::string_view::npos || equals == 0)
    throw ConfigError(fmt::format("--set {}: expected KEY=VALUE", assignment));
  std::vector<std::string> path;
  std::stringstream key{std::string(assignment.substr(0, equals))};
  for (std::string part; std::getline(key, part, '.');) path.push_back(part);
  if (assignment[equals - 1] == '.') path.emplace_back();
  return Overrider(std::move(path), std::string(assignment.substr(equals + 1))).apply(description);
}

std::string reference_markdown(const Description& description, std::string_view title) {
  std::string out =
      fmt::format("## {}\n\n| key | default | unit | range | meaning |\n| --- | --- | --- | --- | --- |\n", title);
  ReferencePrinter printer(out);
  description(printer);
  return out;
}

nlohmann::ordered_json to_json(const Description& description) {
  nlohmann::ordered_json out = nlohmann::ordered_json::object();
  JsonWriter writer(out);
  description(writer);
  return out;
}

}  // namespace softhand::config_detail

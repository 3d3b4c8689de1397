// Replies to messages. Every module receives every message and replies with the result.
#pragma once

#include <charconv>
#include <optional>
#include <string_view>

#include "messages/convert.hpp"
#include "messages/messages.hpp"

namespace softhand {

/// True if the message is addressed to this module or to all modules.
inline bool is_addressed(const Message& message, std::string_view module) {
  const std::string_view to = get_text(message.module);
  return to == "*" || to == module;
}

/// Parses a number that fills the whole `text`. Returns nothing for other text, infinities and NaN.
inline std::optional<double> parse_number(std::string_view text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

/// Parses three such numbers with spaces between them.
inline std::optional<Vector3> parse_vector(std::string_view text) {
  Vector3 vector;
  for (double& component : vector) {
    text.remove_prefix(std::min(text.find_first_not_of(' '), text.size()));
    const std::string_view word = text.substr(0, text.find(' '));
    const std::optional<double> value = parse_number(word);
    if (!value) return std::nullopt;
    component = *value;
    text.remove_prefix(word.size());
  }
  if (text.find_first_not_of(' ') != std::string_view::npos) return std::nullopt;
  return vector;
}

/// The reply of `module`. The sender of the reply must fill in its stamp.
inline MessageReply reply_to(const Message& message, std::string_view module, std::uint32_t result,
                             std::string_view text) {
  MessageReply reply;
  reply.id = message.id;
  set_text(reply.module, module);
  reply.result = result;
  set_text(reply.text, text);
  return reply;
}

}  // namespace softhand

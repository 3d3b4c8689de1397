// Text of other programs on a terminal.
#pragma once

#include <string>
#include <string_view>

namespace softhand {

/// `text` with a question mark in place of each control character (U+0000 to U+001F, U+007F to U+009F). Ends of lines
/// stay. Any program on the domain can choose names and replies, and a terminal would obey their control characters.
std::string terminal_text(std::string_view text);

}  // namespace softhand

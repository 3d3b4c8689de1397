// Options of the viewer's gateway: section [viewer] of a scene.
#pragma once

#include <cstdint>
#include <string>

#include "runtime/options.hpp"
#include "web/listening.hpp"

namespace softhand {

struct ViewerOptions {
  double rate_hz = 60;
  web::Listening listening{.port = 8080};
  std::string page;
  std::string node_encoding = "int16";
  std::int64_t max_pages = 16;
};

inline void describe(OptionVisitor& v, ViewerOptions& o) {
  v.number("rate_hz", o.rate_hz, "Hz", {1, 240},
           "Most samples of a stream that a page gets a second; the newest ones.");
  describe(v, o.listening,
           "Port; where it is taken, the next free one of the ten that follow. 0 = any, printed at the start.");
  v.string("page", o.page, "Folder of the built page; empty = ../share/softhand/viewer beside the program's folder.");
  v.choice("node_encoding", o.node_encoding, {"int16", "float32"},
           "Tissue nodes on the way to the page: int16 takes half the bytes and errs by 5 um.");
  v.integer("max_pages", o.max_pages, "1", {1, 1000}, "Pages that may be open at a time.");
}

}  // namespace softhand

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
  v.number("rate_hz", o.rate_hz, "Hz", {1, 240}, "Largest rate at which a page gets the newest samples of a stream.");
  describe(v, o.listening,
           "Port. If it is in use, the next free one of the following ten. 0 = any free port, printed at the start.");
  v.string("page", o.page,
           "Folder of the built page. Empty = ../share/softhand/viewer relative to the program's folder.");
  v.choice("node_encoding", o.node_encoding, {"int16", "float32"},
           "Encoding of tissue nodes for the page. int16 needs half the bytes and has an error of 5 um.");
  v.integer("max_pages", o.max_pages, "1", {1, 1000},
            "Largest number of open pages that may send messages. As many others may watch.");
}

}  // namespace softhand

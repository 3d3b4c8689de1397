// Where a server listens, and under which names: part of [viewer], [tracker_webxr] and [tracker_landmarks].
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "runtime/options.hpp"

namespace softhand::web {

struct Listening {
  std::string address = "127.0.0.1";
  std::int64_t port = 0;
  std::string hosts{};
  std::string certificate{};
  std::string key{};
};

inline void describe(OptionVisitor& v, Listening& o,
                     std::string_view port_text = "Port; 0 = any, printed at the start.") {
  v.string("address", o.address,
           "Address to listen on. 127.0.0.1 reaches this machine alone; 0.0.0.0 every network it is in.");
  v.integer("port", o.port, "1", {0, 65535}, port_text);
  v.string("hosts", o.hosts,
           "Names, separated by blanks, under which pages may reach it, besides localhost and its address.");
  v.string("certificate", o.certificate,
           "PEM file of a certificate (deploy/certificate makes one): https and wss for all, http and ws for this "
           "machine. Empty = http and ws alone.");
  v.string("key", o.key, "PEM file of the certificate's private key.");
}

}  // namespace softhand::web

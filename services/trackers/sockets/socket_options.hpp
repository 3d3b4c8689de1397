// Where a tracker without a driver listens: part of [tracker_webxr] and [tracker_landmarks].
#pragma once

#include <cstdint>
#include <string>

#include "runtime/options.hpp"

namespace softhand {

struct SocketOptions {
  std::string address = "127.0.0.1";
  std::int64_t port = 0;
  std::string hosts;
  std::string certificate;
  std::string key;
};

/// For this machine alone.
inline SocketOptions local_socket(std::int64_t port) {
  SocketOptions options;
  options.port = port;
  return options;
}

inline void describe(OptionVisitor& v, SocketOptions& o) {
  v.string("address", o.address, "Address to listen on. 127.0.0.1 reaches this machine alone; 0.0.0.0 every network it is in.");
  v.integer("port", o.port, "1", {0, 65535}, "Port; 0 = any, printed at the start.");
  v.string("hosts", o.hosts, "Names, separated by blanks, under which pages may reach it, besides localhost and its address.");
  v.string("certificate", o.certificate, "PEM file of a certificate: wss for pages that came by https. Empty = ws alone.");
  v.string("key", o.key, "PEM file of the certificate's private key.");
}

}  // namespace softhand

// Address, port and host names of a server: part of [viewer], [tracker_webxr] and [tracker_landmarks].
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "device/driver_check.hpp"
#include "runtime/options.hpp"

namespace softhand::web {

struct Listening {
  std::string address = "127.0.0.1";
  std::int64_t port = 0;
  std::string hosts{};
  std::string certificate{};
  std::string key{};
  std::string token{};
};

inline void describe(OptionVisitor& v, Listening& o,
                     std::string_view port_text = "Port. 0 = any free port, printed at the start.") {
  v.string("address", o.address,
           "Address to listen on. 127.0.0.1: only this machine can connect. 0.0.0.0: every network of this machine "
           "can connect.");
  v.integer("port", o.port, "1", {0, 65535}, port_text);
  v.string("hosts", o.hosts,
           "Host names under which pages may connect, separated by spaces, in addition to localhost and the address.");
  v.string("certificate", o.certificate,
           "PEM file of a certificate (deploy/certificate makes one). With it all machines use https and wss, and "
           "this machine may also use http and ws. Empty = only http and ws.");
  v.string("key", o.key, "PEM file of the private key of the certificate.");
  v.string(
      "token", o.token,
      "Viewer only. Programs of other machines may send messages only with this token in their address "
      "(`?token=...`): letters, digits, - and _. Empty = a new random one at each start, printed with the address.");
}

/// What the server needs on this machine.
inline DriverChecks checks(const Listening& o) {
  DriverChecks out{check_tcp_listening(o.address, o.port)};
  if (!o.certificate.empty()) out.push_back(check_file("the certificate", o.certificate));
  if (!o.key.empty()) out.push_back(check_file("the key", o.key));
  return out;
}

}  // namespace softhand::web

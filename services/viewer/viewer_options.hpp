// Options of the viewer's gateway: section [viewer] of a scene.
#pragma once

#include <cstdint>
#include <string>

#include "runtime/options.hpp"

namespace softhand {

struct ViewerOptions {
  double rate_hz = 60;
  std::string address = "127.0.0.1";
  std::int64_t port = 8080;
  std::string hosts;
  std::string page;
  std::string certificate;
  std::string key;
  std::string node_encoding = "int16";
  std::int64_t max_pages = 16;
};

inline void describe(OptionVisitor& v, ViewerOptions& o) {
  v.number("rate_hz", o.rate_hz, "Hz", {1, 240}, "Most samples of a stream that a page gets a second; the newest ones.");
  v.string("address", o.address, "Address to listen on. 127.0.0.1 reaches this machine alone; 0.0.0.0 every network it is in.");
  v.integer("port", o.port, "1", {0, 65535}, "TCP port; where it is taken, the next free one of the ten that follow. 0 = any.");
  v.string("hosts", o.hosts, "Names, separated by blanks, under which browsers may reach the gateway, besides localhost and its address.");
  v.string("page", o.page, "Folder of the built page; empty = ../share/softhand/viewer beside the program's folder.");
  v.string("certificate", o.certificate, "PEM file of a certificate (deploy/certificate makes one): https besides http. Empty = http alone.");
  v.string("key", o.key, "PEM file of the certificate's private key.");
  v.choice("node_encoding", o.node_encoding, {"int16", "float32"},
           "Tissue nodes on the way to the page: int16 takes half the bytes and errs by 5 um.");
  v.integer("max_pages", o.max_pages, "1", {1, 1000}, "Pages that may be open at a time.");
}

}  // namespace softhand

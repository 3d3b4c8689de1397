// From topics to pages and back. A topic is read only while some open page shows it, so that its writer is spared too.
#pragma once

#include <memory>
#include <vector>

#include "bus/bus.hpp"
#include "model/hand_model.hpp"
#include "viewer/server.hpp"

namespace softhand::viewer {

class Gateway {
 public:
  /// `hands`, of different sizes, are those that the scene may simulate: their rest nodes let pages tell strain. Where
  /// another hand announces itself, strain stays unknown.
  Gateway(const bus::Participant& participant, Server& server, std::vector<HandModel> hands, const HandKey& key,
          bool quantised, double rate_hz);
  ~Gateway();

  /// Passes on what is new, and what pages ask of modules.
  void step(Nanoseconds now);
  void fill_status(LoopStatus& status) const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace softhand::viewer

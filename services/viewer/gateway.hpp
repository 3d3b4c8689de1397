// Passes samples from topics to pages, and messages back. A topic is read only while a page shows it. This also saves
// work for its writer.
#pragma once

#include <memory>
#include <vector>

#include "bus/bus.hpp"
#include "model/hand_model.hpp"
#include "viewer/server.hpp"

namespace softhand::viewer {

class Gateway {
 public:
  /// `hands` are the hands that the scene may simulate, of different sizes. Pages compute strain from their rest nodes.
  /// For any other hand the strain stays unknown.
  Gateway(const bus::Participant& participant, Server& server, std::vector<HandModel> hands, const HandKey& key,
          bool quantised, double rate_hz);
  ~Gateway();

  /// Passes on new samples, and messages of pages to modules.
  void step(Nanoseconds now);
  void fill_status(LoopStatus& status) const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace softhand::viewer

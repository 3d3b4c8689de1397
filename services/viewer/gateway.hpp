// Passes samples from topics to pages, and messages back. A topic is read only while a page shows it. This also saves
// work for its writer.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "bus/bus.hpp"
#include "model/hand_model.hpp"
#include "viewer/server.hpp"

namespace softhand::viewer {

class Gateway {
 public:
  /// `hands` are the hands that the scene may simulate, of different sizes. Pages compute strain from their rest nodes.
  /// For any other hand the strain stays unknown. `folders` have the object files that descriptions name.
  Gateway(const bus::Participant& participant, Server& server, std::vector<HandModel> hands, const HandKey& key,
          bool quantised, double rate_hz, std::vector<std::string> folders);
  ~Gateway();

  /// Passes on new samples, and messages of pages to modules.
  void step(Nanoseconds now);
  void fill_status(LoopStatus& status) const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace softhand::viewer

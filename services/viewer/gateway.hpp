// Passes samples from topics to pages, and messages back. A topic is read only while a page shows it. This also saves
// work for its writer.
#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "bus/bus.hpp"
#include "model/hand_model.hpp"
#include "viewer/server.hpp"

namespace softhand::viewer {

/// Numbers for the names of modules. Anybody on the domain can invent names, so there are few numbers: a new name may
/// take the number of the name that was used the longest time ago.
class Slots {
 public:
  static constexpr std::size_t kMost = 64;
  std::uint32_t of(std::string_view name);

 private:
  struct Slot {
    std::string name;
    std::uint64_t used = 0;
  };
  std::vector<Slot> slots_;
  std::uint64_t uses_ = 0;
};

class Gateway {
 public:
  /// `hands` are the hands that the scene may simulate, of different sizes. Pages compute strain from their rest nodes.
  /// For any other hand the strain stays unknown. `folders` have the object files that descriptions name.
  Gateway(const bus::Participant& participant, Server& server, std::vector<HandModel> hands, const HandKey& key,
          bool quantised, double rate_hz, std::vector<std::string> folders);
  ~Gateway();

  /// Passes on new samples, and messages of pages to modules.
  void step(Nanoseconds now);
  /// Answers `prompt`: the pages show it to a person (`read_prompt`).
  MessageReply answer(const Message& message, const std::string& module);
  void fill_status(LoopStatus& status) const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace softhand::viewer

// softhand-viewer: shows the content of the topics in a browser.
#include <cstdio>
#include <filesystem>
#include <string>

#include "scene_file.hpp"
#include "service/service.hpp"
#include "viewer/gateway.hpp"

namespace {
using namespace softhand;

// Polls per period of `viewer.rate_hz`. One poll is too few for a stream of the same rate whose samples arrive at about
// the time of a poll. Then two samples sometimes arrive between two polls, and the first of them is lost. The next poll
// finds no sample.
constexpr double kPollsPerPeriod = 4;

std::string built_page() {
  return std::filesystem::read_symlink("/proc/self/exe").parent_path().parent_path() / "share/softhand/viewer";
}

void run(int argc, char** argv) {
  const ServiceArguments arguments = parse_arguments(argc, argv, "viewer", "Shows hands and objects in a browser");
  const Scene scene = read_own_scene(arguments.config, arguments.overrides);
  const ViewerOptions& options = scene.options.viewer;

  Service service(arguments, kPollsPerPeriod * options.rate_hz, Pacing::real, Urgency::ordinary);
  viewer::Server server(options.listening, options.page.empty() ? built_page() : options.page,
                        static_cast<std::size_t>(options.max_pages), options.rate_hz);
  viewer::Gateway gateway(service.participant(), server, load_possible_hands(scene), hand_key(scene),
                          options.node_encoding == "int16", options.rate_hz, object_folders(scene));
  std::printf("see it at %s\n", server.url().c_str());
  for (const std::string& url : server.urls_elsewhere()) std::printf("elsewhere at %s\n", url.c_str());
  std::fflush(stdout);
  service.run({.step = [&](Nanoseconds now) { gateway.step(now); },
               .answer = [&](const Message& message) { return gateway.answer(message, arguments.module); },
               .fill_status = [&](LoopStatus& status, Nanoseconds) { gateway.fill_status(status); }});
}
}  // namespace

int main(int argc, char** argv) {
  return softhand::guarded_main("softhand-viewer", [&] { run(argc, argv); });
}

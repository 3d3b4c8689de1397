// softhand-viewer: shows what is on the topics in a browser.
#include <cstdio>
#include <filesystem>
#include <string>

#include "scene_file.hpp"
#include "service/service.hpp"
#include "viewer/gateway.hpp"

namespace {
using namespace softhand;

// How often in a period of `viewer.rate_hz` new samples are looked for. Once is too seldom for streams of the same
// rate: where samples come at about the time of the look, now two come between two looks, of which the first is lost,
// and now none.
constexpr double kLooks = 4;

std::string built_page() {
  return std::filesystem::read_symlink("/proc/self/exe").parent_path().parent_path() / "share/softhand/viewer";
}

void run(int argc, char** argv) {
  const ServiceArguments arguments = parse_arguments(argc, argv, "viewer", "Shows hands and objects in a browser");
  const Scene scene = read_scene(arguments.config, arguments.overrides);
  const ViewerOptions& options = scene.options.viewer;

  Service service(arguments, kLooks * options.rate_hz, Pacing::real, Urgency::ordinary);
  viewer::Server server(options.listening, options.page.empty() ? built_page() : options.page,
                        static_cast<std::size_t>(options.max_pages), options.rate_hz);
  viewer::Gateway gateway(service.participant(), server, load_possible_hands(scene), hand_key(scene),
                          options.node_encoding == "int16", options.rate_hz);
  std::printf("see it at %s\n", server.url().c_str());
  for (const std::string& url : server.urls_elsewhere()) std::printf("elsewhere at %s\n", url.c_str());
  std::fflush(stdout);
  service.run({.step = [&](Nanoseconds now) { gateway.step(now); },
               .fill_status = [&](LoopStatus& status, Nanoseconds) { gateway.fill_status(status); }});
}
}  // namespace

int main(int argc, char** argv) {
  return softhand::guarded_main("softhand-viewer", [&] { run(argc, argv); });
}
